"""A worker for tests of the supervisor: counts, with checkpoints, as its scene.json says; started like the real one.

`{"steps": 20, "seconds": 0.02, "does": "count" | "die" | "fail" | "break" | "ignore"}`; a real scene is counted to
20, or longer where the name says so.
"""

import argparse
import json
import os
import signal
import sys
import time
from pathlib import Path

from service.store import Store
from service.supervisor import EXIT_FAILED, EXIT_STOPPED
from service.tether import tether
from service.worker import hold


def main() -> None:
    parser = argparse.ArgumentParser()
    for name in ("--data", "--job"):
        parser.add_argument(name)
    for name in ("--fence", "--threads", "--parent"):
        parser.add_argument(name, type=int)
    arguments = parser.parse_args()
    tether(arguments.parent)
    directory = Path(arguments.data) / arguments.job
    scene = json.loads((directory / "scene.json").read_text())
    plan = {"steps": 2000 if scene.get("name") == "long" else 20, "seconds": 0.02, "does": "count"} | scene
    stop = []
    signal.signal(signal.SIGTERM, signal.SIG_IGN if plan["does"] == "ignore" else lambda *_: stop.append(True))
    store = Store(Path(arguments.data))
    hold(directory)
    checkpoint = directory / "checkpoint"
    step = int(checkpoint.read_text()) if checkpoint.exists() else 0
    with (directory / "attempts").open("a") as attempts:
        attempts.write(f"{os.getpid()} from {step}\n")
    while step < plan["steps"]:
        if plan["does"] == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if plan["does"] == "fail":
            sys.exit(print("the yarns are in a knot", file=sys.stderr) or EXIT_FAILED)
        if plan["does"] == "break":
            raise RuntimeError("a mistake of the programmer")
        if stop:
            sys.exit(EXIT_STOPPED)
        time.sleep(plan["seconds"])
        step += 1
        aside = directory / "checkpoint.aside"
        aside.write_text(str(step))
        aside.replace(checkpoint)
        store.report_progress(arguments.job, arguments.fence, {
            "time": step, "until": plan["steps"], "step": step, "frame": step, "dt": 1.0, "newton_iterations": 3,
            "residual": 1.23e-4, "contact_gap": 1e-4, "counts": {"lagrangian": 96, "eol_intra": 364, "eil": 40 + step},
            "s_per_step": plan["seconds"], "wall_s": step * plan["seconds"],
            "seconds_left": (plan["steps"] - step) * plan["seconds"]})


if __name__ == "__main__":
    main()
