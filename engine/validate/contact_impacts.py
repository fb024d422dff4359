"""Strands that hit each other, or solids, at up to 400 radii a step: none goes through."""

from dataclasses import dataclass
from itertools import pairwise
from time import perf_counter

import numpy as np
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from engine.arrays import Floats
from engine.contact.obstacles import ObstacleKind, ObstacleMotion, Obstacles, motion
from engine.geometry.handles import Handles
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.model import StrandModel, StrandState
from engine.strands.settings import StrandSettings
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.contact_crossings import crossed, depth

HAIR = StrandMaterial(density=1300.0, young=3e9, shear=1e9)
LENGTH = 0.02  # [m]
SPEED = (1.0, 20.0)  # [m/s]
RADIUS = (3e-5, 1e-4)  # [m]
FLOWN = (5e-4, 8e-3)  # before strands meet, about [m]
AFTER = 4e-3  # beyond twice the time of that flight, that impacts are looked at [s]
STEPS = (4e-3, 2e-3, 1e-3)  # [s]
HALVINGS = 12  # of a step that is rejected
FRICTION = (0.0, 0.6)
VERTICES = (6, 17)
SIZE = (1e-3, 5e-3)  # of solids [m]
SPIN = 0.2  # speed at the ends of what turns, over that of flight
KINDS = (ObstacleKind.PLANE, ObstacleKind.BOX, ObstacleKind.SPHERE, ObstacleKind.CYLINDER)


@dataclass
class Impact:
    """Two strands, or one and a solid, that fly at each other."""

    model: StrandModel
    state: StrandState
    duration: float  # [s]
    obstacles: Obstacles | None = None
    handles: Handles | None = None

    def obstacle_motion(self, time: float, h: float) -> ObstacleMotion | None:
        """Return how the solid moves in a step."""
        if self.obstacles is None or self.handles is None:
            return None
        return motion(self.obstacles, self.handles, time, h)


@case("contact-impacts", bar=0.0, summary="strands and solids that strands hit at up to 20 m/s: share that went through")
def impacts(quick: bool) -> CaseResult:
    """Share of impacts in which centre lines went through each other, or into solids; steps that fail are halved."""
    number = 60 if quick else 1000
    rows, told = [], []
    for seed in range(2):
        fate(random_impact(seed), STEPS[-1])  # compiles the kernels, untimed
    for h in STEPS[-1:] if quick else STEPS:
        began = perf_counter()
        fates = [fate(random_impact(seed), h) for seed in range(number)]
        went = [seed for seed, (through, _) in enumerate(fates) if through]
        rows.append(Row("dt [s]", h, len(went) / number, perf_counter() - began))
        told.append(f"dt {h:g} s: {sum(halved for _, halved in fates)} steps halved, through in impacts {went}")
    return CaseResult(rows, max(row.error for row in rows), note=f"{number} impacts; " + "; ".join(told))


def fate(impact: Impact, h: float, settings: StrandSettings | None = None) -> tuple[bool, int]:
    """Return whether anything went through anything within its duration, and how many steps were rejected."""
    model, state = impact.model, impact.state
    stepper = StrandStepper(model, np.zeros(3), settings)
    time, size, rejected, through = 0.0, h, 0, False
    while time < impact.duration - 1e-12:
        size = min(size, impact.duration - time)
        before, obstacles = state.x.copy(), impact.obstacle_motion(time, size)
        report = stepper.step(state, size, obstacles=obstacles)
        if not report.accepted:
            rejected, size = rejected + 1, 0.5 * size
            if size < h * 0.5**HALVINGS:
                raise RuntimeError(f"{report.reason} in steps of {size:g} s")
            continue
        time, size = time + size, min(2.0 * size, h)
        through |= went_through(model, before, state.x - before, obstacles)
    return through, rejected


def went_through(model: StrandModel, x: Floats, moved: Floats, obstacles: ObstacleMotion | None) -> bool:
    """Return whether the two strands crossed, or one came into a solid, while vertices went from x along `moved` [V, 3] [m]."""
    edges = [np.arange(a, b - 1) for a, b in pairwise(model.start)]
    if obstacles is not None:
        return depth(obstacles, 0, x, moved, edges[0]) > 0.0
    return crossed(x, moved, *edges)


def random_impact(seed: int) -> Impact:
    """Return an impact of two strands for even seeds, of one with a solid for odd ones."""
    rng = np.random.default_rng(seed)
    away = rng.normal(size=3)
    away /= np.linalg.norm(away)
    return _on_solid(rng, away) if seed % 2 else _of_strands(rng, away)


def _of_strands(rng: np.random.Generator, away: Floats) -> Impact:
    """A strand that flies and turns towards another one, which may be held at its root."""
    radius, friction, speed, flown = (rng.uniform(*limits) for limits in (RADIUS, FRICTION, SPEED, FLOWN))
    first, second = _curve(rng), _curve(rng) + flown * away
    if cdist(_finely(first), _finely(second)).min() < 5.0 * radius:
        return _of_strands(rng, away)
    held = np.zeros((len(first), 4), np.bool_)
    held[:2, :3] = held[0, 3] = rng.random() < 0.5
    assembly = StrandAssembly()
    assembly.strand(first, radius, HAIR, friction=friction, held=held)
    assembly.strand(second, radius, HAIR, friction=friction)
    model, state = assembly.build()
    spin = rng.normal(scale=SPIN * speed / LENGTH, size=3)
    state.velocity[len(first) :] = np.cross(spin, second - flown * away) - speed * away
    return Impact(model, state, 2.0 * flown / speed + AFTER)


def _on_solid(rng: np.random.Generator, away: Floats) -> Impact:
    """A strand that flies at a solid, or stays where a solid flies and turns towards it."""
    radius, friction, speed, flown = (rng.uniform(*limits) for limits in (RADIUS, FRICTION, SPEED, FLOWN))
    turned, _ = Rotation.align_vectors([away + 0.8 * Rotation.random(rng=rng).apply([1.0, 0.0, 0.0])], [[0.0, 0.0, 1.0]])
    turned *= Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 6.0)])
    solid = Obstacles(np.array([rng.choice(KINDS)]), np.zeros((1, 3)), turned.as_matrix()[None], rng.uniform(*SIZE, (1, 3)),
                      np.array([friction]), np.zeros(1, np.int64))
    points, still = _curve(rng) + flown * away, motion(solid, _resting(), 0.0, 1.0)
    edges = np.arange(len(points) - 1)
    while depth(still, 0, points, 0.0 * points, edges) > -2.0 * radius:
        points += 0.5 * LENGTH / VERTICES[0] * away
    assembly = StrandAssembly()
    assembly.strand(points, radius, HAIR, friction=friction)
    model, state = assembly.build()
    duration = 2.0 * flown / speed + AFTER
    if rng.random() < 0.5:
        state.velocity[:] = -speed * away
        return Impact(model, state, duration, solid, _resting())
    angles = np.degrees(rng.normal(scale=SPIN * speed / LENGTH * duration, size=3))
    handles = Handles(np.array([0, 2]), np.array([0.0, duration]), np.array([np.zeros(3), speed * duration * away]),
                      np.array([np.zeros(3), angles]), np.zeros((1, 3)))
    return Impact(model, state, duration, solid, handles)


def _resting() -> Handles:
    """One handle that stays."""
    return Handles(np.array([0, 1]), np.zeros(1), np.zeros((1, 3)))


def _curve(rng: np.random.Generator) -> Floats:
    """A strand that bends at random, through the origin at one of its inner vertices."""
    number = rng.integers(*VERTICES)
    edges = np.array([0.0, 0.0, 1.0]) + np.cumsum(rng.normal(scale=0.3, size=(number - 1, 3)), axis=0)
    edges *= LENGTH / (number - 1) / np.linalg.norm(edges, axis=1)[:, None]
    points = Rotation.random(rng=rng).apply(np.vstack([np.zeros(3), np.cumsum(edges, axis=0)]))
    return points - points[rng.integers(1, number - 1)]


def _finely(points: Floats) -> Floats:
    """Places along a strand, closer than its radius is wide."""
    at = np.linspace(0.0, len(points) - 1.0, 1000)
    return np.column_stack([np.interp(at, np.arange(len(points)), points[:, k]) for k in range(3)])
