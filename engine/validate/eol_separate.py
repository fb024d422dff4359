"""Contacts that end: a layer pulled off another, and the end of a rod drawn through a contact (paper sec. 5)."""

from dataclasses import dataclass
from math import ceil, cos, pi
from time import perf_counter

import numpy as np

from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.eol_march import March
from engine.validate.rods import DOWN
from engine.yarns import observe
from engine.yarns.model import PointKind, YarnState

STEPS = (2e-3, 1e-3, 5e-4)  # [s]
PERSISTENCE = (1, 3)  # successive steps of pulling that end a contact
OFFSETS = ((0.23, 0.13), (0.41, 0.36), (0.02, 0.45))  # of the layer from the one below [spacings]
SPACING = 5.6e-3
# stiff enough in bending to follow its weight at once, damped enough to come to rest
COTTON = {"radius": 2.25e-3, "volume_density": 770.0, "youngs_modulus": 5e5, "bending_modulus": 3e5,
          "mass_damping": 100.0}
SETTLED = 0.1  # the layer is at rest from here on [s]
RAMP = 0.03  # in which its weight falls to nothing, like a cosine: too slowly to shake it [s]

KINDS = ("contact", "crossing")  # that of a rod on another: both end where a rod does
SPEEDS = (0.37, 0.11, 1.3)  # at which a rod is drawn [m/s]
LEFT = 0.0213  # of the drawn rod behind the contact at the start [m]
RADIUS = 1e-3  # of the rods [m]

ROUND_OFF = 1e-12
STILL = 1e-3  # how far a uniform motion may be off, in radii and relative to its speed


@dataclass
class Removal:
    """What was seen of contacts that ended, each the worst."""

    early_or_late: float = 0.0  # steps between the end of a contact and its removal
    moved: float = 0.0  # change of x and u by a removal [radii]
    momentum: float = 0.0  # change of momentum by a removal, relative to that of the layer
    elsewhere: float = 0.0  # change of the velocity of segments that the contact did not bound, relative to the fastest
    uneven: float = 0.0  # deviation of rods from uniform motion, in radii and relative to the speed

    def or_worse(self, other: "Removal") -> "Removal":
        """Return the worse of both in every respect."""
        return Removal(*(max(a, b) for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))


@case("eol-separate", bar=0.0, summary="contacts that pull, or leave a rod, end on that step, and nothing else moves")
def separate(quick: bool) -> CaseResult:
    """Steps between the end of a contact and its removal, at most; anything else that moves fails besides."""
    rows, seen = [], Removal()
    for dt in STEPS:
        began, at_step = perf_counter(), Removal()
        for offset in OFFSETS[:1] if quick else OFFSETS:
            for persistence in PERSISTENCE:
                at_step = at_step.or_worse(pulled_off(dt, persistence, offset))
        for kind in KINDS:
            for speed in SPEEDS[:1] if quick else SPEEDS:
                at_step = at_step.or_worse(drawn_through(dt, kind, speed))
        rows.append(Row("dt [s]", dt, at_step.early_or_late, perf_counter() - began))
        seen = seen.or_worse(at_step)
    judged = (
        ("removals move points by {:.2g} radii", seen.moved, ROUND_OFF),
        ("removals change momentum by {:.2g} of itself", seen.momentum, ROUND_OFF),
        ("removals change velocities elsewhere by {:.2g} of the fastest", seen.elsewhere, ROUND_OFF),
        ("rods leave their uniform motion by {:.2g}", seen.uneven, STILL),
    )
    note = (
        "a removal leaves every position and every segment's velocity as they are, but for the two segments that the "
        f"contact bounded: they become one and keep their momentum, to {seen.momentum:.0e} of the layer's"
    )
    failures = [said.format(value) for said, value, most in judged if not value <= most]
    return CaseResult(rows, seen.early_or_late, note="" if failures else note, failures=failures)


def pulled_off(dt: float, persistence: int, offset: tuple[float, float]) -> Removal:
    """A layer at rest on a fixed one, whose weight is turned upwards: then, and not before, every contact pulls."""
    march = March(layers(dt, offset))
    contacts = np.flatnonzero(march.model.point_kind == PointKind.CONTACT)
    march.reach(SETTLED)
    seen = Removal()
    turned = round(RAMP / dt)  # the first step whose weight points upwards, counted from 0
    for step in range(2 * turned):
        march.pull(DOWN * cos(0.5 * pi * (step + 0.5) / turned), separation_time=persistence * dt, separation_force=0.0)
        before = march.state.copy()
        march.reach(SETTLED + (step + 1) * dt)
        ended = contacts[before.active[contacts] & ~march.state.active[contacts]]
        if len(ended):
            seen = seen.or_worse(_compare_with_held(march, before, dt))
            seen.early_or_late = max(seen.early_or_late, abs(step - (turned + persistence - 1)))
    if march.state.active[contacts].any():
        seen.early_or_late = np.inf
    return seen


def _compare_with_held(march: March, before: YarnState, dt: float) -> Removal:
    """Repeat the last step without removing anything, and say what the removal changed."""
    m, state, held = march.model, march.state, before.copy()
    stepper = march.stepper
    march.pull(stepper.gravity, separation_time=np.inf, separation_force=0.0)
    march.stepper.step(held, march.time - dt, dt)
    new, old = observe.chain_now(m, state), observe.chain_now(m, held)
    kept = new.node[(new.after[new.node] >= 0) & np.isin(new.node, old.node)]
    kept = kept[new.after[kept] == old.after[kept]]
    ends = new.after[kept]
    elsewhere = [state.velocity[kept, 1] - held.velocity[kept, 1], state.velocity[ends, 0] - held.velocity[ends, 0]]
    change = observe.momentum(m, state) - observe.momentum(m, held)
    fastest = np.abs(held.velocity).max()
    return Removal(
        moved=float(max(np.abs(state.x - held.x).max(), np.abs(state.u - held.u).max()) / COTTON["radius"]),
        momentum=float(np.linalg.norm(change) / (march.free_mass * fastest)),
        elsewhere=float(np.max(np.abs(elsewhere), initial=0.0) / fastest),
    )


def drawn_through(dt: float, kind: str, speed: float) -> Removal:
    """A rod drawn over another until its end has passed: the contact is there up to that step."""
    march = March(rods(dt, kind, speed))
    m, state = march.model, march.state
    contact = int(np.flatnonzero(m.point_nodes[:, 1] >= 0)[0])
    of_node = np.where((m.node_yarn == 0)[:, None], [-speed, 0.0, 0.0], 0.0)  # velocity of the material
    of_point = np.zeros((m.point_count, 3))
    of_point[m.node_point[m.u_fixed]] = of_node[m.u_fixed]
    start = state.x.copy()
    state.velocity[:], state.x_rate[:] = of_node[:, None], of_point
    state.u_rate[m.point_nodes[contact, 0]] = speed
    ended = ceil(LEFT / (speed * dt))  # the first step at whose end the contact is off the rod
    removed = np.inf
    seen = Removal()
    for step in range(1, ended + 5):
        march.reach(step * dt)
        if not march.state.active[contact]:
            removed = min(removed, step)
        here = np.flatnonzero(march.state.active)
        chain = observe.chain_now(m, march.state)
        inner = chain.node[(chain.before[chain.node] >= 0) & (chain.after[chain.node] >= 0)]
        off = np.abs(march.state.x - start - step * dt * of_point)[here].max() / RADIUS
        faster = np.abs(march.state.velocity - of_node[:, None])[inner].max(initial=0.0) / speed
        seen.uneven = max(seen.uneven, float(off), float(faster))
    seen.early_or_late = abs(removed - ended)
    return seen


def layers(dt: float, offset: tuple[float, float]) -> dict:
    """Return a layer on a fixed one, `offset` from its weave [spacings]."""
    fabric = {"material": "cotton", "spacing": SPACING}
    place = [SPACING * offset[0], SPACING * offset[1], 0.0]
    return {
        "strandline": 1, "name": "layers", "gravity": DOWN.tolist(), "duration": 1.0, "step": {"default": dt},
        "materials": {"cotton": COTTON},
        "fabrics": [
            fabric | {"name": "fixed", "warps": 9, "wefts": 9, "kinematic": True},
            fabric | {"name": "layer", "warps": 5, "wefts": 5, "position": place},
        ],
        "contacts": [{"lower": "fixed", "upper": "layer"}],
    }


def rods(dt: float, kind: str, speed: float) -> dict:
    """Return a rod along x that a handle draws over another, from which it has a given length left."""
    held, length = {"hold": "pinned"}, 0.05
    drawn = held | {"handle": "hand"}
    return {
        "strandline": 1, "name": "rods", "gravity": [0.0, 0.0, 0.0], "duration": 1.0, "step": {"default": dt},
        "materials": {"cord": {"radius": RADIUS, "linear_density": 3e-3, "stretch_stiffness": 50.0}},
        "yarns": [
            {"name": "drawn", "material": "cord", "points": [[0, 0, 0], [length - LEFT, 0, 0], [length, 0, 0]],
             "segments": 5, "start": drawn},
            {"name": "still", "material": "cord", "start": held, "end": held, "length_factor": 0.95,
             "points": [[length - LEFT, y, 0] for y in (-0.03, 0, 0.03)]},
        ],
        "crossings": [
            {"lower": {"yarn": "still", "point": 1}, "upper": {"yarn": "drawn", "point": 1}, "kind": kind},
        ],
        "script": {"handles": [
            {"name": "hand", "keyframes": [{"time": t, "offset": [-speed * t, 0, 0]} for t in (0.0, 1.0)]},
        ]},
    }
