"""A process that serves a data directory with counting workers, for tests that end it: `... DATA PORT`."""

import sys
from pathlib import Path

from service.server import Service, ServiceConfig
from tests.service.conftest import COUNTING_WORKER

if __name__ == "__main__":
    Service(ServiceConfig(Path(sys.argv[1]), port=int(sys.argv[2]), viewer=False, worker_command=COUNTING_WORKER)).run()
