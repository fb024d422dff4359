"""The way of the peer Taichi: explicit MLS-MPM of a weakly compressible liquid, on a dense grid with all of u at its nodes.

Quadratic splines, affine velocities (Hu et al. 2018, "A moving least squares material point method"). It runs in a process of
its own: its threads and numba's would take each other's processors.
"""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from math import sqrt
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

import engine
from engine.arrays import Floats

NAME = "Taichi MLS-MPM"
MARGIN = 3  # cells around the liquid: walls, which splines reach
BULK_MODULUS, COURANT = 1e5, 0.2  # [Pa]; of sound
WARM_UP, TIMED = 3, 10  # steps


def installed() -> bool:
    """Return whether there is the peer."""
    return find_spec("taichi") is not None


def seconds_of_step(x: Floats, speed: float, spacing: float, density: float, bits: int, threads: int) -> float:
    """Return the median time [s] of a step of particles at x [P, 3] [m], 8 in a cell, that move along the first axis.

    `speed` is in m/s, `spacing` that of cells [m], `density` in kg/m^3, `bits` those of a number: 32 or 64. Raises
    subprocess.CalledProcessError where the peer fails.
    """
    with TemporaryDirectory() as directory:
        file = Path(directory) / "particles.npy"
        np.save(file, x)
        call = [str(file), *map(repr, (speed, spacing, density, bits, threads))]
        environment = dict(os.environ, PYTHONPATH=str(Path(engine.__path__[0]).parent))
        command = [sys.executable, "-m", __name__, *call]
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def timed(x: Floats, speed: float, spacing: float, density: float, bits: int, threads: int) -> float:
    """Return what `seconds_of_step` does, by steps in this process."""
    import taichi as ti

    real = ti.f32 if bits == 32 else ti.f64
    ti.init(arch=ti.cpu, default_fp=real, cpu_max_num_threads=threads, log_level=ti.ERROR)
    low = np.floor(x.min(axis=0) / spacing) - MARGIN
    cells = tuple(int(n) for n in np.ceil(x.max(axis=0) / spacing) - low + MARGIN)
    h = COURANT * spacing / (sqrt(BULK_MODULUS / density) + speed)
    gravity, volume = -9.81, spacing**3 / 8
    mass, across = density * volume, 1.0 / spacing

    place, velocity = ti.Vector.field(3, real, len(x)), ti.Vector.field(3, real, len(x))
    affine, swelling = ti.Matrix.field(3, 3, real, len(x)), ti.field(real, len(x))
    momentum, weight = ti.Vector.field(3, real, cells), ti.field(real, cells)
    place.from_numpy((x - spacing * low).astype(np.float32 if bits == 32 else np.float64))
    velocity.fill(ti.Vector([speed, 0.0, 0.0]))
    swelling.fill(1.0)

    @ti.func
    def splines(at):
        first = int(at - 0.5)
        f = at - first
        return first, ti.Matrix.rows([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2]), f

    @ti.kernel
    def clear():
        for i in ti.grouped(weight):
            momentum[i], weight[i] = ti.zero(momentum[i]), 0.0

    @ti.kernel
    def to_grid():
        for p in place:
            first, w, f = splines(place[p] * across)
            stress = -h * volume * 4.0 * across * across * BULK_MODULUS * (swelling[p] - 1.0)
            moment = mass * affine[p] + stress * ti.Matrix.identity(real, 3)
            for offset in ti.static(ti.grouped(ti.ndrange(3, 3, 3))):
                share = w[offset[0], 0] * w[offset[1], 1] * w[offset[2], 2]
                momentum[first + offset] += share * (mass * velocity[p] + moment @ ((offset - f) * spacing))
                weight[first + offset] += share * mass

    @ti.kernel
    def on_grid():
        for i in ti.grouped(weight):
            if weight[i] > 0.0:
                u = momentum[i] / weight[i]
                u[2] += h * gravity
                for k in ti.static(range(3)):
                    if i[k] < MARGIN:
                        u[k] = ti.max(u[k], 0.0)
                    if i[k] > cells[k] - MARGIN:
                        u[k] = ti.min(u[k], 0.0)
                momentum[i] = u

    @ti.kernel
    def to_particles():
        for p in place:
            first, w, f = splines(place[p] * across)
            u, gradient = ti.zero(velocity[p]), ti.zero(affine[p])
            for offset in ti.static(ti.grouped(ti.ndrange(3, 3, 3))):
                share = w[offset[0], 0] * w[offset[1], 1] * w[offset[2], 2]
                of_node = share * momentum[first + offset]
                u += of_node
                gradient += 4.0 * across * of_node.outer_product(offset - f)
            velocity[p], affine[p] = u, gradient
            place[p] += h * u
            swelling[p] *= 1.0 + h * gradient.trace()

    seconds = []
    for _ in range(WARM_UP + TIMED):
        began = perf_counter()
        clear()
        to_grid()
        on_grid()
        to_particles()
        ti.sync()
        seconds.append(perf_counter() - began)
    if not (np.isfinite(velocity.to_numpy()).all() and abs(velocity.to_numpy()[:, 0].mean() / speed - 1.0) < 0.1):
        raise ArithmeticError("the peer has lost its momentum")
    return median(seconds[WARM_UP:])


if __name__ == "__main__":
    print(json.dumps(timed(np.load(sys.argv[1]), *map(json.loads, sys.argv[2:]))))
