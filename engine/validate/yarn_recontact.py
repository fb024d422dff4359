"""Contacts that begin in motion: a layer lifted off another and dropped back, two that collide, and one that slides on."""

from dataclasses import dataclass
from math import cos, radians, sin
from time import perf_counter

import numpy as np

from engine.arrays import Floats
from engine.steppers.step_report import StepReport
from engine.validate import eol_fabrics, eol_separate
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.eol_march import March
from engine.validate.eol_separate import COTTON, SPACING
from engine.validate.rods import DOWN, EARTH
from engine.yarns import observe
from engine.yarns.model import PointKind
from engine.yarns.removal import remove

STEPS = (2e-3, 1e-3, 5e-4)  # [s]
OFFSETS = ((0.23, 0.13), (0.41, 0.36))  # of the layer from the one below [spacings]
LIFT = np.array([0.0, 0.0, 3.0 * EARTH])
LIFTED, LANDED = 0.02, 0.12  # the layer is pulled up to here, and has come to rest by there [s]
SPEED = 0.4  # at which layers in flight approach each other [m/s]
APART = 0.4  # by which they are apart at first [radii]
REACH = 4 * SPACING  # beyond their ends, in which yarns of the sliding layer come to touch others
LIMP = 0.03  # times the stiffness in bending of the thick cotton, so that the ends of yarns hang below those they come to

TIGHT = 1e-6  # tolerance of residual forces in flight, whose sum is what momentum changes by

MOMENTUM_BAR = 1e-8  # change relative to the momentum of the thrown layer
ACCELERATION_BAR = 0.02


@dataclass
class Seen:
    """What was seen of contacts that begin, each the worst or the sum."""

    depth: float = 0.0  # of a layer below the other, where their yarns cross [radii]
    added: int = 0
    removed: int = 0
    gap: float = 0.0  # with which a contact began [radii]


@case("yarn-recontact", bar=0.1,
      summary="a layer dropped on another comes to rest on it; momentum stays, and what slides on slides as before")
def recontact(quick: bool) -> CaseResult:
    """Depth to which yarns pass through each other [radii]; the bar is a tenth of what layers without thickness neglect."""
    dropped(STEPS[0], OFFSETS[0])  # compiles the kernels, untimed
    rows, seen = [], Seen()
    for dt in STEPS:
        began = perf_counter()
        falls = [dropped(dt, offset) for offset in (OFFSETS[:1] if quick else OFFSETS)]
        worst = max(falls, key=lambda fall: fall.depth)
        rows.append(Row("dt [s]", dt, worst.depth, perf_counter() - began))
        seen = max(seen, worst, key=lambda fall: fall.depth)
    through = dropped(STEPS[1], OFFSETS[0], dynamic_contacts=False)
    drift, collided = flown(STEPS[1])
    off, slid = slid_on(1.0, STEPS[1])
    off_before, slid_before = slid_on(1.0, STEPS[1], dynamic_contacts=False)
    judged = (
        ("momentum drifts by {:.2g}", drift, MOMENTUM_BAR),
        ("the sliding layer is off by {:.2g} of its acceleration", abs(off), ACCELERATION_BAR),
        ("the sliding layer is {:.2g} radii deeper with new contacts", slid.depth - slid_before.depth, 0.0),
        ("contacts that failed to begin: {:g}", float(min(seen.added, collided.added, slid.added) == 0), 0.0),
    )
    note = (
        f"dropped without new contacts: {through.depth:.3g} radii deep at the end; momentum drifts by {drift:.1e}, in "
        f"proportion to the tolerance, over {collided.added} new contacts of layers in flight; sliding: acceleration off by "
        f"{off:+.2%} with {slid.added} new contacts, {slid.depth:.3g} radii deep, without them by {off_before:+.2%} and "
        f"{slid_before.depth:.3g} radii; contacts begin with gaps of {max(seen.gap, collided.gap, slid.gap):.2g} radii at most"
    )
    failures = [said.format(value) for said, value, most in judged if not value <= most]
    return CaseResult(rows, seen.depth, note=note, failures=failures)


def dropped(dt: float, offset: tuple[float, float], dynamic_contacts: bool = True) -> Seen:
    """A layer at rest on a fixed one, lifted off until no contact is left, and let fall."""
    march, seen = March(eol_separate.layers(dt, offset)), Seen()
    march.pull(LIFT, dynamic_contacts=dynamic_contacts)
    _watch(march, LIFTED, seen)
    march.pull(DOWN, dynamic_contacts=dynamic_contacts)
    _watch(march, LANDED, seen)
    return seen


def flown(dt: float) -> tuple[float, Seen]:
    """Two free layers that collide in free fall: the largest change of momentum, relative to that of the one thrown."""
    scene = eol_separate.layers(dt, OFFSETS[0])
    for fabric in scene["fabrics"]:
        fabric["kinematic"] = False
    scene["materials"]["cotton"] = COTTON | {"mass_damping": 0.0}
    march, seen = March(scene), Seen()
    model, state = march.model, march.state
    remove(model, state, np.flatnonzero(model.point_kind == PointKind.CONTACT))
    upper = model.fabric[model.node_yarn] == 1
    state.x[model.node_point[upper], 2] += APART * COTTON["radius"]
    state.velocity[upper, :, 2] = -SPEED
    march.pull(DOWN, dynamic_contacts=True, tolerance=TIGHT)
    before, drift = observe.momentum(model, state), 0.0
    for attempt in march.attempts(4 * APART * COTTON["radius"] / SPEED):
        _note(attempt.report, seen)
        fallen = observe.momentum(model, march.state) - march.free_mass * march.time * DOWN
        drift = max(drift, float(np.linalg.norm(fallen - before)))
    return drift / float(np.linalg.norm(before)), seen


def slid_on(mu: float, dt: float, dynamic_contacts: bool = True) -> tuple[float, Seen]:
    """Return the relative error of the acceleration of a layer that slides down a steep slope onto new yarns."""
    scene = eol_fabrics.scene(mu, 0.0, dt)
    scene["contacts"][0]["reach"] = REACH
    cotton = scene["materials"]["cotton"]
    scene["materials"]["cotton"] = cotton | {"bending_modulus": LIMP * cotton["bending_modulus"]}
    march, seen = March(scene), Seen()
    march.pull(DOWN, dynamic_contacts=dynamic_contacts)
    march.reach(eol_fabrics.SETTLED)
    slope = radians(eol_fabrics.STEEP)
    march.pull(EARTH * np.array([sin(slope), 0.0, -cos(slope)]), dynamic_contacts=dynamic_contacts)
    speeds = _watch(march, eol_fabrics.SETTLED + eol_fabrics.SLID, seen)
    measured = np.polyfit(speeds[:, 0], speeds[:, 1], 1)[0]
    return float(measured / (EARTH * (sin(slope) - mu * cos(slope))) - 1.0), seen


def _watch(march: March, until: float, seen: Seen) -> Floats:
    """Step on, see how deep the free layer gets, and return times and its speeds along x, shape [steps, 2]."""
    speeds = []
    for attempt in march.attempts(until):
        if attempt.report.accepted:
            _note(attempt.report, seen)
            seen.depth = max(seen.depth, depth(march))
            speeds.append((attempt.time, observe.momentum(march.model, march.state)[0] / march.free_mass))
    return np.array(speeds)


def _note(report: StepReport, seen: Seen) -> None:
    seen.added, seen.removed = seen.added + report.added, seen.removed + report.removed
    seen.gap = max(seen.gap, report.addition_gap)


def depth(march: March) -> float:
    """Return how deep the free layer is below the fixed one, where their yarns cross in plan [radii].

    The fixed yarns are straight, level at z = 0 and along x or y, so it is the height of a free yarn where it crosses one.
    """
    m, state = march.model, march.state
    chain = observe.chain_now(m, state)
    lines = [state.x[m.node_point[chain.node[chain.start[y] : chain.start[y + 1]]]] for y in range(m.yarn_count)]
    lowest = 0.0
    for axis in (0, 1):  # along which the free yarns run
        along = np.array([np.abs(line[-1] - line[0]).argmax() for line in lines])
        fixed = [line for line, given in zip(lines, m.kinematic & (along != axis), strict=True) if given]
        place = np.array([line[0, axis] for line in fixed])
        ends = np.array([[line[:, 1 - axis].min(), line[:, 1 - axis].max()] for line in fixed])
        for line, free in zip(lines, ~m.kinematic & (along == axis), strict=True):
            if free:
                beside, height = (np.interp(place, line[:, axis], line[:, k], np.nan, np.nan) for k in (1 - axis, 2))
                over = (ends[:, 0] <= beside) & (beside <= ends[:, 1])
                lowest = min(lowest, float(height[over].min(initial=0.0)))
    return -lowest / COTTON["radius"]
