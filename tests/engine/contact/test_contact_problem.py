"""Contacts as a problem of linear algebra: frames, displacements, stiffnesses, and springs that stand for them."""

from itertools import pairwise

import numpy as np
import pytest

from engine.contact.contact_problem import (
    RIGID,
    STIFF,
    ContactProblem,
    _softness,
    align,
    contact_problem,
    relative,
    springs_of,
    stiffen,
)
from engine.strands import springs
from engine.validate.contact_cone import Problem, random_problem

SEEDS = range(6)


def strand_of(problem: Problem):
    return np.repeat(np.arange(len(problem.strands.start) - 1), np.diff(problem.strands.start))


def linear(problem: Problem) -> ContactProblem:
    return contact_problem(problem.contacts, strand_of(problem), problem.pull, problem.compliance)


@pytest.mark.parametrize("seed", SEEDS)
def test_displacements_in_frames_are_those_in_space(seed):
    problem = random_problem(seed)
    made = linear(problem)
    moved, w = np.random.default_rng(seed).normal(size=(len(problem.moved), 4)), np.empty(3)
    in_space = problem.contacts.displaced(moved[:, :3]) + problem.contacts.carried
    for c, frame in enumerate(made.frame):
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(frame[0], problem.contacts.normal[c])
        relative(made, c, moved, w)
        np.testing.assert_allclose(w, frame @ in_space[c], atol=1e-12)
    np.testing.assert_allclose(made.gap, problem.gap)
    np.testing.assert_allclose(made.yielding, (made.weight**2).sum(axis=1) * problem.compliance[0])


@pytest.mark.parametrize("seed", SEEDS)
def test_every_vertex_at_a_contact_is_listed_with_its_strand(seed):
    problem = random_problem(seed)
    made, strand = linear(problem), strand_of(problem)
    listed = []
    for i, s in enumerate(made.strand):
        for c, e in made.place[made.first[i] : made.first[i + 1]]:
            assert strand[made.vertex[c, e]] == s
            listed.append((c, e))
    assert sorted(listed) == [tuple(place) for place in np.argwhere(made.weight != 0.0)]
    assert made.first[-1] == len(made.place)


@pytest.mark.parametrize("seed", SEEDS)
def test_aligned_frames_keep_their_normals_and_stiffness_is_in_proportion(seed):
    problem = random_problem(seed)
    made, harder = linear(problem), linear(problem)
    before = made.frame.copy()
    held = problem.strands.held
    stiffness, of_harder = align(made, problem.strands.band, held), align(harder, 100.0 * problem.strands.band, held)
    np.testing.assert_allclose(of_harder, 100.0 * stiffness, rtol=1e-9)
    np.testing.assert_allclose(made.frame, harder.frame, atol=1e-9)
    np.testing.assert_allclose(made.frame[:, 0], before[:, 0])
    for frame, turned in zip(before, made.frame, strict=True):
        np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turned) == pytest.approx(np.linalg.det(frame))
    assert (stiffness > 0.0).all() and (stiffness[:, 1] <= stiffness[:, 2] * (1 + 1e-12)).all()


def softness(problem: Problem, made: ContactProblem, band=None):
    """What each contact yields in its frame, shape [C, 3, 3] [m/N]."""
    found = np.empty((len(made.gap), 3, 3))
    for c in range(len(found)):
        _softness(made, problem.strands.band if band is None else band, problem.strands.held, c, found[c])
    return found


@pytest.mark.parametrize("seed", range(20))
def test_what_vertices_yield_one_by_one_adds_up(seed):
    """Against inverses of the blocks of free directions of each vertex."""
    problem = random_problem(seed)
    made, hessian = linear(problem), problem.hessian
    wanted = np.zeros((len(made.gap), 3, 3))
    for c, e in np.argwhere(made.weight != 0.0):
        v = made.vertex[c, e]
        free = np.flatnonzero(~problem.strands.held[v, :3])
        block = np.ix_(4 * v + free, 4 * v + free)
        across = made.frame[c][:, free]
        wanted[c] += made.weight[c, e] ** 2 * across @ np.linalg.inv(hessian[block]) @ across.T
    np.testing.assert_allclose(softness(problem, made), wanted, rtol=1e-6, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", SEEDS)
def test_stiffness_is_over_what_yields_least_and_most_across_the_normal(seed):
    problem = random_problem(seed)
    made = linear(problem)
    stiffness = align(made, problem.strands.band, problem.strands.held)
    for soft, (along, first, second) in zip(softness(problem, made), stiffness, strict=True):
        least, most = np.linalg.eigvalsh(soft[1:, 1:])
        np.testing.assert_allclose([along * soft[0, 0], first * most, second * least], STIFF, rtol=1e-5)
        np.testing.assert_allclose(soft[1, 2], 0.0, atol=1e-6 * most)


def one_contact(share: float, held) -> tuple[Problem, ContactProblem, np.ndarray]:
    """A contact on an edge of two masses, what is held of the first of which is told."""
    problem = next(p for p in map(random_problem, range(100)) if len(p.pull) == 1 and p.contacts.edge[0, 1] < 0)
    own = problem.contacts._replace(edge=np.array([[0, -1]]), share=np.array([[share, 0.0]]))
    flags = np.zeros((2, 4), np.bool_)
    flags[0, :3] = held
    band = np.zeros((8, 11))
    band[:, 0] = np.where(flags, 1.0, 400.0).reshape(-1)
    made = contact_problem(own, np.zeros(2, np.int64), np.zeros(1), np.full(2, 1e-2))
    return problem._replace(strands=problem.strands._replace(held=flags, band=band)), made, band


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("share", [0.05, 0.5, 0.9, 1.0])
def test_stiffness_is_in_proportion_to_what_the_contact_yields(share, held):
    problem, made, band = one_contact(share, held)
    yields = (0.0 if held else (1.0 - share) ** 2 / 400.0) + share**2 / 400.0
    np.testing.assert_allclose(align(made, band, problem.strands.held)[0] * yields, STIFF)


def test_a_vertex_held_in_one_direction_yields_in_the_others():
    problem, made, band = one_contact(0.5, [True, False, False])
    in_space = made.frame[0].T @ softness(problem, made, band)[0] @ made.frame[0]
    np.testing.assert_allclose(in_space, np.diag([0.25, 0.5, 0.5]) / 400.0, atol=2.0 / (RIGID * 400.0))


def test_what_does_not_yield_is_as_stiff_as_stiffness_goes():
    problem, made, band = one_contact(0.0, True)
    most, stiffness, force = align(made, band, problem.strands.held), np.zeros((1, 3)), np.zeros((1, 3))
    assert (most == np.inf).all() and np.isfinite(made.frame).all()
    stiffen(made, most, force, 1e-3, stiffness)
    np.testing.assert_allclose(stiffness, STIFF / made.yielding[0])


def test_contacts_are_as_stiff_as_their_force_needs_and_never_softer_than_before():
    problem = next(p for p in map(random_problem, range(100)) if len(p.pull) == 3)
    made = linear(problem)
    most, stiffness, force = np.full((3, 3), 1e6), np.zeros((3, 3)), np.zeros((3, 3))
    force[1, 0], force[2, 1] = 30.0, 1e12
    stiffen(made, most, force, 1e-3, stiffness)
    masses = STIFF / made.yielding
    assert (masses < 3e4).all()
    np.testing.assert_allclose(stiffness, np.repeat([[masses[0]], [3e4], [1e6]], 3, axis=1))
    stiffen(made, most, 0 * force, 1e-3, stiffness)
    np.testing.assert_allclose(stiffness[1:], np.repeat([[3e4], [1e6]], 3, axis=1))


@pytest.mark.parametrize("seed", SEEDS)
def test_springs_push_both_sides_and_yield_as_contacts_do(seed):
    problem = random_problem(seed)
    made, strand, rng = linear(problem), strand_of(problem), np.random.default_rng(seed)
    number, x = len(problem.pull), rng.normal(size=(len(strand), 3))
    force, slope = rng.normal(size=(number, 3)), np.abs(rng.normal(size=(number, 4)))
    slope[:, 2] *= 0.3
    made_springs = springs_of(problem.contacts, made, force, slope, x, strand)
    gradient, held = np.zeros((len(strand), 4)), np.zeros((len(strand), 4), np.bool_)

    def pulls(places):
        gradient[:] = 0.0
        for s, (a, b) in enumerate(pairwise(problem.strands.start)):
            springs.add_gradient(made_springs, s, a, places[a:b], held[a:b], gradient[a:b])
        return gradient[:, :3].copy()

    push = np.einsum("cij,ci->cj", made.frame, force)
    np.testing.assert_allclose(pulls(x), -problem.contacts.on_vertices(push, len(x)), atol=1e-12)
    # where first sides move alone they are pushed back as the slope says, and nothing else is
    moved = rng.normal(size=3)
    along, first, mixed, second = slope.T
    zero = 0.0 * along
    local = np.array([[along, zero, zero], [zero, first, mixed], [zero, mixed, second]])
    back = np.einsum("cia,ijc,cjb,b->ca", made.frame, local, made.frame, moved)
    is_first = (made_springs.force[:, None] == push).all(axis=2).any(axis=1)
    made_springs = made_springs._replace(anchor=made_springs.anchor - moved * is_first[:, None])
    only_first = problem.contacts.on_vertices(back, len(x), second=0.0)
    np.testing.assert_allclose(pulls(x), -problem.contacts.on_vertices(push, len(x)) + only_first, atol=1e-9)
