"""The service with its real workers: killed and resumed, the frames are those of a run that nobody disturbed."""

import json
import os
import random
import signal
import time

import httpx
import pytest

from engine.run.frames import frame_paths
from engine.scene.load import shipped_scenes
from tests.service.conftest import serving, wait_for

COMPILING = 300.0  # the first run after an edit compiles all kernels [s]


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    yield from serving(tmp_path_factory.mktemp("real"), viewer=False)


def submit(service, **changes):
    scene = {**json.loads(shipped_scenes()["crossing-sliders"].read_text()), **changes}
    answer = httpx.post(service.url + "/v1/jobs", json=scene, trust_env=False)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


def furthest(service, job):
    """Frames that any worker of the job is known to have written."""
    return (service.store.get(job).progress or {}).get("furthest", 0)


def test_a_worker_killed_ten_times_changes_no_bit_of_the_result(real):
    killed, undisturbed = (submit(real, duration=3.0, step={"default": 1e-4}) for _ in range(2))
    directory = real.store.directory(killed)
    chance = random.Random(7)
    reached = 0
    for _ in range(10):
        # each attempt gets a little further, so that none of the deaths counts as the job's own
        reached = wait_for(lambda reached=reached: (now := furthest(real, killed)) > reached and now, COMPILING)
        time.sleep(chance.uniform(0.0, 0.3))
        job = real.store.get(killed)
        assert job.state == "running", (job.reason, job.life, job.progress)
        worker = real.supervisor.running()[killed]
        os.kill(worker, signal.SIGKILL)
        wait_for(lambda worker=worker: real.supervisor.running().get(killed) != worker)
    for job in (killed, undisturbed):
        wait_for(lambda job=job: real.store.get(job).state.final, COMPILING)
        assert real.store.get(job).state == "succeeded", real.store.get(job).reason
    for one, other in zip(frame_paths(directory), frame_paths(real.store.directory(undisturbed)), strict=True):
        assert one.read_bytes() == other.read_bytes()
    report = httpx.get(f"{real.url}/v1/jobs/{killed}/report", trust_env=False).json()
    assert report["state"] == "succeeded" and report["time"]["simulated_s"] == 3.0


def test_a_real_run_is_cancelled_within_a_second_with_its_report(real):
    job = submit(real, duration=1000.0)
    wait_for(lambda: real.store.get(job).progress, COMPILING)
    answer = httpx.post(f"{real.url}/v1/jobs/{job}/cancel", trust_env=False)
    assert answer.json()["cancel_requested"]
    wait_for(lambda: real.store.get(job).state == "cancelled", 1.0)
    assert httpx.get(f"{real.url}/v1/jobs/{job}/report", trust_env=False).json()["state"] == "cancelled"


def test_a_simulation_that_fails_says_why(real):
    job = submit(real, step={"default": 1e-3, "min": 1e-3, "max_newton": 1, "tolerance": 1e-12})
    wait_for(lambda: real.store.get(job).state.final, COMPILING)
    found = real.store.get(job)
    assert found.state == "failed" and found.life.attempts == 1
    assert found.reason == httpx.get(f"{real.url}/v1/jobs/{job}/report", trust_env=False).json()["reason"]
