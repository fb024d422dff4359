from viewer.timeline import Timeline


def timeline(count: int = 5) -> Timeline:
    made = Timeline()
    made.extend([0.1 * k for k in range(count)])
    return made


def test_following_shows_each_new_frame():
    line = timeline(1)
    line.follow = True
    line.extend([0.0, 0.1, 0.2])
    assert line.index == 2


def test_seeking_ends_following_and_playing_and_stays_in_range():
    line = timeline()
    line.follow = True
    line.play()
    line.seek(99)
    assert (line.index, line.follow, line.playing) == (4, False, False)
    line.extend([0.1 * k for k in range(9)])
    assert line.index == 4
    line.seek(-1)
    assert line.index == 0


def test_playing_goes_with_simulated_time_and_ends_at_the_last_frame():
    line = timeline()
    line.play()
    line.advance(0.25)
    assert (line.index, line.playing) == (2, True)
    line.advance(1.0)
    assert (line.index, line.playing) == (4, False)
    line.play()
    assert line.index == 0, "from the start again"


def test_without_frames_nothing_moves():
    line = Timeline()
    line.play()
    line.advance(1.0)
    line.seek(3)
    assert (line.index, line.last, line.playing) == (0, 0, False)
