import os
import signal
import subprocess
import sys
import warnings
from collections import Counter
from pathlib import Path

from rerun.chunk import RrdReader

from engine.run.frames import Frame
from engine.scene.load import load_scene
from tests.viewer import liquids, strands, synthetic
from viewer.recording import Recorder, recording_parts

# a run that is killed without warning in the middle of a frame that it has not flushed
KILLED = """
import os, signal, sys
from pathlib import Path
from engine.run.compile_cache import prepare_compile_cache
prepare_compile_cache()
from tests.viewer import synthetic
from viewer.recording import Recorder

recorder = Recorder(synthetic.scene(), Path(sys.argv[1]))
for index in range(int(sys.argv[2]), int(sys.argv[3])):
    recorder.log(synthetic.frame(index))
recorder._stream.flush = lambda: os.kill(os.getpid(), signal.SIGKILL)
recorder.log(synthetic.frame(index + 1))
"""

# a disk that is full after 300 kB
FULL = """
import resource, signal, sys
from pathlib import Path
from engine.run.compile_cache import prepare_compile_cache
prepare_compile_cache()
from tests.viewer import synthetic
from viewer.recording import Recorder

frames = [synthetic.frame(index) for index in range(8)]
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, resource.RLIM_INFINITY))
recorder = Recorder(synthetic.scene(), Path(sys.argv[1]))
for frame in frames:
    recorder.log(frame)
recorder.close()
print("the run goes on")
"""


def script(source: str, *arguments: object) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", source, *map(str, arguments)], capture_output=True, text=True)


def rows(path: Path) -> Counter:
    """Rows of data for each entity."""
    counted: Counter = Counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Rerun warns of a file without footer, which is what a killed run leaves
        for chunk in RrdReader(path).stream():
            counted[str(chunk.entity_path)] += chunk.num_rows
    return counted


def record(directory: Path, indices: range) -> None:
    recorder = Recorder(synthetic.scene(), directory)
    for index in indices:
        recorder.log(synthetic.frame(index))
    recorder.close()


def test_a_recording_holds_every_layer_of_every_frame(tmp_path):
    record(tmp_path, range(4))
    counted = rows(tmp_path / "recording.rrd")
    assert counted["/nodes/points"] == 4
    for entity in ("/cloth/yarns", "/nodes/lines"):
        assert counted[entity] == 4 + 1, "and one row of colours, static"
    for obstacle in range(3):
        assert counted[f"/obstacles/{obstacle}"] == 1
    for key in ("residual", "newton_iterations", "eil", "kinetic_energy"):
        assert counted[f"/series/{key}"] == 4
    reader = RrdReader(tmp_path / "recording.rrd")
    assert len(reader.recordings()) == 1 and len(reader.blueprints()) == 1


def test_a_recording_of_strands_has_them_by_group_and_in_every_paint(tmp_path):
    recorder = Recorder(strands.scene(), tmp_path)
    for index in range(4):
        recorder.log(strands.frame(index))
    recorder.close()
    counted = rows(tmp_path / "recording.rrd")
    assert counted["/strands"] == 4 + 1, "and one row of colours, static"
    for entity in ("painted/strain", "painted/curvature", "painted/force", "key", "series/contacts"):
        assert counted[f"/{entity}"] == 4
    assert counted["/obstacles/0"] == 1
    assert not any(name.startswith(("/cloth", "/nodes")) for name in counted)
    assert len(RrdReader(tmp_path / "recording.rrd").blueprints()) == 1


def record_liquid(directory: Path, surfaced: bool) -> Counter:
    recorder = Recorder(load_scene(liquids.SCENE), directory)
    for index in range(3):
        recorder.log(liquids.frame(index, surfaced))
    recorder.close()
    assert len(RrdReader(directory / "recording.rrd").blueprints()) == 1
    return rows(directory / "recording.rrd")


def test_a_recording_of_liquid_has_it_in_every_paint_and_its_surface(tmp_path):
    for surfaced in (False, True):
        (tmp_path / str(surfaced)).mkdir()
        counted = record_liquid(tmp_path / str(surfaced), surfaced)
        for entity in ("liquid", "painted/speed", "painted/pressure", "painted/shear", "painted/yielded", "key",
                       "series/particles"):  # fmt: skip
            assert counted[f"/{entity}"] == 3
        assert counted["/surface"] == (3 if surfaced else 0)
        assert not any(name.startswith(("/cloth", "/nodes", "/strands")) for name in counted)


def test_much_recorded_liquid_is_as_large_as_it_may_be(tmp_path):
    recorder = Recorder(load_scene(liquids.SCENE), tmp_path)
    recorder.log(Frame(0, 0.0, 0, liquid=liquids.large()))
    recorder.close()
    assert (tmp_path / "recording.rrd").stat().st_size < 2.5e6


def test_a_body_that_changes_is_recorded_in_every_frame(tmp_path):
    recorder = Recorder(load_scene(strands.on_a_swelling_ball()), tmp_path)
    for index in range(4):
        recorder.log(strands.frame(index))
    recorder.close()
    assert rows(tmp_path / "recording.rrd")["/obstacles/0"] == 4 + 1, "and one row of triangles, static"


def test_a_recorded_head_of_hair_is_as_large_as_it_may_be(tmp_path):
    recorder = Recorder(strands.scene(), tmp_path)
    recorder.log(Frame(0, 0.0, 0, strands=strands.large()))
    recorder.close()
    assert (tmp_path / "recording.rrd").stat().st_size < 3e6


def test_a_killed_run_leaves_all_flushed_frames(tmp_path):
    killed = script(KILLED, tmp_path, 0, 5)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert rows(tmp_path / "recording.rrd")["/nodes/points"] >= 5


def test_a_resumed_run_joins_what_a_killed_one_left(tmp_path):
    record(tmp_path, range(4))
    killed = script(KILLED, tmp_path, 2, 6)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    path = tmp_path / "recording.rrd"
    assert len(recording_parts(path)) == 2
    os.truncate(path, path.stat().st_size - 50)  # as if the kill had torn the last write
    record(tmp_path, range(5, 8))
    assert recording_parts(path) == [path] and list(tmp_path.iterdir()) == [path]
    counted = rows(path)
    assert counted["/nodes/points"] >= 3 + 4 + 3
    reader = RrdReader(path)
    assert len(reader.recordings()) == 1 and len(reader.blueprints()) >= 1


def test_a_run_from_the_start_records_anew(tmp_path):
    record(tmp_path, range(4))
    record(tmp_path, range(2))
    assert rows(tmp_path / "recording.rrd")["/nodes/points"] == 2


def test_a_carried_obstacle_is_recorded_where_it_is(tmp_path):
    ball, others = synthetic.SCENE["obstacles"][1] | {"handle": "lift"}, synthetic.SCENE["obstacles"][:1]
    keyframes = [{"time": 0, "offset": [0, 0, 0]}, {"time": 1, "offset": [0, 0, 0.1]}]
    scene = load_scene(synthetic.SCENE | {
        "obstacles": [*others, ball], "script": {"handles": [{"name": "lift", "keyframes": keyframes}]}})
    recorder = Recorder(scene, tmp_path)
    for index in range(3):
        recorder.log(synthetic.frame(index))
    recorder.close()
    counted = rows(tmp_path / "recording.rrd")
    assert counted["/obstacles/0"] == 1 and counted["/obstacles/1"] == 1 + 3


def test_a_full_disk_ends_the_recording_but_not_the_run(tmp_path):
    run = script(FULL, tmp_path)
    assert run.returncode == 0, run.stderr
    assert "the run goes on" in run.stdout
    assert "recording stops at frame" in run.stderr and "File too large" in run.stderr
    assert rows(tmp_path / "recording.rrd")["/nodes/points"] >= 1, "what was recorded before stays readable"


def test_nothing_recorded_leaves_nothing(tmp_path):
    Recorder(synthetic.scene(), tmp_path).close()
    assert list(tmp_path.iterdir()) == []


def test_parts_are_joined_in_the_order_of_writing(tmp_path):
    ordered = ["recording.rrd", "recording.1.rrd", "recording.2.rrd", "recording.10.rrd"]
    for name in reversed(ordered):
        (tmp_path / name).touch()
    assert [part.name for part in recording_parts(tmp_path / "recording.rrd")] == ordered
