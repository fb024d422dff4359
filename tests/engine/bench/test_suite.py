import json

import numpy as np
import pytest

from engine.bench import suite
from engine.bench.machine import memory_bandwidth
from engine.bench.page import bench_page
from engine.bench.suite import Measurement, Note, Standing, UnknownBenchmark, benchmark, median_seconds, run


@pytest.fixture
def registry(monkeypatch):
    """An empty suite on a machine of 1 GB/s."""
    monkeypatch.setattr(suite, "_benchmarks", {})
    monkeypatch.setattr(suite.pkgutil, "iter_modules", lambda path: [])
    monkeypatch.setattr(suite, "memory_bandwidth", lambda threads: 1e9)


def test_rows_state_throughput_share_ratio_and_scaling(registry):
    @benchmark("solve", summary="s")
    def solve():
        yield Measurement("cg", 10.0, 1.0, "rows")
        for size in (100.0, 1000.0):
            yield Measurement("patch", size, 1e-3 * size**1.2, "crossings", bytes_moved=1e8, peer="pyamg",
                              peer_seconds=2.0, error=1e-8, details={"iterations": 7})

    told = []
    [result] = run(on_progress=lambda *progress: told.append(progress))
    row = result["rows"][1]
    seconds = 1e-3 * 100**1.2
    assert row["throughput"] == pytest.approx(100 / seconds) and row["unit"] == "crossings/s"
    assert row["bandwidth_share"] == pytest.approx(0.1 / seconds)
    assert row["ratio"] == pytest.approx(2 / seconds)
    assert result["exponent"] == pytest.approx(1.2)
    assert result["machine"]["bandwidth_bytes_per_s"] == 1e9
    assert told == [("solve", "cg 10"), ("solve", "patch 100"), ("solve", "patch 1000")]
    page = bench_page([result])
    assert "1.20" in page and "pyamg" in page and "http" not in page
    json.dumps(result, allow_nan=False)


def test_where_knobs_vary_the_page_shows_error_against_seconds(registry):
    @benchmark("front", summary="s")
    def front():
        for tolerance in (1e-2, 1e-3):
            for steps in (10.0, 40.0):
                yield Measurement(f"cloth, tolerance {tolerance:g}", steps, 0.1 * steps, "steps", error=1.0 / steps,
                                  standing=Standing(on_front=True, default=(steps, tolerance) == (40.0, 1e-3)))

    page = bench_page(run())
    assert "cloth: error against seconds" in page and "<h3>cloth</h3>" in page and "seconds against size" not in page
    assert page.count(", the default</title>") == 1 and "cloth, tolerance 0.001, 40 steps: 4 s, error 0.025" in page


def test_where_solvers_converge_the_page_shows_error_against_iterations_and_seconds_and_not_as_sizes(registry):
    @benchmark("solver", summary="s")
    def solver():
        for size in (100.0, 1000.0):
            yield Measurement("step", size, 1e-3 * size**1.2, "strands", error=0.5)
        for iterations in (1, 2, 4):
            yield Measurement("tangle, sweeps", iterations, 0.1 * iterations, "sweeps", error=1.0 / iterations, converging=True)

    [result] = run()
    page = bench_page([result])
    assert result["exponent"] == pytest.approx(1.2) and [row["converging"] for row in result["rows"]] == 2 * [False] + 3 * [True]
    assert page.count("<h3>tangle</h3>") == 2 and "seconds against size" in page
    assert "tangle: error against iterations" in page and "tangle: error against seconds" in page
    assert page.count("tangle, sweeps, 4 sweeps: 0.4 s, error 0.25</title>") == 2 and "tangle, sweeps, size" not in page


def test_a_benchmark_that_raises_keeps_its_rows(registry):
    @benchmark("breaks", summary="s")
    def breaks():
        yield Measurement("a", 1.0, 1.0, "x")
        raise MemoryError("too large")

    benchmark("works", summary="s")(lambda: iter([Measurement("a", 1.0, 1.0, "x")]))
    broken, works = run()
    assert len(broken["rows"]) == 1 and broken["note"] == "ended by MemoryError: too large"
    assert broken["exponent"] is None and works["note"] == ""
    assert "too large" in bench_page([broken])


def test_what_is_missing_is_noted(registry):
    @benchmark("lonely", summary="s")
    def lonely():
        yield Note("without a peer")
        yield Measurement("a", 1.0, 1.0, "x")
        raise MemoryError("too large")

    [result] = run()
    assert len(result["rows"]) == 1 and result["note"] == "without a peer; ended by MemoryError: too large"


def test_an_unknown_name_is_refused(registry):
    with pytest.raises(UnknownBenchmark, match="no benchmark is called nothing"):
        run(["nothing"])


def test_medians_leave_the_first_call_out():
    calls = []
    assert median_seconds(lambda: calls.append(1), repeats=3) >= 0
    assert len(calls) == 4


def test_bandwidth_is_measured_once_per_thread_count(monkeypatch):
    monkeypatch.setattr("engine.bench.machine.ENTRIES", 100_000)
    try:
        bandwidth = memory_bandwidth(1)
        assert np.isfinite(bandwidth) and bandwidth > 1e8 and memory_bandwidth(1) == bandwidth
    finally:
        memory_bandwidth.cache_clear()
