"""Single Eulerian-on-Lagrangian rods against closed forms: the catenary, the peg and the capstan."""

from typing import Any

import numpy as np
from scipy.optimize import brentq

from engine.arrays import Floats
from engine.geometry.handles import Handles
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.fit import fitted_exponent
from engine.validate.rods import DOWN, EARTH, WEIGHTLESS, march, stepper, tensions
from engine.yarns import observe
from engine.yarns.assembly import YarnAssembly, YarnMaterial

TIGHT: dict[str, Any] = dict(tolerance=1e-6, linear_tolerance=1e-6)  # Newton's error is far below those measured

SPAN, CHAIN_LENGTH, CHAIN_DENSITY, CHAIN_STIFFNESS = 1.0, 1.2, 0.1, 1e3  # [m], [m], [kg/m], [N]


@case("eol-catenary", bar=1e-3, order=1.8, summary="Rod of 1.2 x span hung at both ends: largest error over the span")
def catenary(quick: bool) -> CaseResult:
    """Compare the rod at rest, at every node, with the elastic catenary of the same stiffness."""
    rows = timed_rows("segments", (8, 16, 32, 64), _catenary_error)
    order = fitted_exponent([1.0 / row.value for row in rows], [row.error for row in rows])
    return CaseResult(rows, rows[-1].error, order)


def _catenary_error(segments: float) -> float:
    u = np.linspace(0.0, CHAIN_LENGTH, int(segments) + 1)
    hung = np.isin(u, u[[0, -1]])
    # from the V of a weight at the middle; the mass damping forgets every velocity, so that steps only relax
    depth = np.sqrt(CHAIN_LENGTH**2 - SPAN**2) / CHAIN_LENGTH * np.minimum(u, CHAIN_LENGTH - u)
    assembly = YarnAssembly()
    rod = assembly.yarn(
        YarnMaterial(radius=1e-3, density=CHAIN_DENSITY, stretch_stiffness=CHAIN_STIFFNESS, mass_damping=100.0),
        CHAIN_LENGTH, CHAIN_LENGTH / segments)
    assembly.lagrangians(rod, u, np.column_stack([u * SPAN / CHAIN_LENGTH, 0 * u, -depth]), pinned=hung)
    model, state = assembly.build()
    for _ in march(stepper(model, DOWN, **TIGHT), state, duration=10.0, h=0.1):
        if np.abs(state.x_rate).max() < 1e-8 * SPAN:
            return float(np.linalg.norm(state.x - _elastic_catenary(u), axis=1).max() / SPAN)
    raise RuntimeError("the rod did not come to rest")


def _elastic_catenary(s: Floats) -> Floats:
    """Return where the points at undeformed arc length s [n] rest, shape [n, 3], by Irvine's form.

    With the horizontal tension H and the vertical V = w L / 2 at the supports,
    x = H s / EA + H/w (asinh(V/H) - asinh((V - w s)/H)),
    z = -s/EA (V - w s / 2) - H/w ((1 + (V/H)^2)^1/2 - (1 + ((V - w s)/H)^2)^1/2).
    """
    w = CHAIN_DENSITY * EARTH
    v = 0.5 * w * CHAIN_LENGTH

    def across(s, h):
        return h * s / CHAIN_STIFFNESS + h / w * (np.arcsinh(v / h) - np.arcsinh((v - w * s) / h))

    h = brentq(lambda h: across(CHAIN_LENGTH, h) - SPAN, 1e-3 * w, 1e3 * w, xtol=1e-15, rtol=1e-14)
    z = -s / CHAIN_STIFFNESS * (v - 0.5 * w * s) - h / w * (np.hypot(1.0, v / h) - np.hypot(1.0, (v - w * s) / h))
    return np.column_stack([across(s, h), 0 * s, z])


PEG_LENGTH, PEG_LEAD, PEG_SEGMENTS = 1.0, 0.05, 8  # [m], x0 [m]
PEG_RATE = np.sqrt(2.0 * EARTH / PEG_LENGTH)
PEG_DURATION = np.arccosh(0.9 * 0.5 * PEG_LENGTH / PEG_LEAD) / PEG_RATE  # until the end is nine tenths of its way up


@case("eol-peg", bar=1e-2, order=0.95, summary="Rod sliding off a frictionless peg: error of x over the final x")
def peg(quick: bool) -> CaseResult:
    """Compare the longer side with x0 cosh((2 g / L)^1/2 t), and the energy at the end with that at the start.

    Implicit Euler is of first order: fitted exponents tend to 1 from below.
    """
    steps = PEG_DURATION / np.array([150, 300, 600, 1200])
    energy_errors = {}

    def error(h: float) -> float:
        position, energy_errors[h] = _peg_errors(h)
        return position

    rows = timed_rows("dt [s]", steps, error)
    order = fitted_exponent([row.value for row in rows], [row.error for row in rows])
    energy_order = fitted_exponent(list(energy_errors), list(energy_errors.values())) or 0.0
    told = ", ".join(f"{value:.2g}" for value in energy_errors.values())
    return CaseResult(rows, rows[-1].error, order,
                      note=f"energy error over the final kinetic energy: {told}, order {energy_order:.2f}",
                      failures=[] if energy_order >= 0.9 else ["the energy error does not vanish with dt"])


def _peg_errors(h: float) -> tuple[float, float]:
    """Errors of x over the final x, and of the total energy over the kinetic energy at the end."""
    longer = 0.5 * PEG_LENGTH + PEG_LEAD
    u = np.linspace(0.0, PEG_LENGTH, PEG_SEGMENTS + 1)
    assembly = YarnAssembly()
    stiff = YarnMaterial(radius=1e-3, density=0.01, stretch_stiffness=1e4)
    rod = assembly.yarn(stiff, PEG_LENGTH, PEG_LENGTH / PEG_SEGMENTS)
    assembly.lagrangians(rod, u, np.column_stack([0 * u, 0 * u, -np.abs(longer - u)]))
    held = assembly.eyelet(rod, longer, np.zeros(3))
    model, state = assembly.build()
    peg_node = model.point_nodes[held, 0]

    def energy() -> float:
        return sum(observe.energies(model, state, DOWN).values())

    start, worst = energy(), 0.0
    for time in march(stepper(model, DOWN, **TIGHT), state, PEG_DURATION, h):
        x = state.u[peg_node] - 0.5 * PEG_LENGTH
        worst = max(worst, abs(x - PEG_LEAD * np.cosh(PEG_RATE * time)))
    released = observe.energies(model, state, DOWN)["kinetic"]
    return worst / (PEG_LEAD * np.cosh(PEG_RATE * PEG_DURATION)), abs(energy() - start) / released


FRICTION, TURN, ARC_RADIUS, TAIL = 0.3, np.pi, 0.1, 0.05  # mu, phi, [m], straight rod at both ends [m]
PULL, FEED, PULLING, FEEDING = 0.02, 0.002, 0.2, 0.2  # [m], [m], [s], [s]


@case("eol-capstan", bar=5e-3, order=1.8, summary="Rod pulled around N frictional contacts: error of T2/T1")
def capstan(quick: bool) -> CaseResult:
    """Compare T2/T1 with the force balance of each contact, and with exp(mu phi) as N grows."""
    distance = {}

    def error(contacts: float) -> float:
        ratio = _capstan_ratio(int(contacts))
        distance[contacts] = abs(ratio / np.exp(FRICTION * TURN) - 1.0)
        # T2 - T1 = mu F_n, F_n = (T1 + T2) sin(dphi / 2) at each of N contacts
        slope = FRICTION * np.sin(0.5 * TURN / contacts)
        return abs(ratio / ((1.0 + slope) / (1.0 - slope)) ** contacts - 1.0)

    rows = timed_rows("contacts N", (2, 4, 8, 16), error)
    order = fitted_exponent([1.0 / n for n in distance], list(distance.values()))
    told = ", ".join(f"{value:.2g}" for value in distance.values())
    return CaseResult(rows, max(row.error for row in rows), order,
                      note=f"the order is that of the relative distance to exp(mu phi): {told}")


def _capstan_ratio(contacts: int) -> float:
    """T2 / T1 in steady slip: pulled at one end until every contact slips, then fed at the other end as well.

    The engine takes normal forces from the last step; while the tension is steady that makes no difference.
    """
    step = TURN / contacts
    angle = (np.arange(contacts) + 0.5) * step
    arc = ARC_RADIUS * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    # tails turn at the first and the last contact by as much as the rod does at every other
    into, out = (np.array([-np.sin(a), np.cos(a), 0.0]) for a in (angle[0] - 0.5 * step, angle[-1] + 0.5 * step))
    place = np.vstack([arc[0] - TAIL * into, arc, arc[-1] + TAIL * out])
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])

    assembly = YarnAssembly()
    light = YarnMaterial(radius=1e-4, density=1e-6, stretch_stiffness=1e3, mass_damping=50.0)
    rod = assembly.yarn(light, u[-1], np.diff(u).min())
    assembly.lagrangian(rod, 0.0, place[0], pinned=True, handle=0)
    for k in range(1, contacts + 1):
        assembly.eyelet(rod, u[k], place[k], friction=FRICTION)
    assembly.lagrangian(rod, u[-1], place[-1], pinned=True, handle=1)
    model, state = assembly.build()
    handles = Handles(
        start=np.array([0, 3, 6]), time=np.array([0.0, PULLING, PULLING + FEEDING] * 2),
        offset=np.array([0 * into, 0 * into, FEED * into, 0 * out, PULL * out, (PULL + FEED) * out]))
    # anchors so stiff that every contact has slipped far behind its own before the rod is fed
    yarns = stepper(model, WEIGHTLESS, handles, friction_factor=10.0, **TIGHT)
    for _ in march(yarns, state, PULLING + FEEDING, h=2e-3):
        pass
    tension = tensions(model, state)
    return float(tension[-1] / tension[0])
