"""Compiling ahead prepares the kernels that a run calls, and no others."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

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
print("not wanted" if compile_ahead(scene, threads=1) is None else "started")
strand = {"name": "one", "material": "nylon", "curves": [[[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]]]}
nylon = {"radius": 1e-3, "volume_density": 1150.0, "youngs_modulus": 2e9}
strands = {"strandline": 1, "name": "one strand", "duration": 0.1, "materials": {"nylon": nylon}, "strands": [strand]}
print("not for strands" if compile_ahead(load_scene(strands)) is None else "started")
(cache / "kernel.nbi").touch()
print("started" if compile_ahead(scene) else "not needed")
"""


COMPILED = """
import json, sys
from engine.run.compile_cache import prepare_compile_cache
prepare_compile_cache()
{work}
from numba.core.dispatcher import Dispatcher
modules = [module for name, module in list(sys.modules.items()) if name.startswith("engine.")]
print(json.dumps(sorted({{
    f"{{kernel.py_func.__module__}}.{{kernel.py_func.__name__}} {{signature}}"
    for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)
    for signature in kernel.signatures
}})))
"""
A_STEP = """
from engine.run.compile_ahead import SCENE
from engine.run.yarns import YarnsInMotion
from engine.scene.load import load_scene, shipped_scenes
assert YarnsInMotion(load_scene(shipped_scenes()[SCENE])).step(0.0, 0.001).accepted
"""


def compiled(work: str) -> set[str]:
    """Return the kernels of the engine that `work` calls in a process of its own, with what they are compiled for."""
    ran = subprocess.run([sys.executable, "-c", COMPILED.format(work=work)], capture_output=True, text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr
    return set(json.loads(ran.stdout))


def test_what_is_compiled_ahead_is_what_a_step_calls():
    step = compiled(A_STEP)
    algebra = compiled("from engine.run.compile_ahead import linear_algebra; linear_algebra('float64')")
    system = compiled("from engine.run.compile_ahead import system_of_a_step; system_of_a_step('float64')")
    assert algebra <= step and system <= step
    names = {kernel.split()[0] for kernel in algebra | system}
    assert {"engine.linalg.conjugate_gradient.turn", "engine.linalg.incomplete_cholesky._solve",
            "engine.yarns.contact.add_hessian_in_parts", "engine.yarns.internal.hessian"} <= names


@pytest.mark.parametrize(("scene", "elastic", "walls"), [
    ("film-incline-newtonian", False, "slip"), ("film-incline-newtonian", False, "no-slip"),
    ("oyster-sauce-column", True, "no-slip"),
])
def test_what_is_compiled_ahead_for_liquids_is_what_a_step_calls(scene: str, elastic: bool, walls: str):
    step = compiled(f"""
from engine.run.liquid import LiquidInMotion
from engine.scene.load import load_scene, shipped_scenes
assert LiquidInMotion(load_scene(shipped_scenes()["{scene}"], ["liquid.walls={walls}"])).step(0.0, 1e-4).accepted
""")
    ahead = compiled(f"from engine.run.compile_liquid import rest_of_a_step; rest_of_a_step({elastic}, {walls == 'no-slip'})")
    assert ahead <= step and len(ahead) > len(step) / 3


@pytest.mark.skipif(len(os.sched_getaffinity(0)) == 1, reason="there is no second processor")
def test_the_process_is_started_for_an_empty_cache_only(tmp_path: Path):
    ran = subprocess.run([sys.executable, "-c", STARTS], capture_output=True, text=True, timeout=120,
                         env={**os.environ, "STRANDLINE_CACHE_DIR": str(tmp_path)}, check=True)
    assert ran.stdout.split("\n")[:4] == ["started float64", "not wanted", "not for strands", "not needed"]
