"""The command line, in this process where it needs no signals of its own."""

import json
import signal
import socket
import subprocess
import sys

import httpx
import pytest
from typer.testing import CliRunner

import engine.bench.suite
import engine.validate.catalogue
from engine.scene.load import load_scene, shipped_scenes
from engine.scene.size import estimate
from service.cli import main
from service.commands import serve
from service.wording import extent
from tests.service.conftest import wait_for

RUNNER = CliRunner()
QUICK = ["--set", "duration=0.1"]  # of crossing-sliders: a fraction of a second once its kernels are compiled


def strandline(*arguments):
    return RUNNER.invoke(main, [str(argument) for argument in arguments])


def process(*arguments, **options):
    return subprocess.Popen([sys.executable, "-m", "service.cli", *map(str, arguments)], text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)


def test_help_is_light():
    listing = "import sys, service.cli; print(*sys.modules)"
    modules = subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numpy", "numba", "scipy", "h5py", "viser", "rerun", "fastapi", "httpx", "pydantic"} & set(modules)


@pytest.mark.parametrize("command", ["run", "serve", "submit", "jobs", "show", "cancel", "fetch", "view", "picture",
                                     "demo", "validate", "bench", "schema", "scenes", "doctor"])
def test_every_command_explains_itself(command):
    answer = strandline(command, "--help")
    assert answer.exit_code == 0 and "Usage" in answer.output


# run


def test_a_run_ends_with_a_report(tmp_path):
    ended = process("run", "crossing-sliders", *QUICK, "--out", tmp_path / "out", "--json")
    report, messages = ended.communicate()
    assert ended.returncode == 0, messages
    assert json.loads(report)["state"] == "succeeded"
    assert json.loads(report) == json.loads((tmp_path / "out" / "report.json").read_text())
    assert "steps/s" in messages and "residual" in messages
    assert (tmp_path / "out" / "recording.rrd").stat().st_size > 0


def test_ctrl_c_leaves_a_checkpoint_that_resume_goes_on_from(tmp_path):
    out = tmp_path / "out"
    stopped = process("run", "crossing-sliders", "--set", "duration=100", "--out", out)
    wait_for(lambda: (out / "frames" / "000003.h5").exists(), 180)
    stopped.send_signal(signal.SIGINT)
    _, messages = stopped.communicate()
    assert stopped.returncode == 130 and f"--resume {out}" in messages
    reached = json.loads((out / "report.json").read_text())["time"]["simulated_s"]
    assert reached >= 0.1
    resumed = process("run", "--resume", out, "--until", reached + 0.05, "--json")
    report, messages = resumed.communicate()
    assert resumed.returncode == 0, messages
    assert json.loads(report)["time"]["simulated_s"] == pytest.approx(reached + 0.05)


def test_a_failed_simulation_is_exit_code_3(tmp_path):
    ended = process("run", "crossing-sliders", "--out", tmp_path / "out", "--set", "step.max_newton=1",
                    "--set", "step.default=1e-3", "--set", "step.min=1e-3", "--set", "step.tolerance=1e-12")
    _, messages = ended.communicate()
    assert ended.returncode == 3, messages
    assert "error:" in messages


@pytest.mark.parametrize(("arguments", "words"), [
    (["nowhere.json"], ["nowhere.json", "quickstart"]),
    (["quickstart", "--set", "colour=red"], ["colour", "unknown key"]),
    (["quickstart", "--set", "fabrics[0].spacing=-1"], ["fabrics[0].spacing", "allowed"]),
    (["quickstart", "--set", "duration"], ["duration", "key=value"]),
    (["--resume", "nowhere"], ["nowhere", "scene.json"]),
    ([], ["--resume"]),
])
def test_what_cannot_be_run_is_exit_code_2(arguments, words):
    answer = strandline("run", *arguments)
    assert answer.exit_code == 2
    assert all(word in answer.output for word in words), answer.output


# clients


@pytest.fixture
def server(service):
    return "--server", service.url


def test_a_client_submits_follows_lists_shows_and_fetches(server, tmp_path):
    answer = strandline("submit", "quickstart", "--follow", "--json", *server)
    assert answer.exit_code == 0, answer.output
    job = json.loads(answer.stdout)
    assert job["state"] == "succeeded"
    assert job["id"] in strandline("jobs", *server).output
    listed = json.loads(strandline("jobs", "--json", "--limit", 500, *server).stdout)
    assert job["id"] in {each["id"] for each in listed}
    assert "succeeded" in strandline("show", job["id"], *server).output
    assert strandline("fetch", job["id"], tmp_path, *server).exit_code == 0
    assert json.loads((tmp_path / "job.json").read_text())["id"] == job["id"]


def test_a_client_cancels(server, tmp_path):
    scene = {**json.loads(shipped_scenes()["quickstart"].read_text()), "name": "long"}
    (tmp_path / "long.json").write_text(json.dumps(scene))
    job = strandline("submit", tmp_path / "long.json", *server).output.split()[0]
    assert strandline("cancel", job, *server).exit_code == 0
    wait_for(lambda: json.loads(strandline("show", job, "--json", *server).stdout)["state"] == "cancelled")


def test_a_client_passes_on_what_is_wrong(server, tmp_path):
    bad = tmp_path / "bad.json"
    bad.write_text('{"strandline": 1, "colour": 1}')
    answer = strandline("submit", bad, *server)
    assert answer.exit_code == 2 and "colour: unknown key" in answer.output
    answer = strandline("show", "nothing", *server)
    assert answer.exit_code == 1 and "nothing" in answer.output
    answer = strandline("jobs", "--state", "asleep", *server)
    assert answer.exit_code == 2 and "queued" in answer.output
    answer = strandline("jobs", "--server", "http://127.0.0.1:9")
    assert answer.exit_code == 1 and "strandline serve" in answer.output


# servers


def test_a_port_in_use_is_named():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        answer = strandline("serve", "--port", port)
    assert answer.exit_code == 1
    assert str(port) in answer.output and "--port" in answer.output


def test_an_open_address_needs_a_token(monkeypatch):
    monkeypatch.delenv("STRANDLINE_TOKEN", raising=False)
    answer = strandline("serve", "--host", "0.0.0.0", "--port", 0)
    assert answer.exit_code == 1 and "STRANDLINE_TOKEN" in answer.output


def test_the_demo_runs_its_scene_to_the_end(tmp_path, monkeypatch):
    scene = {**json.loads(shipped_scenes()["crossing-sliders"].read_text()), "duration": 0.1}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    monkeypatch.setattr(serve, "DEMO_SCENE", str(tmp_path / "scene.json"))
    answer = strandline("demo", "--no-open", "--exit-when-done", "--data", tmp_path / "data")
    assert answer.exit_code == 0, answer.output
    assert "http://127.0.0.1:" in answer.output and "recording.rrd" in answer.output and "report.json" in answer.output
    job = next((tmp_path / "data").glob("2*"))
    assert json.loads((job / "job.json").read_text())["state"] == "succeeded"
    assert (job / "recording.rrd").stat().st_size > 0


def test_view_serves_one_job(tmp_path):
    (tmp_path / "job").mkdir()
    (tmp_path / "job" / "scene.json").write_bytes(shipped_scenes()["crossing-sliders"].read_bytes())
    viewing = process("view", tmp_path / "job", "--no-open", "--viewer-port", 0)
    try:
        url = viewing.stdout.readline().strip()
        assert url.endswith("/?job=job")
        assert httpx.get(url, trust_env=False, follow_redirects=True).is_success
    finally:
        viewing.send_signal(signal.SIGINT)
        viewing.communicate(timeout=20)
    assert viewing.returncode == 0
    assert strandline("view", "nowhere").exit_code == 2


# checks and information

CASE = {"id": "eol-made-up", "error": 1e-3, "bar": 1e-2, "order": 1.9, "order_bar": 1.8, "note": "",
        "summary": "made up", "rows": [{"knob": "dt", "value": 1e-3, "error": 1e-3, "seconds": 0.1}]}


@pytest.mark.parametrize(("status", "code"), [("pass", 0), ("fail", 3)])
def test_validate_tells_by_its_exit_code(monkeypatch, tmp_path, status, code):
    result = {"cases": [{**CASE, "status": status}], "machine": {}}
    monkeypatch.setattr(engine.validate.catalogue, "run", lambda *_, **__: result)
    answer = strandline("validate", "--json", "--quick")
    assert answer.exit_code == code and json.loads(answer.stdout) == result
    table = strandline("validate")
    assert table.exit_code == code and "eol-made-up" in table.output and status in table.output


def test_an_unknown_case_or_benchmark_is_named():
    for command in ("validate", "bench"):
        answer = strandline(command, "nothing")
        assert answer.exit_code == 2 and "nothing" in answer.output


def test_bench_prints_its_rows(monkeypatch):
    row = {"case": "patch", "size": 1000.0, "seconds": 0.1, "throughput": 1e4, "unit": "crossings/s", "error": None,
           "bandwidth_share": 0.3, "peer": None, "peer_seconds": None, "ratio": None, "standing": None,
           "converging": False, "details": {}}
    results = [{"name": "yarns", "summary": "made up", "machine": {}, "rows": [row], "exponent": 1.02, "note": ""}]
    monkeypatch.setattr(engine.bench.suite, "run", lambda *_, **__: results)
    assert json.loads(strandline("bench", "--json").stdout) == results
    shown = strandline("bench").output
    assert "1.02" in shown and "patch" in shown and "30 %" in shown
    assert not any(column in shown for column in ("peer", "ratio", "error", "front"))  # which say nothing of any row
    row |= {"error": 0.025, "standing": {"on_front": True, "default": True}}
    shown = strandline("bench").output
    assert "0.025" in shown and "default, on it" in shown
    results[0] |= {"rows": [], "note": "ended by MemoryError"}
    assert "ended by MemoryError" in strandline("bench").output


def test_information():
    assert "duration" in json.loads(strandline("schema").stdout)["properties"]
    assert set(json.loads(strandline("scenes", "--json").stdout)) == set(shipped_scenes())
    table = strandline("scenes").output
    assert "tablecloth-small-friction" in table, "names are whole"
    for name in ("strand-over-cylinder", "film-incline-newtonian"):
        row = next(line for line in table.splitlines() if line.startswith(name))
        assert extent(vars(estimate(load_scene(shipped_scenes()[name])))) in row
    assert strandline("scenes", "quickstart").stdout == shipped_scenes()["quickstart"].read_text()
    assert strandline("scenes", "nothing").exit_code == 2
    findings = json.loads(strandline("doctor", "--json").stdout)
    assert findings["versions"]["numba"] != "missing" and findings["disk"]["free_bytes"] > 0
    assert "compiled kernels" in strandline("doctor").output
