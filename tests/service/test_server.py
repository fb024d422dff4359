"""The service as a process: ended in good order, killed, and in competition for its port."""

import json
import signal
import socket
import subprocess
import sys
import time

import httpx
import pytest

from engine.scene.load import shipped_scenes
from service.kept import KeptProcess
from service.lifecycle import JobState
from service.server import CannotServe, Service, ServiceConfig
from service.store import Store
from tests.service.conftest import answers, wait_for

SCENE = shipped_scenes()["quickstart"]


@pytest.fixture
def serve(tmp_path):
    processes = []

    def start():
        with socket.create_server(("127.0.0.1", 0)) as probe:
            port = probe.getsockname()[1]
        processes.append(subprocess.Popen([sys.executable, "-m", "tests.service.serving", str(tmp_path), str(port)]))
        url = f"http://127.0.0.1:{port}"
        wait_for(lambda: answers(url))
        return processes[-1], url

    yield start
    for process in processes:
        process.kill()
        process.wait()


def long_job(url):
    scene = {**json.loads(SCENE.read_text()), "name": "long"}
    job = httpx.post(url + "/v1/jobs", json=scene, trust_env=False).json()["id"]
    wait_for(lambda: httpx.get(f"{url}/v1/jobs/{job}", trust_env=False).json().get("progress", {}).get("step", 0) > 3)
    return job


def steps_at_start(store, job):
    return [int(line.split(" from ")[1]) for line in (store.directory(job) / "attempts").read_text().splitlines()]


def test_an_ended_service_gives_its_jobs_back_and_goes_on(serve, tmp_path):
    process, url = serve()
    job = long_job(url)
    with httpx.stream("GET", f"{url}/v1/jobs/{job}/events", trust_env=False) as followed:
        asked = time.monotonic()
        process.send_signal(signal.SIGTERM)
        followed.read()  # the stream is closed, so that it keeps nobody waiting
    process.wait(10)
    assert time.monotonic() - asked < 3
    store = Store(tmp_path)
    assert store.get(job).state == JobState.QUEUED and store.get(job).life.attempts == 0
    serve()
    wait_for(lambda: len(steps_at_start(store, job)) == 2)
    assert steps_at_start(store, job)[1] > 3


def test_a_killed_service_goes_on_when_it_is_started_again(serve, tmp_path):
    process, url = serve()
    job = long_job(url)
    process.kill()
    process.wait()
    serve()
    store = Store(tmp_path)
    wait_for(lambda: len(steps_at_start(store, job)) == 2)
    assert steps_at_start(store, job)[1] > 3
    assert store.get(job).state == JobState.RUNNING and store.get(job).life.attempts == 2


def test_a_port_in_use_is_named(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(CannotServe, match=f"port {port} .*--port"):
            Service(ServiceConfig(tmp_path, port=port))
        with pytest.raises(CannotServe, match=f"port {port} .*--viewer-port"):
            Service(ServiceConfig(tmp_path, port=0, viewer_port=port))


def test_a_data_directory_that_is_a_file_is_named(tmp_path):
    (tmp_path / "data").write_text("")
    with pytest.raises(CannotServe, match="data"):
        Service(ServiceConfig(tmp_path / "data", port=0, viewer=False))


def test_a_helper_that_dies_is_started_again(tmp_path):
    kept = KeptProcess("helper", [sys.executable, "-c", "import time; time.sleep(60)"], tmp_path / "log")
    kept.start()
    first = wait_for(lambda: kept.pid)
    subprocess.run(["kill", "-9", str(first)], check=True)
    second = wait_for(lambda: kept.pid not in (None, first) and kept.pid)
    kept.close()
    assert subprocess.run(["kill", "-0", str(second)], stderr=subprocess.DEVNULL).returncode != 0
