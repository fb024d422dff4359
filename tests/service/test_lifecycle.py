"""Laws of the life of a job, over all sequences of events."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.lifecycle import ImpossibleEvent, JobEvent, JobState, Life, transition

events = st.lists(st.sampled_from(JobEvent), max_size=30)


def live(sequence, max_attempts=3):
    """All states of a life that meets the events; impossible ones leave it as it was."""
    lives = [Life(max_attempts=max_attempts)]
    for event in sequence:
        try:
            lives.append(transition(lives[-1], event))
        except ImpossibleEvent:
            lives.append(lives[-1])
    return lives


@given(events)
def test_an_end_is_an_end(sequence):
    lives = live(sequence)
    ended = [life for life in lives if life.state.final]
    assert all(life == ended[0] for life in ended)
    assert not ended or lives[-1] == ended[0]


@given(events, st.integers(1, 5))
def test_attempts_are_bounded(sequence, max_attempts):
    for life in live(sequence, max_attempts):
        assert 0 <= life.attempts <= max_attempts
        assert life.state != JobState.RUNNING or life.attempts >= 1


@given(events)
def test_a_cancelled_job_never_waits_again(sequence):
    for before, after in zip(live(sequence), live(sequence)[1:], strict=False):
        if before.cancel_requested:
            assert after.cancel_requested
            assert after.state != JobState.QUEUED


@given(events)
def test_only_a_claim_starts_a_job(sequence):
    lives = live(sequence)
    for before, after, event in zip(lives, lives[1:], sequence, strict=False):
        if before.state != JobState.RUNNING and after.state == JobState.RUNNING:
            assert event == JobEvent.CLAIM and before.state == JobState.QUEUED


@given(events)
def test_only_a_user_cancels(sequence):
    if JobEvent.CANCEL not in sequence:
        assert all(life.state != JobState.CANCELLED for life in live(sequence))


@given(st.integers(1, 8))
def test_a_poison_job_fails_after_its_attempts(max_attempts):
    sequence = [JobEvent.CLAIM, JobEvent.LOSE] * max_attempts
    lives = live(sequence, max_attempts)
    assert lives[-1].state == JobState.FAILED
    assert all(not life.state.final for life in lives[:-1])


@given(st.integers(1, 50))
def test_a_service_may_restart_any_number_of_times(restarts):
    life = live([JobEvent.CLAIM, JobEvent.RELEASE] * restarts)[-1]
    assert life == Life()


@pytest.mark.parametrize("event", [event for event in JobEvent if event not in (JobEvent.CLAIM, JobEvent.CANCEL)])
def test_a_waiting_job_cannot_end_by_itself(event):
    with pytest.raises(ImpossibleEvent):
        transition(Life(), event)
