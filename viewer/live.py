"""The live 3D page: `python -m viewer.live --data DIR --port P`.

Open `http://HOST:P/?job=ID` for one job, or without the query for the newest.
"""

import argparse
import signal
from pathlib import Path

from engine.run.compile_cache import prepare_compile_cache


def main(arguments: list[str] | None = None) -> None:
    """Serve the page until interrupted or terminated."""
    parser = argparse.ArgumentParser(prog="viewer.live", description="3D page on the jobs in a directory")
    parser.add_argument("--data", type=Path, required=True, help="directory of job directories")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on; any but the local one needs a token")
    parser.add_argument("--port", type=int, default=8081)
    parser.add_argument("--token", help="visitors must bring it once as ?token=...")
    options = parser.parse_args(arguments)
    prepare_compile_cache()
    from viewer.server import LiveViewer  # imports numba, so only after the line above

    try:
        viewer = LiveViewer(options.data, options.host, options.port, options.token)
    except ValueError as problem:
        parser.error(str(problem))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: viewer.stop())
    print(f"viewer: http://{options.host}:{viewer.port}/", flush=True)
    viewer.wait()


if __name__ == "__main__":
    main()
