"""Discrete elastic rods at rest: the heavy cantilever, the twisted ring, the ribbon that gives way sideways."""

from math import pi, sqrt

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.loads import StrandLoads
from engine.strands.model import StrandModel, StrandState
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.fit import fitted_exponent
from engine.validate.strands import cantilever, least_stiffness, settle

LENGTH, RADIUS = 0.2, 1e-4  # so slender that stretch does not count [m]
NYLON = StrandMaterial(density=1150.0, young=2e9, shear=0.75e9)
HEAVINESS = (0.1, 1.0, 10.0, 100.0)  # rho g A L^3 / E I

RIBBON = np.array([2e-3, 5e-5])  # semi-axes [m]: E I_1 is 1,600 times E I_2
PRANDTL = 4.013

MICHELL = 2 * pi * sqrt(3)


@case("der-cantilever", bar=5e-3, order=1.8, summary="heavy cantilever at rest: error of the tip over the length")
def heavy_cantilever(quick: bool) -> CaseResult:
    """Largest distance of the tip to that of the planar elastica, over HEAVINESS."""
    wanted = {gamma: elastica_tip(gamma) for gamma in HEAVINESS}

    def error(segments: float) -> float:
        return max(_tip_error(int(segments), gamma, *tip) for gamma, tip in wanted.items())

    rows = timed_rows("segments", (16, 32, 64) if quick else (8, 16, 32, 64, 128), error)
    at_64 = next(row.error for row in rows if row.value == 64)
    order = fitted_exponent([1.0 / row.value for row in rows], [row.error for row in rows])
    return CaseResult(rows, at_64, order, note=f"rho g A L^3 / E I of {HEAVINESS}, error at 64 segments")


def elastica_tip(gamma: float, stretch: float = 0.0, shear: float = 0.0) -> tuple[float, float]:
    """Place of the tip, over the length, of the cantilever whose weight is `gamma` E I / L^2.

    Solves theta'' = -gamma (1 - s) (e cos theta - q sin theta) with theta(0) = 0 and theta'(1) = 0, theta being the slope
    downward, with x and z; e = 1 + `stretch` gamma (1 - s) sin theta and q = `shear` gamma (1 - s) cos theta are how a piece is
    stretched and sheared. `stretch` is E I / (E A L^2), `shear` E I / (k G A L^2); without them it is the inextensible elastica.
    """

    def slope(s, y):
        sin, cos, weight = np.sin(y[0]), np.cos(y[0]), gamma * (1 - s)
        e, q = 1 + stretch * weight * sin, shear * weight * cos
        return np.array([y[1], -weight * (e * cos - q * sin), e * cos - q * sin, -e * sin - q * cos])

    s = np.linspace(0.0, 1.0, 201)
    droop = np.pi / 2 * gamma / (gamma + 8)  # a first guess
    guess = np.array([droop * (1 - (1 - s) ** 3), 3 * droop * (1 - s) ** 2, s * np.cos(droop), -s * np.sin(droop)])
    solved = solve_bvp(slope, lambda a, b: np.array([a[0], b[1], a[2], a[3]]), s, guess, tol=1e-10, max_nodes=200_000)
    if not solved.success:
        raise RuntimeError(solved.message)
    return float(solved.y[2, -1]), float(solved.y[3, -1])


def _tip_error(segments: int, gamma: float, x: float, z: float) -> float:
    model, state = cantilever(segments, LENGTH, RADIUS, NYLON)
    gravity = gamma * NYLON.young * RADIUS**2 / (4 * NYLON.density * LENGTH**3)  # that makes the weight what it should be
    settle(model, state, np.array([0.0, 0.0, -gravity]))
    return float(np.hypot(state.x[-1, 0] / LENGTH - x, state.x[-1, 2] / LENGTH - z))


@case("der-ring", bar=0.02, summary="twisted ring of a straight rod: total twist at which it buckles, against Michell")
def twisted_ring(quick: bool) -> CaseResult:
    """Relative error of the twist at which the plane ring is no longer the least of all shapes near it."""

    def error(segments: float) -> float:
        ratio = NYLON.young / (2 * NYLON.shear)  # E I / G J of a round rod
        buckling = brentq(lambda total: least_stiffness(*ring(int(segments), total)), 0.8 * MICHELL * ratio,
                          1.2 * MICHELL * ratio, xtol=1e-6)
        return abs(buckling / (MICHELL * ratio) - 1)

    rows = timed_rows("segments", (32, 64) if quick else (32, 64, 128), error)
    return CaseResult(rows, rows[-1].error, fitted_exponent([1 / row.value for row in rows], [row.error for row in rows]))


def ring(segments: int, total: float) -> tuple[StrandModel, StrandState]:
    """Return a ring of a rod that is straight at rest, with so much `total` twist [rad]; its last edge lies on the first.

    Both are held, and the opposite vertex in its plane, which keeps it from moving as a whole and no more: it is as free as a
    closed one.
    """
    vertices = segments + 2
    angle = 2 * pi / segments * (np.arange(vertices) - 0.5)
    radius = LENGTH / (2 * segments * np.sin(pi / segments))
    held = np.zeros((vertices, 4), np.bool_)
    held[:2, :3] = held[-2:, :3] = held[0, 3] = held[-2, 3] = True
    held[vertices // 2, 2] = True
    assembly = StrandAssembly()
    line = LENGTH / segments * np.arange(vertices)
    up = np.array([0.0, 0.0, 1.0])
    assembly.strand(radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]), RADIUS, NYLON, normal=up,
                    rest=np.column_stack([line, 0 * line, 0 * line]), held=held)
    model, state = assembly.build()
    turn = total / segments * np.arange(vertices)[:, None]
    t = np.diff(state.x, axis=0, append=np.zeros((1, 3)))
    t /= np.linalg.norm(t, axis=1)[:, None]
    state.m1 = np.cos(turn) * up + np.sin(turn) * np.cross(t, up)
    state.twist[1:-1] = total / segments
    return model, state


@case("der-lateral", bar=0.02, summary="ribbon loaded in its stiff plane: load at which it gives way sideways, against Prandtl")
def lateral(quick: bool) -> CaseResult:
    """Relative error of the load at the tip at which the bent ribbon no longer resists being pushed sideways."""

    def error(segments: float) -> float:
        a, b = RIBBON
        sideways = NYLON.young * pi * a * b**3 / 4
        torsion = NYLON.shear * pi * (a * b) ** 3 / (a * a + b * b)
        critical = PRANDTL * sqrt(sideways * torsion) / LENGTH**2
        buckling = brentq(lambda load: resistance(int(segments), load), 0.7 * critical, 1.3 * critical, rtol=1e-7)
        return abs(buckling / critical - 1)

    rows = timed_rows("segments", (16, 32) if quick else (16, 32, 64), error)
    return CaseResult(rows, rows[-1].error, fitted_exponent([1 / row.value for row in rows], [row.error for row in rows]))


def resistance(segments: int, load: float) -> float:
    """Least stiffness, out of its plane, of a ribbon whose tip is pulled down by `load` [N]."""
    model, state = cantilever(segments, LENGTH, RIBBON, NYLON)
    force = np.zeros_like(state.x)
    force[-1, 2] = -load
    settle(model._replace(held=model.held | ~in_plane(model)), state, np.zeros(3), StrandLoads(force=force))
    return least_stiffness(model, state, ~in_plane(model) & ~model.held)


def in_plane(model: StrandModel) -> np.ndarray:
    """Return which unknowns [V, 4] keep a strand in the plane of x and z."""
    return np.broadcast_to([True, False, True, False], model.held.shape)
