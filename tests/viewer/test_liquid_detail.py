"""What is drawn of much liquid: within the budget, as it is or as large as what it stands for, the same in every frame."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.run.frames import LiquidFrame
from tests.viewer import liquids
from viewer.detail import AUTO, FINE
from viewer.liquid_detail import coarse, part, region

NOWHERE = np.zeros(3)


def cloud(count: int, seed: int = 0) -> LiquidFrame:
    """Particles of different sizes in a cube of side 1, whose speed is their number."""
    rng = np.random.default_rng(seed)
    x, radius = rng.random((count, 3)).astype(np.float32), rng.uniform(0.01, 0.02, count).astype(np.float32)
    number = np.arange(count, dtype=np.float32)
    empty = np.zeros((0, 3), np.float32)
    return LiquidFrame(x, radius, number, -number, 2 * number, number % 2 == 0, empty, empty.astype(np.int32))


@settings(deadline=None)
@given(st.integers(2, 3000), st.integers(1, 1000), st.integers(0, 9))
def test_budgets_are_kept_and_volume_stays(count, budget, seed):
    liquid = cloud(count, seed)
    drawn = coarse(liquid, budget)
    assert len(drawn.positions) == min(count, budget)
    number = drawn.speed.astype(int)
    assert (np.diff(number) > 0).all(), "each once, in order"
    for name in ("positions", "pressure", "shear", "yielded"):
        assert np.array_equal(getattr(drawn, name), getattr(liquid, name)[number]), name
    larger = drawn.radius / liquid.radius[number]
    assert np.ptp(larger) < 1e-5 and larger[0] >= 1
    assert np.sum(drawn.radius.astype(float) ** 3) == pytest.approx(np.sum(liquid.radius.astype(float) ** 3), rel=1e-4)


def test_what_is_within_the_budget_is_drawn_as_it_is():
    liquid = cloud(500)
    assert coarse(liquid, 500) is liquid
    for level in ("auto", "fine", "full"):
        assert part(liquid, level, NOWHERE).liquid is liquid
        assert part(liquid, level, NOWHERE).said == "shown all 500 particles"


def test_what_is_drawn_is_spread_evenly_and_the_same_in_every_frame():
    liquid = liquids.large()
    drawn = coarse(liquid, 20_000)
    share = 20_000 / len(liquid.positions)
    for axis in range(3):
        inside, everywhere = (np.histogram(of.positions[:, axis], 12, (0, 0.6))[0] for of in (drawn, liquid))
        expected = share * everywhere
        assert (np.abs(inside - expected) < 5 * np.sqrt(expected) + 1).all()
    later = coarse(replace(liquid, positions=liquid.positions + np.float32(0.5)), 20_000)
    assert np.allclose(later.positions, drawn.positions + 0.5, atol=1e-6)
    places = {tuple(place) for place in coarse(liquid, 60_000).positions.tolist()}
    assert all(tuple(place) in places for place in drawn.positions.tolist()), "finer adds to coarser"


def test_no_lattice_shows_through():
    """Of the 8 particles of each cell of a lattice, each is drawn as often, and no layer more than another."""
    number = coarse(cloud(64_000), 8_000).speed.astype(int)
    for period in (2, 3, 4, 8, 40, 64, 1600):
        per_rest = np.bincount(number % period, minlength=period)
        assert (np.abs(per_rest - 8_000 / period) < 6 * np.sqrt(8_000 / period)).all(), period


def test_liquid_that_flows_in_changes_little_of_what_is_drawn():
    before, after = (set(coarse(cloud(count), 5_000).speed.tolist()) for count in (50_000, 51_000))
    assert len(before & after) > 0.97 * 5_000


@settings(deadline=None)
@given(st.integers(0, 2000), st.integers(1, 2500), st.tuples(*3 * [st.floats(-1, 2)]))
def test_a_region_is_the_frame_itself_near_its_middle(count, budget, centre):
    liquid = cloud(count)
    drawn = region(liquid, np.array(centre), budget)
    assert len(drawn.positions) == min(count, budget)
    number = drawn.speed.astype(int)
    assert np.array_equal(drawn.radius, liquid.radius[number])
    distance = np.linalg.norm(liquid.positions - np.array(centre), axis=1)
    assert distance[number].max(initial=0) <= np.delete(distance, number).min(initial=np.inf)


@pytest.mark.parametrize(("level", "budget"), [("auto", AUTO), ("fine", FINE), ("region", AUTO)])
def test_levels_keep_their_budgets_and_say_so(level, budget):
    liquid = liquids.large()
    drawn = part(liquid, level, liquid.positions[0])
    assert len(drawn.liquid.positions) == budget.segments
    larger = "" if level == "region" else ", as large as all of them together"
    assert drawn.said == f"shown {budget.segments:,} of 172,801 particles{larger}"
    assert part(liquid, "full", NOWHERE).said == "shown all 172,801 particles"
