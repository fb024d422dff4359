"""Kills: of workers, of supervisors, by users. The workers count instead of simulating (`counting_worker`)."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from service.lifecycle import JobState
from service.store import Store
from service.supervisor import Supervisor
from tests.service.conftest import COUNTING_WORKER, wait_for


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path)


@pytest.fixture
def supervisor(store):
    started = []

    def start(**options):
        started.append(Supervisor(store, command=COUNTING_WORKER, **options))
        started[-1].start()
        return started[-1]

    yield start
    for each in started:
        each.close()


def submit(store, does="count", steps=20, seconds=0.02):
    return store.submit("scene", json.dumps({"does": does, "steps": steps, "seconds": seconds}), {})[0].id


def wait_for_state(store, job, state, patience=20.0):
    wait_for(lambda: store.get(job).state == state, patience)


def wait_for_step(store, job, step):
    wait_for(lambda: (store.get(job).progress or {}).get("step", 0) >= step)


def attempts(store, job):
    path = store.directory(job) / "attempts"
    return [line.split(" from ") for line in path.read_text().splitlines()] if path.exists() else []


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "Z" not in Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0]


def test_a_job_runs_to_its_end(store, supervisor):
    job = submit(store)
    supervisor()
    wait_for_state(store, job, JobState.SUCCEEDED)
    assert store.get(job).progress["step"] == 20
    assert json.loads((store.directory(job) / "job.json").read_text())["state"] == "succeeded"


def test_a_killed_worker_is_resumed_from_its_checkpoint(store, supervisor):
    job = submit(store, steps=60)
    running = supervisor()
    wait_for_step(store, job, 10)
    os.kill(running.running()[job], signal.SIGKILL)
    wait_for_state(store, job, JobState.SUCCEEDED)
    starts = [int(step) for _, step in attempts(store, job)]
    assert len(starts) == 2 and starts[0] == 0 and starts[1] >= 10
    assert store.get(job).life.attempts == 1, "the second got further, so the first death does not count"


def test_a_poison_job_fails_and_the_next_one_runs(store, supervisor):
    poison, good = submit(store, "die"), submit(store, steps=1)
    supervisor()
    wait_for_state(store, good, JobState.SUCCEEDED)
    failed = store.get(poison)
    assert failed.state == JobState.FAILED and failed.life.attempts == 3 and len(attempts(store, poison)) == 3
    assert "SIGKILL" in failed.reason


def test_a_failed_simulation_is_not_tried_again(store, supervisor):
    job = submit(store, "fail")
    supervisor()
    wait_for_state(store, job, JobState.FAILED)
    assert store.get(job).reason == "the yarns are in a knot"
    assert len(attempts(store, job)) == 1


def test_a_crash_is_tried_again_and_its_words_are_kept(store, supervisor):
    job = submit(store, "break")
    supervisor()
    wait_for_state(store, job, JobState.FAILED)
    assert "RuntimeError: a mistake of the programmer" in store.get(job).reason
    assert len(attempts(store, job)) == 3


@pytest.mark.parametrize("does", ["count", "ignore"])
def test_a_running_job_is_cancelled_within_a_second(store, supervisor, does):
    job = submit(store, does, steps=10_000)
    running = supervisor()
    wait_for_step(store, job, 2)
    pid = running.running()[job]
    asked = time.monotonic()
    store.cancel(job)
    wait_for_state(store, job, JobState.CANCELLED)
    assert time.monotonic() - asked < 1.0
    assert not alive(pid)


def test_closing_gives_jobs_back_unharmed(store, supervisor):
    job = submit(store, steps=10_000)
    running = supervisor()
    wait_for_step(store, job, 3)
    running.close()
    assert store.get(job).state == JobState.QUEUED and store.get(job).life.attempts == 0
    supervisor()
    wait_for(lambda: len(attempts(store, job)) == 2)
    assert int(attempts(store, job)[1][1]) >= 3


def test_a_killed_supervisor_takes_its_worker_along_and_another_continues(store, supervisor):
    job = submit(store, steps=100)
    first = subprocess.Popen([sys.executable, "-m", "tests.service.supervising", str(store.data)])
    wait_for_step(store, job, 5)
    worker = int(attempts(store, job)[0][0])
    first.kill()
    first.wait()
    wait_for(lambda: not alive(worker), 2.0)
    assert store.get(job).state == JobState.RUNNING  # nobody has noticed yet
    supervisor()
    wait_for_state(store, job, JobState.SUCCEEDED)
    starts = [int(step) for _, step in attempts(store, job)]
    assert len(starts) == 2 and starts[1] >= 5


def test_no_more_jobs_than_workers(store, supervisor):
    jobs = [submit(store, steps=15) for _ in range(4)]
    running = supervisor(workers=2)
    most = 0
    while any(not store.get(job).state.final for job in jobs):
        most = max(most, len(running.running()))
        time.sleep(0.01)
    assert most == 2
    assert all(store.get(job).state == JobState.SUCCEEDED for job in jobs)
