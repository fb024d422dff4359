import errno
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from engine.run.files import ASIDE
from engine.run.frames import (
    Frame,
    LiquidFrame,
    StrandFrame,
    YarnFrame,
    drop_frames,
    frame_path,
    frame_paths,
    read_frame,
    write_frame,
)

ROOT = Path(__file__).resolve().parents[3]


def example_frame(index: int = 3) -> Frame:
    rng = np.random.default_rng(index)
    yarns = YarnFrame(
        line_positions=rng.normal(size=(7, 3)), line_offsets=np.array([0, 4, 7]), line_strain=rng.normal(size=7),
        line_points=np.arange(7, dtype=np.int32),
        radius=np.array([1e-3, 2e-3]), fabric=np.array([-1, 0]), node_positions=rng.normal(size=(5, 3)),
        node_states=np.arange(5, dtype=np.uint8) % 4, node_points=np.arange(5), u=rng.normal(size=8),
    )
    return Frame(index, index / 30, 17 * index, yarns, series={"dt": 1e-3, "residual": 0.25})


def example_strands() -> StrandFrame:
    rng = np.random.default_rng(0)
    return StrandFrame(
        rng.normal(size=(7, 3)).astype(np.float32), np.array([0, 3, 7]), np.full(7, 4e-5, np.float32), np.array([0, 1]),
        *rng.normal(size=(3, 7)).astype(np.float32),
    )


def example_liquid(vertices: int = 4) -> LiquidFrame:
    rng = np.random.default_rng(0)
    return LiquidFrame(
        rng.normal(size=(7, 3)).astype(np.float32), *rng.normal(size=(4, 7)).astype(np.float32), rng.random(7) > 0.5,
        rng.normal(size=(vertices, 3)).astype(np.float32), rng.integers(0, 4, (vertices, 3)).astype(np.int32),
    )


def assert_same(a: Frame, b: Frame) -> None:
    assert (a.index, a.time, a.step, a.series) == (b.index, b.time, b.step, b.series)
    for mine, other in ((a.yarns, b.yarns), (a.strands, b.strands), (a.liquid, b.liquid)):
        assert (mine is None) == (other is None)
        for name, values in vars(mine).items() if mine is not None else ():
            read = getattr(other, name)
            assert read.dtype == values.dtype and np.array_equal(read, values), name


def test_a_frame_is_read_as_it_was_written(tmp_path):
    frame = example_frame()
    assert_same(frame, read_frame(write_frame(tmp_path, frame)))


@pytest.mark.parametrize("without", [{}, {"yarns": None}])
def test_a_frame_with_strands_is_read_as_it_was_written(tmp_path, without):
    frame = replace(example_frame(), strands=example_strands(), **without)
    assert_same(frame, read_frame(write_frame(tmp_path, frame)))


@pytest.mark.parametrize("vertices", [4, 0])
def test_a_frame_with_liquid_is_read_as_it_was_written(tmp_path, vertices):
    frame = replace(example_frame(), yarns=None, liquid=example_liquid(vertices))
    assert_same(frame, read_frame(write_frame(tmp_path, frame)))


def test_a_frame_without_yarns_strands_or_liquid_has_none(tmp_path):
    read = read_frame(write_frame(tmp_path, replace(example_frame(), yarns=None)))
    assert read.yarns is None and read.strands is None and read.liquid is None


def test_equal_frames_are_equal_files(tmp_path):
    first = write_frame(tmp_path, example_frame()).read_bytes()
    assert write_frame(tmp_path, example_frame()).read_bytes() == first


def test_frames_are_in_order_and_the_trajectory_links_to_them(tmp_path):
    for index in (0, 1, 2):
        write_frame(tmp_path, example_frame(index))
    (tmp_path / "frames" / ("000003.h5" + ASIDE)).write_bytes(b"half a frame")
    assert [path.name for path in frame_paths(tmp_path)] == ["000000.h5", "000001.h5", "000002.h5"]
    with h5py.File(tmp_path / "trajectory.h5") as trajectory:
        assert list(trajectory["frames"]) == ["000000", "000001", "000002"]
        assert trajectory["frames/000002"].attrs["time"] == 2 / 30
        assert np.array_equal(trajectory["frames/000001/yarns/u"][()], example_frame(1).yarns.u)


def test_dropped_frames_leave_no_trajectory(tmp_path):
    write_frame(tmp_path, example_frame())
    drop_frames(tmp_path)
    assert frame_paths(tmp_path) == [] and not (tmp_path / "trajectory.h5").exists()


def test_a_full_disk_leaves_whole_frames_only(tmp_path, monkeypatch):
    write_frame(tmp_path, example_frame(0))

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"No space left on device.*000001\.h5"):
        write_frame(tmp_path, example_frame(1))
    assert os.listdir(tmp_path / "frames") == ["000000.h5"]
    assert_same(read_frame(frame_path(tmp_path, 0)), example_frame(0))


def test_kill_at_any_time_leaves_whole_frames_and_a_whole_trajectory(tmp_path):
    program = (
        "import sys; from pathlib import Path; from itertools import count\n"
        "from tests.engine.run.test_frames import example_frame, write_frame\n"
        "for index in count(): write_frame(Path(sys.argv[1]), example_frame(index))"
    )
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], cwd=ROOT)
    deadline = time.monotonic() + 30
    while len(frame_paths(tmp_path)) < 5 and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    paths = frame_paths(tmp_path)
    assert len(paths) >= 5
    for index, path in enumerate(paths):
        assert_same(read_frame(path), example_frame(index))
    with h5py.File(tmp_path / "trajectory.h5") as trajectory:
        assert len(trajectory["frames"]) in (len(paths), len(paths) - 1)
