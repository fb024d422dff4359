"""Surfaces of liquids: closed, seen from outside, around the volume of their particles, always the same."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from engine.liquid.surface_mesh import surface

ROOT = Path(__file__).resolve().parents[3]
SPACING = 0.01


def block(sides: tuple[int, int, int], jitter: float = 0.0) -> np.ndarray:
    """Particles of a box from the origin, one to a cell, up to `jitter` of a cell from its middle."""
    cell = np.stack(np.meshgrid(*map(np.arange, sides), indexing="ij"), axis=-1).reshape(-1, 3)
    return SPACING * (cell + 0.5 + np.random.default_rng(0).uniform(-jitter, jitter, cell.shape))


def around(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return surface(x, np.full(len(x), SPACING**3))


def enclosed(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume inside a closed mesh, negative where it is seen from inside [m^3]."""
    a, b, c = (vertices[faces[:, corner]].astype(float) for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("jitter", [0.0, 0.25, 0.5])
def test_a_block_encloses_the_volume_of_its_particles(jitter):
    vertices, faces = around(block((30, 20, 10), jitter))
    assert vertices.dtype == np.float32 and faces.dtype == np.int32
    assert enclosed(vertices, faces) / (6000 * SPACING**3) == pytest.approx(1, abs=0.02)
    reach = (jitter + 0.1) * SPACING
    assert (vertices > -reach).all() and (vertices < SPACING * np.array((30, 20, 10)) + reach).all()


def test_surfaces_are_closed():
    """Every edge is walked once in each direction."""
    _, faces = around(block((12, 9, 7), 0.4))
    edges = Counter(map(tuple, np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist()))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


def test_sheets_and_single_drops_have_a_surface():
    sheet = around(block((40, 40, 1)))
    assert enclosed(*sheet) / (1600 * SPACING**3) == pytest.approx(1.25, abs=0.03)
    drop = around(np.array([[3.0, 2.0, 1.0]]))
    assert enclosed(*drop) / SPACING**3 == pytest.approx(0.8, abs=0.05)
    assert np.allclose(drop[0].mean(axis=0), (3, 2, 1), atol=0.1 * SPACING)


def test_nothing_has_no_surface():
    vertices, faces = around(np.zeros((0, 3)))
    assert vertices.shape == (0, 3) and faces.shape == (0, 3)
    assert vertices.dtype == np.float32 and faces.dtype == np.int32


def test_a_surface_is_the_same_on_any_number_of_threads():
    program = (
        "import hashlib\n"
        "from tests.engine.liquid.test_surface_mesh import around, block\n"
        "print(hashlib.sha256(b''.join(a.tobytes() for a in around(block((60, 40, 20), 0.4)))).hexdigest())"
    )
    made = {
        subprocess.run([sys.executable, "-c", program], cwd=ROOT, env={**os.environ, "RAYON_NUM_THREADS": threads},
                       capture_output=True, text=True, check=True).stdout
        for threads in ("1", "2", "3")
    }
    assert len(made) == 1
