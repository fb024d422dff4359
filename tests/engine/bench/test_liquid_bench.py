"""The benchmark of liquid at a size that says nothing about speed: that its rows are whole and mean what they say."""

import json

import numpy as np
import pytest

from engine.bench import liquid as bench
from engine.bench import liquid_memory, peer_mpm, suite
from engine.bench.suite import Measurement, Note
from engine.liquid.observe import energies
from engine.liquid.settings import LiquidSettings

FEW = 8 * 8**3


@pytest.fixture(scope="module")
def rows():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench, "WARM_UP", 1)
        patch.setattr(bench, "TIMED", 1)
        patch.setattr(peer_mpm, "installed", lambda: False)
        return list(bench.measurements([FEW]))


def test_rows_are_whole(rows):
    *rows, note = rows
    assert note == Note("Taichi MLS-MPM is not installed")
    assert [row.case for row in rows] == [
        "water, step", "water, pressure", "water, transfers",
        "milk-cream, step", "milk-cream, shear", "milk-cream, pressure", "milk-cream, one product of shear",
    ]
    for row in rows:
        assert row.size == FEW and row.seconds > 0.0 and row.peer is None
        json.dumps(suite._row(row, 1e9), allow_nan=False)


def test_steps_tell_their_parts_and_their_memory(rows):
    steps = {row.case: row for row in rows if isinstance(row, Measurement) and row.case.endswith("step")}
    water, cream = steps["water, step"], steps["milk-cream, step"]
    assert water.details["state_bytes"] == pytest.approx(8 * (3 + 3 + 9 + 1), abs=0.1)
    assert cream.details["state_bytes"] - water.details["state_bytes"] == pytest.approx(8 * (6 + 1 + 1), abs=0.1)
    for row in (water, cream):
        assert row.details["grid_bytes"] > 0.0 and row.details["linear"] >= 1
        assert 0.5 * row.seconds < sum(spent for name, spent in row.details.items() if name.endswith("_s")) <= row.seconds
        assert 0.0 <= row.error <= LiquidSettings.shear_tolerance


def test_transfers_move_a_block_and_keep_its_momentum():
    block = bench.Block("water", FEW)
    x, momentum = block.state.x.mean(axis=0), block.state.volume @ block.state.velocity
    h = bench.step_of(block.state)
    parts, moved = bench.transfers(block.model, block.state)
    assert set(parts) == {"sort", "to_grid", "on_grid", "to_particles"} and moved > 4 * 128 * FEW
    assert block.state.volume @ block.state.velocity == pytest.approx(momentum, rel=1e-12)
    assert block.state.x.mean(axis=0) - x == pytest.approx([(1 + bench.TRANSFERS) * h * bench.SPEED, 0.0, 0.0])


def test_the_product_of_shear_leaves_the_block_as_it_is():
    block = bench.Block("milk-cream", FEW)
    block.take(1)
    before = energies(block.model, block.state, np.zeros(3))["kinetic"]
    product, moved = bench.shear_product(block.model, block.state)
    product()
    assert moved > (24 + 32) * FEW and energies(block.model, block.state, np.zeros(3))["kinetic"] == pytest.approx(before)


def test_bytes_are_those_of_arrays_each_counted_once():
    a, b = np.zeros(3), np.zeros(2, np.float32)
    assert bench.bytes_of((a, [b, (a,)], None, "text")) == 24 + 8


def test_the_peer_steps_the_same_block():
    pytest.importorskip("taichi")
    block = bench.Block("water", FEW)
    for bits in (32, 64):
        assert 0.0 < peer_mpm.seconds_of_step(block.state.x, bench.SPEED, bench.SPACING, block.model.density, bits, 1) < 10.0


def test_both_sets_are_in_the_suite():
    assert {"liquid", "liquid-small"} <= set(suite.benchmarks())


def test_memory_is_that_of_a_process_of_its_own():
    water, cream = liquid_memory.measurements([FEW])
    assert [row.case for row in (water, cream)] == ["water, step", "milk-cream, step"]
    for row in (water, cream):
        assert row.size == FEW and row.details["resident_bytes"] > row.details["state_bytes"] + row.details["grid_bytes"] > 128.0
    assert "liquid-memory" in suite.benchmarks()
