"""A process that supervises a data directory with counting workers, for tests that kill it: `... DATA`."""

import sys
import threading
from pathlib import Path

from service.store import Store
from service.supervisor import Supervisor

if __name__ == "__main__":
    Supervisor(Store(Path(sys.argv[1])), command=(sys.executable, "-m", "tests.service.counting_worker")).start()
    threading.Event().wait()
