"""Compiling ahead prepares the kernels that a run calls, and no others."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from engine.run.compile_ahead import SCENE, linear_algebra, system_of_a_step
from engine.run.yarns import YarnsInMotion
from engine.scene.load import load_scene, shipped_scenes

STARTS = """
from engine.run.compile_cache import prepare_compile_cache
cache = prepare_compile_cache()
from engine.run.compile_ahead import SCENE, compile_ahead
from engine.scene.load import load_scene, shipped_scenes
scene = load_scene(shipped_scenes()[SCENE])
process = compile_ahead(scene)
process.kill()
print("started", process.args[-1])
process.wait()
(cache / "kernel.nbi").touch()
print("started" if compile_ahead(scene) else "not needed")
"""


def signatures() -> dict[str, list]:
    """Return what every kernel that is imported has been compiled for."""
    modules = [import_module(name) for name in sorted(sys.modules) if name.startswith("engine.")]
    kernels = {(module.__name__, name): kernel for module in modules for name, kernel in vars(module).items()
               if isinstance(kernel, Dispatcher)}
    return {".".join(key): list(kernel.signatures) for key, kernel in kernels.items()}


@pytest.mark.parametrize("ahead", [linear_algebra, system_of_a_step])
def test_what_is_compiled_ahead_is_what_a_run_calls(ahead):
    yarns = YarnsInMotion(load_scene(shipped_scenes()[SCENE]))
    assert yarns.step(0.0, 0.001).accepted
    before = signatures()
    ahead(np.float64)
    assert signatures() == before


@pytest.mark.skipif(len(os.sched_getaffinity(0)) == 1, reason="there is no second processor")
def test_the_process_is_started_for_an_empty_cache_only(tmp_path: Path):
    ran = subprocess.run([sys.executable, "-c", STARTS], capture_output=True, text=True, timeout=120,
                         env={**os.environ, "STRANDLINE_CACHE_DIR": str(tmp_path)}, check=True)
    assert ran.stdout.split("\n")[:2] == ["started float64", "not needed"]
