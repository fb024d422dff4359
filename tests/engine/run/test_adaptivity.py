from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.run.adaptivity import (
    CALM,
    StepLimits,
    StepSize,
    StepTooSmall,
    after_accepted,
    after_rejected,
    first_size,
    plan,
)

LIMITS = StepLimits(default=1e-3, min=1e-6, max=2e-3)


def steps_to(target: float, time: float, dt: float) -> list[float]:
    """The steps that are planned from `time` until `target` is hit, as the time loop takes them."""
    taken = []
    while time < target:
        remaining = target - time
        taken.append(plan(dt, remaining))
        time = target if taken[-1] == remaining else time + taken[-1]
    return taken


def test_whole_steps_are_left_alone():
    assert plan(1e-3, 1.0) == 1e-3
    assert plan(1e-3, 2e-3) == pytest.approx(1e-3)


def test_a_remainder_within_round_off_is_taken_exactly():
    remaining = 1e-3 * (1 + 1e-12)
    assert plan(1e-3, remaining) == remaining


def test_a_sliver_is_shared_by_two_equal_steps():
    taken = steps_to(1 / 24, 0.0, 1e-3)
    assert len(taken) == 42 and taken[-1] == pytest.approx(taken[-2], rel=1e-9)
    assert min(taken) > 0.5e-3


@given(st.floats(1e-5, 0.1), st.integers(1, 500), st.floats(1, 240))
def test_frame_times_are_hit_and_no_step_is_a_sliver(dt, frame, fps):
    start, target = (frame - 1) / fps, frame / fps
    if (target - start) / dt > 2000:
        return
    taken = steps_to(target, start, dt)
    assert max(taken) <= dt * (1 + 1e-9)
    assert min(taken) >= min(target - start, dt) * 0.5 * (1 - 1e-6)
    assert float(sum(map(Fraction, taken))) == pytest.approx(target - start, rel=1e-9)


def test_rejections_halve_what_was_tried_and_end_at_the_minimum():
    size = after_rejected(1e-3, LIMITS)
    assert size == StepSize(0.5e-3)
    with pytest.raises(StepTooSmall, match="none below 1e-06"):
        while True:
            size = after_rejected(size.dt, LIMITS)


def test_the_step_doubles_after_calm_steps_up_to_the_maximum():
    size = after_rejected(first_size(LIMITS).dt, LIMITS)
    for expected in (1e-3, 2e-3, 2e-3):
        for _ in range(CALM):
            size = after_accepted(size, LIMITS)
        assert size.dt == expected


def test_shortening_before_a_frame_is_forgotten():
    size = first_size(LIMITS)
    assert plan(size.dt, 0.3e-3) == 0.3e-3
    assert after_accepted(size, LIMITS).dt == size.dt
