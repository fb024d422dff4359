"""Compiling on a second processor: a process that begins with what the end of a first step needs.

The run compiles its kernels in the order in which it calls them; this process goes the other way round, and what either has
compiled the other finds in the cache. They meet about half-way.
"""

import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike

from engine.run.compile_cache import prepare_compile_cache

if TYPE_CHECKING:
    from engine.scene.schema import Scene

SCENE = "quickstart"  # has yarns that slide on each other and on obstacles, and is small


def compile_ahead(scene: "Scene", threads: int | None = None) -> subprocess.Popen | None:
    """Start the process for a run of `scene` if the compile cache has no kernel yet, and return it without waiting.

    There is none for strands, whose kernels it does not know, and where the run may use but one of `threads`, or there is one
    processor. It ends by itself after half a minute.
    All that it can lose is time, so what becomes of it does not matter to the run. To be called after
    `prepare_compile_cache` and before anything is compiled.
    """
    if scene.strands:
        return None
    from engine.run.threads import available_threads

    if (threads or available_threads()) == 1 or any(prepare_compile_cache().rglob("*.nbi")):
        return None
    return subprocess.Popen([sys.executable, "-m", __name__, _what_moves(scene)],
                            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _what_moves(scene: "Scene") -> str:
    """Return what the process is told: the kind of a liquid and whether it sticks, of yarns the precision of their system."""
    if scene.liquid is not None:
        from engine.scene.liquid_materials import known_liquids, sticks

        material = known_liquids(scene.liquid_materials)[scene.liquid.material]
        kind = "newtonian" if material.shear_modulus is None else "elastic"
        return f"{kind} no-slip" if sticks(material, scene.liquid.walls) else f"{kind} slip"
    from engine.scene.size import estimate
    from engine.steppers.newton_system import precision

    return precision(estimate(scene).points).__name__


def linear_algebra(precision: DTypeLike) -> None:
    """Solve a linear system of two block rows, with all that the yarns' solver does to one."""
    from engine.linalg.block_matrix import BLOCK, with_pattern
    from engine.linalg.conjugate_gradient import conjugate_gradient
    from engine.linalg.incomplete_cholesky import factorise, incomplete_cholesky

    matrix, _ = with_pattern(2, np.array([[0, 1]]), precision)
    matrix.block[matrix.diagonal] = np.eye(BLOCK)
    factor = incomplete_cholesky(matrix)
    factorise(factor)
    matrix.block[matrix.diagonal] = np.diag(np.arange(1.0, BLOCK + 1))  # another than was factorised, or it would end at once
    load = np.ones((2, BLOCK))
    conjugate_gradient(matrix, load, np.empty_like(load), factor, 1e-6, 2)


def system_of_a_step(precision: DTypeLike) -> None:
    """Put together the linear system of the first step of a small scene."""
    from engine.contact.obstacles import motion
    from engine.run.yarns import YarnsInMotion
    from engine.scene.load import load_scene, shipped_scenes
    from engine.steppers.incremental_potential import IncrementalPotential

    scene = load_scene(shipped_scenes()[SCENE])
    yarns = YarnsInMotion(scene)
    stepper, state, h = yarns.stepper, yarns.state, scene.step.default
    chain = stepper.assign_nodes(state, h, state.u_rate)
    obstacles = motion(stepper.obstacles, stepper.handles, 0.0, h)
    potential = IncrementalPotential(stepper.model, stepper.settings, stepper.gravity, obstacles, state, chain, h)
    layout = potential.lay_out(precision)
    potential.hessian(state.x, state.u, np.zeros(stepper.model.point_count, np.bool_), layout)


if __name__ == "__main__":
    prepare_compile_cache()
    kind, _, walls = sys.argv[1].partition(" ")
    if walls:
        from engine.run.compile_liquid import rest_of_a_step

        rest_of_a_step(kind == "elastic", walls == "no-slip")
    else:
        linear_algebra(sys.argv[1])
        system_of_a_step(sys.argv[1])
