import os
import sys
import threading
import time
from pathlib import Path

import httpx
import pytest

from service.server import Service, ServiceConfig

ROOT = Path(__file__).parents[2]
COUNTING_WORKER = (sys.executable, "-m", "tests.service.counting_worker")


@pytest.fixture(scope="session", autouse=True)
def at_root():
    """Workers are started as modules of these tests, which are found from here."""
    before = Path.cwd()
    os.chdir(ROOT)
    yield
    os.chdir(before)


def wait_for(condition, patience=20.0):
    deadline = time.monotonic() + patience
    while not (value := condition()):
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)
    return value


def answers(url):
    try:
        return httpx.get(url + "/readyz", trust_env=False).is_success
    except httpx.TransportError:
        return False


def serving(data, **options):
    """Run a service in a thread, on any free port; a generator for fixtures."""
    service = Service(ServiceConfig(data, port=0, viewer_port=0, **options))
    thread = threading.Thread(target=service.run)
    thread.start()
    wait_for(lambda: answers(service.url))
    yield service
    service.stop()
    thread.join()


@pytest.fixture(scope="session")
def service(tmp_path_factory):
    """A service whose workers count instead of simulating, shared by all tests of the API."""
    yield from serving(tmp_path_factory.mktemp("data"), worker_command=COUNTING_WORKER, viewer=False, workers=2)


@pytest.fixture
def http(service):
    with httpx.Client(base_url=service.url, trust_env=False, timeout=20) as client:
        yield client
