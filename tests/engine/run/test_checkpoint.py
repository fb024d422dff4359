import numpy as np
import pytest

from engine.run.adaptivity import StepSize
from engine.run.checkpoint import Checkpoint, CheckpointMismatch, checkpoint_path, read_checkpoint, write_checkpoint
from engine.run.statistics import Statistics

ARRAYS = {
    "yarns.x": np.array([[0.1, 1 / 3, 1e-300]]), "yarns.eil": np.array([True, False]), "yarns.order": np.arange(2),
}


def checkpoint(**changes) -> Checkpoint:
    statistics = Statistics(seconds=[0.1, 1 / 3], newton_iterations=[2], counts={"eil": 4}, dt_min=1e-3)
    values = dict(scene="abc", time=0.1 + 0.2, step=7, next_frame=2, size=StepSize(1e-3 / 3, 5), arrays=ARRAYS,
                  statistics=statistics)
    return Checkpoint(**(values | changes))


def test_a_checkpoint_is_read_bitwise(tmp_path):
    write_checkpoint(tmp_path, checkpoint())
    read = read_checkpoint(tmp_path, "abc", ARRAYS)
    for name in ("scene", "time", "step", "next_frame", "size", "statistics"):
        assert getattr(read, name) == getattr(checkpoint(), name)
    for name, values in ARRAYS.items():
        assert read.arrays[name].dtype == values.dtype and read.arrays[name].tobytes() == values.tobytes()


def test_another_scene_is_refused(tmp_path):
    write_checkpoint(tmp_path, checkpoint())
    with pytest.raises(CheckpointMismatch, match="another scene"):
        read_checkpoint(tmp_path, "abd", ARRAYS)


@pytest.mark.parametrize("expected, said", [
    (ARRAYS | {"yarns.x": np.zeros((2, 3))}, r"yarns.x is float64\[1, 3\], not float64\[2, 3\]"),
    (ARRAYS | {"yarns.order": np.zeros(2)}, "int64"),
    (ARRAYS | {"strands.x": np.zeros(2)}, r"other arrays.*strands\.x"),
])
def test_other_arrays_are_refused(tmp_path, expected, said):
    write_checkpoint(tmp_path, checkpoint())
    with pytest.raises(CheckpointMismatch, match=said):
        read_checkpoint(tmp_path, "abc", expected)


CONTACTS = {"key": np.array([3, 9, 11]), "force": np.ones((3, 3)), "x": np.zeros((5, 3))}
VARYING = frozenset({"key", "force"})


@pytest.mark.parametrize("rows", [0, 2, 3, 70])
def test_arrays_that_vary_may_have_any_number_of_rows(tmp_path, rows):
    now = CONTACTS | {"key": np.arange(rows), "force": np.full((rows, 3), 0.1)}
    write_checkpoint(tmp_path, checkpoint(arrays=now))
    read = read_checkpoint(tmp_path, "abc", CONTACTS, VARYING)
    for name, values in now.items():
        assert read.arrays[name].dtype == values.dtype and np.array_equal(read.arrays[name], values)


@pytest.mark.parametrize("changes, said", [
    ({"x": np.zeros((4, 3))}, r"x is float64\[4, 3\], not float64\[5, 3\]"),
    ({"key": np.zeros(3)}, "key is float64"),
    ({"key": np.arange(2)}, r"key is int64\[2\], not int64\[3\]"),
    ({"force": np.zeros((3, 2))}, r"force is float64\[3, 2\], not float64\[3, 3\]"),
    ({"force": np.array(1.0), "key": np.array(1)}, "force is float64"),
])
def test_arrays_that_vary_have_their_type_and_as_many_rows_as_each_other(tmp_path, changes, said):
    write_checkpoint(tmp_path, checkpoint(arrays=CONTACTS | changes))
    with pytest.raises(CheckpointMismatch, match=said):
        read_checkpoint(tmp_path, "abc", CONTACTS, VARYING)


def test_a_broken_file_is_refused(tmp_path):
    write_checkpoint(tmp_path, checkpoint())
    whole = checkpoint_path(tmp_path).read_bytes()
    checkpoint_path(tmp_path).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(CheckpointMismatch, match="cannot be read"):
        read_checkpoint(tmp_path, "abc", ARRAYS)
