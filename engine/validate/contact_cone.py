"""Random small sets of contacts: Coulomb's law itself is the judge, and for a single contact all solutions there are."""

from itertools import pairwise
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from engine.arrays import Flags, Floats, Ints
from engine.contact.augmented_lagrangian import Strands, solve
from engine.contact.contact_problem import contact_problem
from engine.contact.strand_contacts import SOLID, Contacts
from engine.linalg.banded import WIDTH
from engine.validate.catalogue import CaseResult, Row, case

TOLERANCES = (1e-4, 1e-7, 1e-10)
ROUNDS = 1000
KINK = 1e-6  # displacement, over the largest, from which sides that come nearer are told from those that touch
DIRECTIONS = np.linspace(-np.pi, np.pi, 721)  # between which slip is sought


class Problem(NamedTuple):
    """Strands that answer linearly, and C contacts between them or with solids."""

    strands: Strands
    hessian: Floats  # that of the strands in full, shape [4V, 4V]
    contacts: Contacts
    pull: Floats  # [N], shape [C]
    compliance: Floats  # of the masses of vertices [m/N], shape [V]
    moved: Floats  # what vertices have moved before [m], shape [V, 3]

    @property
    def jacobian(self) -> Floats:
        """What unknowns move the first side of contacts by relative to the second, in space, shape [C, 3, 4V]."""
        unknowns = np.zeros((len(self.pull), 3, *self.strands.gradient.shape))
        for c, ((a, b), (s, t)) in enumerate(zip(self.contacts.edge, self.contacts.share, strict=True)):
            sides = [(a, 1.0 - s), (a + 1, s)] + ([(b, t - 1.0), (b + 1, -t)] if b >= 0 else [])
            for vertex, weight in sides:
                unknowns[c, :, vertex, :3] += weight * np.eye(3)
        return np.where(self.strands.held, 0.0, unknowns).reshape(len(self.pull), 3, -1)

    @property
    def gap(self) -> Floats:
        """How far sides are from touching at the start of the step [m], shape [C]."""
        return self.contacts.apart - self.contacts.kept


@case("contact-cone", bar=1e-8, summary="random contacts of strands: what they miss of Coulomb's law, over the problem's scales")
def cone(quick: bool) -> CaseResult:
    """Worst residual of the law; solutions of single contacts are compared with all that there are, too."""
    problems = [random_problem(seed) for seed in range(100 if quick else 1000)]
    strange: set[int] = set()

    def error(tolerance: float) -> float:
        forces = [solved(problem, tolerance) for problem in problems]
        strange.clear()
        for seed, (problem, force) in enumerate(zip(problems, forces, strict=True)):
            if len(force) == 1 and not _is_among(force[0], solutions(problem)):
                strange.add(seed)
        return max(residual(problem, force) for problem, force in zip(problems, forces, strict=True))

    solved(problems[0], TOLERANCES[0])  # compiles the kernels, untimed
    rows = []
    for tolerance in TOLERANCES:
        began = perf_counter()
        rows.append(Row("tolerance", tolerance, error(tolerance), perf_counter() - began))
    single = sum(len(problem.pull) == 1 for problem in problems)
    failures = [f"no solution: the single contacts of problems {sorted(strange)}"] if strange else []
    return CaseResult(rows, rows[-1].error, failures=failures, note=f"{len(problems)} problems, {single} with a single contact")


def solved(problem: Problem, tolerance: float) -> Floats:
    """Return the forces at contacts that the engine finds, in space, shape [C, 3] [N]."""
    linear = contact_problem(problem.contacts, _strand_of(problem.strands), problem.pull, problem.compliance)
    force = problem.contacts.force.copy()
    solve(problem.strands, linear, problem.moved, force, tolerance, ROUNDS)
    return np.einsum("cij,ci->cj", linear.frame, force)


def displacements(problem: Problem, force: Floats) -> Floats:
    """Return what contacts move by where strands answer to the forces [C, 3] [N], in space, shape [C, 3] [m]."""
    jacobian = problem.jacobian
    load = np.einsum("ciu,ci->u", jacobian, force) - problem.strands.gradient.reshape(-1)
    before = np.zeros(problem.strands.gradient.shape)
    before[:, :3] = problem.moved
    return jacobian @ (before.reshape(-1) + np.linalg.solve(problem.hessian, load)) - problem.contacts.carried


def residual(problem: Problem, force: Floats) -> float:
    """Return what forces [C, 3] [N] and the displacements that follow from them miss of Coulomb's law at most.

    Displacements are in parts of the largest one without contacts, forces in parts of the largest force of all. Work that
    friction would do counts as well. What is not a number is infinitely wrong.
    """
    if not np.isfinite(force).all():
        return np.inf
    w, free = displacements(problem, force), displacements(problem, 0.0 * force)
    far = max(np.abs(free).max(), np.abs(problem.gap).max())
    large = max(np.abs(problem.strands.gradient).max(), np.abs(force).max())
    worst = 0.0
    for c, normal in enumerate(problem.contacts.normal):
        along, pressed = normal @ w[c], normal @ force[c]
        slip, friction = w[c] - along * normal, force[c] - pressed * normal
        gap, pull = problem.gap[c], problem.pull[c]
        normal_part = _off_normal_law(along / far, pressed / large, gap / far, pull / large)
        limits = problem.contacts.friction[c] * _pressing(along / far, pressed, gap / far, pull)
        friction_part = min(_off_friction_law(slip / far, friction / large, limit / large) for limit in limits)
        worst = max(worst, normal_part, friction_part, (friction @ slip) / (far * large))
    return float(worst)


def _off_normal_law(along: float, pressed: float, gap: float, pull: float) -> float:
    """Distance of a normal displacement and force to the broken line on which the law has them."""
    if gap <= 0.0:
        return min(
            max(abs(along + gap), -pull - pressed),  # they touch, pressed or held
            max(-gap - along, abs(pressed + pull)),  # they part
        )
    return min(
        max(abs(along + gap), -pressed),  # they have come to press on each other
        max(-gap - along, along, abs(pressed)),  # they come nearer
        max(abs(along), pressed, -pull - pressed),  # they are held where they are
        max(-along, abs(pressed + pull)),  # they part
    )


def _pressing(along: float, pressed: float, gap: float, pull: float) -> Floats:
    """Forces that friction may be in proportion to: that of the normal and the pull, none for sides that come nearer."""
    if gap <= 0.0 or not -gap < along < 0.0:
        return np.array([pressed + pull])
    ends = min(-along, along + gap) < KINK
    return np.array([0.0, pressed + pull] if ends else [0.0])


def _off_friction_law(slip: Floats, friction: Floats, limit: float) -> float:
    """What slip and friction are short of one of the two that the law allows: no slip, or friction at its limit against it."""
    size = np.linalg.norm(slip)
    sticks = max(size, np.linalg.norm(friction) - limit)
    slides = np.linalg.norm(friction + limit * slip / size) if size > 0.0 else np.inf
    return float(min(sticks, slides))


def solutions(problem: Problem) -> Floats:
    """Return all forces that a single contact can have by Coulomb's law, shape [n, 3] [N]."""
    jacobian = problem.jacobian[0]
    normal = problem.contacts.normal[0]
    frame = np.array([normal, *np.linalg.svd(normal[None])[2][1:]])
    compliance = frame @ jacobian @ np.linalg.solve(problem.hessian, jacobian.T) @ frame.T
    start = frame @ displacements(problem, np.zeros((1, 3)))[0]
    mu, gap, pull = problem.contacts.friction[0], problem.gap[0], problem.pull[0]
    parted = np.array([-pull, 0.0, 0.0])
    found = []
    if (start + compliance @ parted)[0] > max(0.0, -gap):
        found.append(parted)
    if -gap < start[0] < 0.0:
        found.append(np.zeros(3))
    held = [(-gap, -pull if gap <= 0.0 else 0.0, np.inf)] + ([(0.0, -pull, 0.0)] if gap > 0.0 else [])
    for along, least, most in held:
        sticking = np.linalg.solve(compliance, np.array([along, 0.0, 0.0]) - start)
        candidates = [sticking] if np.hypot(*sticking[1:]) <= mu * (sticking[0] + pull) else []
        candidates += _sliding(compliance, start, along, mu, pull)
        found += [force for force in candidates if least <= force[0] <= most]
    return np.array(found).reshape(-1, 3) @ frame


def _sliding(compliance: Floats, start: Floats, along: float, mu: float, pull: float) -> list[Floats]:
    """Forces with which a contact slips while it moves by `along` [m], in its frame; found by the direction of friction."""

    free = start - pull * compliance[:, 0]  # displacement without anything but the pull
    missing = along - free[0]

    def yielding(angle: float) -> Floats:
        """What the contact moves by for a unit of pressing force and its friction [m/N]; it may be nothing along the normal."""
        return compliance @ np.array([1.0, mu * np.cos(angle), mu * np.sin(angle)])

    def aside(angle: float) -> float:
        """Slip across the friction, times what the contact yields along the normal."""
        w = yielding(angle)[0] * free + missing * yielding(angle)
        return float(np.cos(angle) * w[2] - np.sin(angle) * w[1])

    found = []
    for low, high in pairwise(DIRECTIONS):
        if aside(low) * aside(high) <= 0.0:
            angle = brentq(aside, low, high, xtol=1e-14)
            pressing = missing / yielding(angle)[0]
            r = np.array([pressing - pull, mu * pressing * np.cos(angle), mu * pressing * np.sin(angle)])
            if pressing >= 0.0 and (start + compliance @ r)[1:] @ r[1:] <= 0.0:
                found.append(r)
    return found


def _is_among(force: Floats, candidates: Floats) -> bool:
    scale = max(np.abs(force).max(), np.abs(candidates).max(initial=0.0))
    return bool(len(candidates)) and bool(np.abs(candidates - force).max(axis=1).min() <= 1e-6 * scale)


def random_problem(seed: int) -> Problem:
    """Return a random problem; every second one has contacts with a pull.

    Its contacts can move independently of each other: else there might be no solution.
    """
    rng = np.random.default_rng(seed)
    problem = _draw(rng, pulled=seed % 2 == 1)
    while np.linalg.matrix_rank(np.concatenate(list(problem.jacobian)), tol=1e-2) < 3 * len(problem.pull):
        problem = _draw(rng, pulled=seed % 2 == 1)
    return problem


def _draw(rng: np.random.Generator, pulled: bool) -> Problem:
    counts = rng.integers(4, 9, rng.integers(1, 4))
    start = np.concatenate([[0], np.cumsum(counts)])
    held = np.zeros((start[-1], 4), np.bool_)
    for first in start[:-1][rng.random(len(counts)) < 0.3]:
        held[first : first + 2, :3] = held[first, 3] = True
    mass = 10.0 ** rng.uniform(-1, 1)
    hessian = np.zeros((len(held) * 4, len(held) * 4))
    for a, b in pairwise(4 * start):
        hessian[a:b, a:b] = random_hessian(rng, b - a, mass)
    hessian[held.reshape(-1)] = hessian[:, held.reshape(-1)] = 0.0
    hessian[np.diag_indices_from(hessian)] += held.reshape(-1)
    band = np.zeros((len(hessian), WIDTH + 1))
    for d in range(WIDTH + 1):
        band[: len(hessian) - d, d] = np.diagonal(hessian, -d)
    gradient = np.where(held, 0.0, rng.normal(size=held.shape))
    return Problem(
        Strands(start, gradient, band, held), hessian, contacts := random_contacts(rng, start, held),
        pull=pulled * rng.uniform(0.0, 1.0, len(contacts.edge)), compliance=np.full(len(held), 1.0 / mass),
        moved=np.where(held[:, :3], 0.0, rng.normal(scale=0.3, size=(len(held), 3))),
    )


def random_hessian(rng: np.random.Generator, size: int, mass: float) -> Floats:
    """Return a positive definite matrix that is as wide as a strand's, up to 1e4 times stiffer than its mass."""
    half = np.tril(rng.normal(size=(size, size)))
    half[np.subtract.outer(np.arange(size), np.arange(size)) > WIDTH] = 0.0
    return mass * (np.eye(size) + 10.0 ** rng.uniform(-2, 4) / WIDTH * half @ half.T)


def random_contacts(rng: np.random.Generator, start: Ints, held: Flags) -> Contacts:
    """Return 1 to 6 contacts, each between two strands or of one with a solid; none of them is held altogether."""
    edges = [np.arange(a, b - 1) for a, b in pairwise(start)]
    edges = [own[~held[own + 1, 0]] for own in edges]
    edge = []
    for _ in range(rng.integers(1, 7)):
        first, *others = rng.permutation(len(edges))
        second = rng.choice(edges[others[0]]) if others and rng.random() < 0.6 else SOLID
        edge.append((rng.choice(edges[first]), second))
    number = len(edge)
    solid = np.array(edge)[:, 1] < 0
    normal = rng.normal(size=(number, 3))
    friction = rng.uniform(0.0, 1.0, number) * (rng.random(number) < 0.8)
    return Contacts(
        edge=np.array(edge), share=rng.random((number, 2)) * np.column_stack([np.ones(number), ~solid]),
        normal=normal / np.linalg.norm(normal, axis=1)[:, None],
        apart=1.0 + rng.normal(scale=0.3, size=number), touch=np.ones(number), kept=np.ones(number), mended=np.zeros(number),
        carried=solid[:, None] * rng.normal(scale=0.3, size=(number, 3)), friction=friction,
        force=rng.normal(size=(number, 3)) * (rng.random() < 0.5),
    )


def _strand_of(strands: Strands) -> Ints:
    return np.repeat(np.arange(len(strands.start) - 1), np.diff(strands.start))
