"""Springs that hold places on strands: gradient and Hessian against differences, and what is held."""

import numpy as np
import pytest

from engine.strands import springs
from engine.strands.springs import Springs, no_springs

START, VERTICES, WIDTH = 3, 6, 11  # of the strand, which others come before


def random_springs(seed: int):
    """Springs of three strands, the second of which begins at START; and places of all vertices."""
    rng = np.random.default_rng(seed)
    first = np.array([0, 2, 7, 8])
    vertex = np.concatenate([[0, 1], START + rng.integers(0, VERTICES - 1, 5), [START + VERTICES]])
    half = rng.normal(size=(8, 3, 3))
    held = rng.random((VERTICES, 4)) < 0.2
    return Springs(first, vertex, rng.random(8), rng.normal(size=(8, 3)), rng.normal(size=(8, 3)),
                   half @ half.transpose(0, 2, 1)), rng.normal(size=(VERTICES, 3)), held


def places(of, x):
    """Where the places on the second strand are, to which its springs 2 to 6 are fixed."""
    at, share = of.vertex[2:7] - START, of.share[2:7, None]
    return (1.0 - share) * x[at] + share * x[at + 1]


def gradient(of, x, held):
    g = np.zeros((VERTICES, 4))
    largest = springs.add_gradient(of, 1, START, x, held, g)
    return g, largest


@pytest.mark.parametrize("seed", range(4))
def test_derivatives_are_those_of_the_energy(seed):
    of, x, held = random_springs(seed)
    g, _ = gradient(of, x, held)
    unit, free = 1e-4 * np.eye(3 * VERTICES).reshape(-1, VERTICES, 3), ~held[:, :3].reshape(-1)
    energies = [springs.energy(of, 1, START, x + d) - springs.energy(of, 1, START, x - d) for d in unit]
    np.testing.assert_allclose(g[:, :3].reshape(-1), free * np.array(energies) / 2e-4, atol=1e-8)
    rows = np.array([(gradient(of, x + d, held)[0] - gradient(of, x - d, held)[0])[:, :3].reshape(-1) / 2e-4 for d in unit])
    band = np.zeros((4 * VERTICES, WIDTH))
    springs.add_hessian(of, 1, START, held, band)
    full = np.zeros((4 * VERTICES, 4 * VERTICES))
    for d in range(WIDTH):
        at = np.arange(d, len(full))
        full[at, at - d] = full[at - d, at] = band[at - d, d]
    places = np.arange(4 * VERTICES).reshape(-1, 4)[:, :3].reshape(-1)
    np.testing.assert_allclose(full[np.ix_(places, places)], rows * np.outer(free, free), atol=1e-7)
    assert not full[3::4].any() and not g[:, 3].any()


def test_the_largest_force_of_a_spring_is_told():
    of, x, held = random_springs(0)
    own = slice(2, 7)
    pull = np.einsum("pkm,pm->pk", of.stiffness[own], places(of, x) - of.anchor[own]) - of.force[own]
    assert gradient(of, x, held)[1] == pytest.approx(np.abs(pull).max())


def test_a_spring_at_its_anchor_gives_its_force():
    of, x, _ = random_springs(1)
    own = slice(2, 7)
    of.anchor[own] = places(of, x)
    g, largest = gradient(of, x, np.zeros((VERTICES, 4), np.bool_))
    np.testing.assert_allclose(g[:, :3].sum(axis=0), -of.force[own].sum(axis=0))
    assert largest == pytest.approx(np.abs(of.force[own]).max()) and springs.energy(of, 1, START, x) == 0.0


def test_none_do_nothing():
    g, largest = gradient(no_springs(3), np.ones((VERTICES, 3)), np.zeros((VERTICES, 4), np.bool_))
    assert not g.any() and largest == 0.0 and springs.energy(no_springs(3), 1, START, np.ones((VERTICES, 3))) == 0.0
