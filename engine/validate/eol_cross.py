"""Two rods driven along a third from opposite sides: their contacts pass through each other (paper Fig. 2c)."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, cos, inf, radians, sin
from time import perf_counter

import numpy as np

from engine.run.adaptivity import StepTooSmall
from engine.steppers.yarns import largest_tension
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.eol_march import March
from engine.yarns import observe
from engine.yarns.model import PointKind

STEPS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)  # [s]
BAR = 0.05  # how far a force may exceed the one away from the crossing, relative to that
FOLLOWS = 0.5  # how far a contact may lag behind the handles of its rod [radii]
STIFFNESS = 50.0  # k_s [N]
RADIUS = 1e-3  # [m]
SEGMENT = 0.05  # undeformed, of the rail [m]
CLEAR = 0.012  # between the contacts at the start and at the end, at the least [m]: more than the safety distance
APPROACH = 6  # steps before they meet, at the least


@dataclass(frozen=True)
class Crossing:
    """One run: everything but the step is drawn at random."""

    dt: float  # [s]
    speeds: tuple[float, float]  # of the two rods, towards each other [m/s]
    phase: float  # of the encounter within a step, 0 to 1
    strain: float  # of all rods, which sets the force away from the crossing
    angles: tuple[float, float]  # of the two rods with the third [deg]

    @property
    def gap(self) -> float:
        """Distance of the contacts at the start [m]; the encounter is at `phase` within a step."""
        closing = sum(self.speeds) * self.dt
        return (max(ceil(CLEAR / closing), APPROACH) + self.phase) * closing

    @property
    def duration(self) -> float:
        """Until the contacts are as far apart as at the start [s]."""
        return 2.0 * self.gap / sum(self.speeds)


@case("eol-cross", bar=BAR, summary="two contacts pass through each other along a rod without a spike of force")
def cross(quick: bool) -> CaseResult:
    """Worst excess of the internal force over the one away from the crossing, which in straight rods is k_s strain."""
    runs = 30 if quick else 1000
    draws = np.random.default_rng(20).spawn(runs)
    excess(draw(np.random.default_rng(0), STEPS[0]))  # compiles the kernels, untimed
    rows, failures = [], []
    strays = 0.0
    for number, dt in enumerate(STEPS):
        began, worst = perf_counter(), 0.0
        for draw_of_run in draws[number :: len(STEPS)]:
            run = draw(draw_of_run, dt)
            over, strayed = excess(run)
            worst, strays = max(worst, over), max(strays, strayed)
            if not np.isfinite(over):
                failures.append(f"no step is small enough in {run}")
        rows.append(Row("dt [s]", dt, worst, perf_counter() - began))
        if excess(draw(draws[number], dt), eil=False)[0] <= BAR:
            failures.append(f"without EIL nodes the force stays even as well at dt = {dt:g} s, so this shows nothing")
    if not strays <= FOLLOWS:
        failures.append(f"a contact strays {strays:.3g} radii from the prescribed motion")
    note = (
        f"{runs} runs; contacts within {strays:.1e} radii of the prescribed motion, the lag that the viscous hold of u "
        "leaves at the longest step; without EIL nodes the rods do not pass"
    )
    return CaseResult(rows, max(row.error for row in rows), note="" if failures else note, failures=failures[:3])


def draw(random: np.random.Generator, dt: float) -> Crossing:
    """Return a run with the step dt [s]."""
    first, second = 10.0 ** random.uniform(-0.7, 0.3, size=2)
    # exactly coincident contacts at the end of a step, once in four runs
    phase = 0.0 if random.random() < 0.25 else random.random()
    a, b = random.uniform(30.0, 150.0, size=2)
    return Crossing(dt, (first, second), phase, 10.0 ** random.uniform(-2, -1), (a, b))


def excess(run: Crossing, eil: bool = True) -> tuple[float, float]:
    """Return the largest relative excess of the tension, and how far contacts strayed [radii]; inf if it broke off."""
    march = March(scene(run, eil))
    set_in_motion(march, run)
    contacts = np.flatnonzero(march.model.point_kind == PointKind.CROSSING)
    start, velocity = march.state.x[contacts].copy(), march.state.x_rate[contacts].copy()
    worst = strayed = 0.0
    try:
        for attempt in march.attempts(run.duration):
            if attempt.report.accepted:
                worst = max(worst, _tension(march) / (STIFFNESS * run.strain) - 1.0)
                off = march.state.x[contacts] - start - attempt.time * velocity
                strayed = max(strayed, float(np.abs(off).max()) / RADIUS, attempt.report.contact_gap)
    except StepTooSmall:
        return inf, inf
    return worst, strayed


def _tension(march: March) -> float:
    m, s = march.model, march.state
    chain = observe.chain_now(m, s)
    return largest_tension(chain.node, chain.after, m.node_yarn, m.node_point, m.stretch_stiffness, s.x, s.u)


def set_in_motion(march: March, run: Crossing) -> None:
    """Let the rods begin at the speed at which they are driven: what follows is uniform motion."""
    m, s = march.model, march.state
    for handle, speed in enumerate((run.speeds[0], -run.speeds[1])):
        velocity = np.array([speed, 0.0, 0.0])
        held = np.flatnonzero(m.handle == handle)
        of_rod = m.node_yarn == m.node_yarn[m.point_nodes[held[0], 0]]
        s.velocity[of_rod] = velocity
        s.x_rate[m.node_point[of_rod]] = velocity
        contact = m.node_point[of_rod & (m.point_kind[m.node_point] == PointKind.CROSSING)]
        on_rail = m.point_nodes[contact][m.node_yarn[m.point_nodes[contact]] == 0]
        s.u_rate[on_rail] = speed / (1.0 + run.strain)


def scene(run: Crossing, eil: bool) -> dict:
    """Return the rail along x, of whole segments, and the two rods on it, all straight and evenly stretched."""
    gap = run.gap
    segments = ceil((3 * gap + 2 * SEGMENT) / SEGMENT)  # no rod comes to the end of the rail
    reach = segments * SEGMENT / 2 * (1 + run.strain)
    rod = {"material": "cord", "length_factor": 1 / (1 + run.strain)}
    pinned = {"hold": "pinned"}
    rail = [[x, 0.0, 0.0] for x in (-reach, -gap / 2, gap / 2, reach)]
    held = {name: {"start": pinned | {"handle": name}, "end": pinned | {"handle": name}} for name in ("a", "b")}
    return {
        "strandline": 1, "name": "cross", "gravity": [0.0, 0.0, 0.0], "duration": run.duration,
        "step": {"default": run.dt, "eil": eil},
        "materials": {"cord": {"radius": RADIUS, "linear_density": 3e-3, "stretch_stiffness": STIFFNESS}},
        "yarns": [
            rod | {"name": "rail", "points": rail, "segments": segments, "start": pinned, "end": pinned},
            rod | held["a"] | {"name": "a", "points": _rod_points(-gap / 2, run.angles[0])},
            rod | held["b"] | {"name": "b", "points": _rod_points(gap / 2, run.angles[1])},
        ],
        "crossings": [
            {"lower": {"yarn": "rail", "point": 1}, "upper": {"yarn": "a", "point": 1}},
            {"lower": {"yarn": "b", "point": 1}, "upper": {"yarn": "rail", "point": 2}},
        ],
        "script": {"handles": [
            {"name": "a", "keyframes": list(_keyframes(run.duration, run.speeds[0]))},
            {"name": "b", "keyframes": list(_keyframes(run.duration, -run.speeds[1]))},
        ]},
    }


def _rod_points(x: float, angle: float) -> list[list[float]]:
    half = 0.03 * np.array([cos(radians(angle)), sin(radians(angle)), 0.0])
    return [([x, 0.0, 0.0] + side * half).tolist() for side in (-1, 0, 1)]


def _keyframes(duration: float, speed: float) -> Iterator[dict]:
    for time in (0.0, duration):
        yield {"time": time, "offset": [time * speed, 0.0, 0.0]}
