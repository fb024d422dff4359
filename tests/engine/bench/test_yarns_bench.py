"""The benchmark of yarns at sizes that say nothing about speed: that its rows are whole and mean what they say."""

import json

import numpy as np
import pytest

from engine.bench import suite
from engine.bench import yarns as bench
from engine.yarns.model import PointKind
from engine.yarns.settings import YarnSettings
from tests.engine.bench.peers import without


def test_rows_of_steps_are_whole():
    patch = bench.of_steps("patch", bench.hung_by_two_corners(36))
    stack = bench.of_steps("stack", bench.stacked(64))
    assert patch.size == 36 and patch.details["eil_share"] == 0.0
    assert stack.size > 64 / 2 and stack.details["eil_share"] > 0.0
    for row in (patch, stack):
        assert row.error is not None and 0.0 < row.error <= YarnSettings.tolerance
        assert row.details["newton"] >= 1 and row.details["cg_per_newton"] >= 1
        stages = sum(row.details[f"{stage}_s"] for stage in bench.STAGES)
        assert 0.3 * row.seconds < stages
        assert row.bytes_moved == pytest.approx(row.details["newton"] * row.details["bytes_per_newton"])
        json.dumps(suite._row(row, 1e9), allow_nan=False)


def test_the_patch_hangs_by_two_corners():
    built = bench.hung_by_two_corners(36)
    held = (built.yarns.free_directions == 0).all(axis=(1, 2))
    assert held.sum() == 4 and (built.state.x[held, 1] > 0).all()  # the last weft and an outermost warp at each corner
    assert np.ptp(built.state.x[held, 0]) > 0.9 * np.ptp(built.state.x[:, 0])


def test_crossings_count_contacts_between_layers_too():
    built = bench.stacked(64)
    assert bench.crossings_of(built.yarns) == 2 * 16 + np.sum(built.yarns.point_kind == PointKind.CONTACT)


def test_stacks_of_denim_have_the_size_that_was_asked_for():
    first, second = bench.scaling(points=(400, 1600))
    assert first.size == pytest.approx(400, rel=0.5) and 3 < second.size / first.size < 4.5  # without ends of yarns
    for row in (first, second):
        assert row.error <= YarnSettings.tolerance and row.details["newton"] >= 1
        assert row.details.get("bytes_per_point", 1.0) > 0.0  # absent where tests before held more memory
        json.dumps(suite._row(row, 1e9), allow_nan=False)


def test_traffic_is_that_of_the_matrix():
    steps = bench.Steps(bench.hung_by_two_corners(36))
    system, _ = steps.system()
    per_newton, per_linear = bench.traffic(system)
    values = system.layout.matrix.block
    assert values.itemsize == 8  # a small system is in double precision
    assert per_newton > 2 * values.nbytes
    assert per_linear > 1.5 * values.nbytes


def test_the_peer_solves_the_same_system():
    pytest.importorskip("pyamg")
    [row] = bench.against_peer(100)
    assert row.error < 1e-6 and row.details["peer_error"] <= 1.01 * row.error
    assert row.peer_seconds is not None and row.peer_seconds > 0


def test_without_the_peer_its_row_is_left_out(monkeypatch):
    without(monkeypatch, "pyamg")
    assert list(bench.against_peer(100)) == []


def test_the_first_frame_is_timed_in_a_process_of_its_own(monkeypatch, tmp_path):
    monkeypatch.setattr(bench, "FIRST_FRAME", "import os\nfor k in range(2): print(k, flush=True)\n"
                                              "open(os.environ['STRANDLINE_CACHE_DIR'] + '/seen', 'w').close()")
    picture, frame = bench.first_frame(tmp_path)
    assert 0.0 < picture <= frame < 10.0
    assert (tmp_path / "seen").exists()


def test_both_sets_are_in_the_suite():
    assert {"yarns", "yarns-small"} <= set(suite.benchmarks())
