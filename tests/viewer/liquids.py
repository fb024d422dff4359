"""Liquid made up by formula: a job directory of a basin with a standing wave and drops above it, with and without a surface."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from engine.liquid.surface_mesh import surface
from engine.run.frames import Frame, LiquidFrame
from tests.viewer import jobs

SPACING = 0.015  # of particles
LENGTH, WIDTH, DEPTH = 0.6, 0.3, 0.12
YIELD = 400.0  # [Pa]

# The scene has a strand only, for none of the particles is read there.
SCENE = {
    "strandline": 1,
    "name": "a basin by formula",
    "duration": 0.3,
    "materials": {"nylon": {"radius": 6e-4, "volume_density": 1150.0, "youngs_modulus": 2e9}},
    "strands": [{"name": "one", "material": "nylon", "curves": [[[0, 0, 0.1], [0, 0, 0.05], [0, 0, 0]]]}],
    "obstacles": [
        {"shape": "sphere", "radius": 0.06, "position": [0.1, 0.15, 0.16]},
        {"shape": "plane", "position": [0, 0, 0]},
    ],
}


def basin(wave: float, spacing: float = SPACING, surfaced: bool = False) -> LiquidFrame:
    """Return a basin with a wave of height `wave` [m], and a drop of one particle above it."""
    sides = [np.arange(spacing / 2, side, spacing) for side in (LENGTH, WIDTH, DEPTH)]
    rest = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    phase = np.pi * rest[:, 0] / LENGTH
    x = rest + np.array((0.0, 0.0, 1.0)) * (wave * np.cos(phase) * rest[:, 2] / DEPTH)[:, None]
    x = np.concatenate([x, [[LENGTH / 2, WIDTH / 2, 2.5 * DEPTH]]])
    top = np.append(DEPTH + wave * np.cos(phase), x[-1, 2])
    pressure = 9810.0 * (top - x[:, 2]) - 50.0
    shear = 3e3 * np.append(np.abs(np.sin(phase)) * wave / DEPTH, 0.0)
    volume = np.full(len(x), spacing**3)
    vertices, faces = surface(x, volume) if surfaced else (np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    single = [values.astype(np.float32) for values in (x, np.cbrt(0.75 * volume / np.pi), shear / 1e3, pressure, shear)]
    return LiquidFrame(*single, shear > YIELD, vertices, faces)


def frame(index: int, surfaced: bool = False) -> Frame:
    """Return frame `index`: the further on, the higher the wave."""
    liquid = basin(0.015 * index, surfaced=surfaced)
    series = {"dt": 1e-3, "linear_iterations": 9.0 + index, "particles": float(len(liquid.positions)), "kinetic_energy": 0.0}
    return Frame(index, index / 30, 33 * index, liquid=liquid, series=series)


def write_job(directory: Path, frames: int, surfaced: bool = False) -> None:
    """Make `directory` a job directory with that many frames."""
    jobs.write_job(directory, SCENE, (frame(index, surfaced) for index in range(frames)))


@cache
def large() -> LiquidFrame:
    """Return 173,000 particles."""
    return basin(0.04, 0.005)


def write_large_job(directory: Path) -> None:
    """Make `directory` a job directory of one frame of them."""
    jobs.write_job(directory, SCENE, [Frame(0, 0.0, 0, liquid=large())])


def at_rest(liquid: LiquidFrame) -> LiquidFrame:
    """Return the frame where nothing moves or bears load."""
    none = np.zeros_like(liquid.speed)
    return replace(liquid, speed=none, pressure=none, shear=none, yielded=np.zeros_like(liquid.yielded))
