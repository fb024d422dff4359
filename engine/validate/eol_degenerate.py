"""Stacks of small patches at random angle and offset, full of EIL nodes: the method's claim of robustness."""

from dataclasses import dataclass, field
from math import cos, isclose, radians, sin
from time import perf_counter

import numpy as np

from engine.run.adaptivity import StepTooSmall
from engine.scene.schema import INCH
from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.eol_march import March
from engine.validate.rods import EARTH
from engine.yarns import observe
from engine.yarns.topology import assign

SHARE = 0.34  # of all points that are EIL at the start, the most that the paper met (sec. 5)
GAP_BAR = 1e-3  # of EIL contacts [radii]
NEWTON = 10  # iterations that a step may take ...
SELDOM = 0.01  # ... and the share of steps of the default size that may take more
STEP = 1e-3  # the default size [s]
STEPS = 25  # of each run
LAYERS = (2, 3, 4)


@dataclass(frozen=True)
class Cloth:
    """What the patches of a stack are of."""

    material: str
    pattern: str
    spacing: float  # of neighbouring yarns [m]


COTTON = Cloth("cotton-thick", "plain", 5.6e-3)
DENIM = Cloth("denim", "denim", INCH / 44)  # the jeans pocket's


@dataclass
class Tally:
    """What the runs of one number of layers came to."""

    steps: int = 0  # of the default size
    slow: int = 0  # of these, those that took too many iterations or were rejected
    gap: float = 0.0  # largest [radii]
    least_share: float = 1.0  # of EIL points in the first step
    coincident: int = 0  # runs with nodes at exactly the same place of a yarn
    failed: dict[str, list[int]] = field(default_factory=dict)  # seeds by what was wrong with their runs

    def fail(self, what: str, seed: int) -> None:
        """Note that the run of `seed` was not as it should be."""
        self.failed.setdefault(what, []).append(seed)


@case("eol-degenerate", bar=SELDOM,
      summary="stacks with a third of all points EIL: share of steps that take more than 10 Newton iterations")
def degenerate(quick: bool) -> CaseResult:
    """Thick cotton, whose yarns bend easily."""
    return measure(COTTON, quick)


@case("eol-degenerate-denim", bar=SELDOM,
      summary="as eol-degenerate, of denim of 44 yarns an inch: share of steps that take more than 10 Newton iterations")
def degenerate_denim(quick: bool) -> CaseResult:
    """Denim: light for its stiffness, so that friction gives way within a small part of what yarns move in a step."""
    return measure(DENIM, quick)


def measure(cloth: Cloth, quick: bool) -> CaseResult:
    """Share of slow steps over all seeds; not-a-number, a failed job or an open contact fails besides."""
    seeds = range(20 if quick else 1000)
    rows, tallies = [], []
    for number, layers in enumerate(LAYERS):
        began, tally = perf_counter(), Tally()
        for seed in seeds[number :: len(LAYERS)]:
            run(cloth, seed, layers, tally)
        rows.append(Row("layers", layers, tally.slow / tally.steps, perf_counter() - began))
        tallies.append(tally)
    failed: dict[str, list[int]] = {}
    for tally in tallies:
        for what, of_tally in tally.failed.items():
            failed.setdefault(what, []).extend(of_tally)
    failures = [f"{len(of)} runs {what}, such as seeds {sorted(of)[:5]}" for what, of in failed.items()]
    note = (
        f"{len(seeds)} seeds, {sum(tally.coincident for tally in tallies)} with coincident nodes; at least "
        f"{min(tally.least_share for tally in tallies):.0%} of points EIL at the start; "
        f"largest gap {max(tally.gap for tally in tallies):.1e} radii"
    )
    slow = sum(tally.slow for tally in tallies) / sum(tally.steps for tally in tallies)
    return CaseResult(rows, slow, note=note, failures=failures)


def run(cloth: Cloth, seed: int, layers: int, tally: Tally) -> None:
    """Run the stack of `cloth` and `seed` and count it in `tally`."""
    march, share = stack(cloth, seed, layers)
    tally.least_share = min(tally.least_share, share)
    tally.coincident += has_coincident_nodes(march)
    gap = 0.0
    try:
        for attempt in march.attempts(STEPS * STEP):
            if isclose(attempt.h, STEP):
                tally.steps += 1
                tally.slow += not attempt.report.accepted or attempt.report.newton_iterations > NEWTON
            if attempt.report.accepted:
                gap = max(gap, attempt.report.contact_gap)
    except StepTooSmall:
        tally.fail("fail, no step being small enough", seed)
    except ZeroDivisionError:  # what a kernel raises where a segment has no length
        tally.fail("divide by zero", seed)
    if not all(np.isfinite(values).all() for values in vars(march.state).values()):
        tally.fail("hold what is not a number", seed)
    if not gap <= GAP_BAR:
        tally.fail(f"open a contact by more than {GAP_BAR:g} radii", seed)
    tally.gap = max(tally.gap, gap)


def stack(cloth: Cloth, seed: int, layers: int) -> tuple[March, float]:
    """Return the first stack drawn from `seed` with enough EIL points, and their share."""
    random = np.random.default_rng([seed, layers])
    while True:
        march = March(scene(cloth, random, layers))
        trial = march.state.copy()
        assign(march.model, trial, march.built.settings.safety_distance, STEP, trial.u_rate)
        share = observe.counts(march.model, trial)["eil"] / march.model.point_count
        if share >= SHARE:
            return march, share


def has_coincident_nodes(march: March) -> bool:
    """Whether two nodes lie at exactly the same place of one yarn."""
    places = np.column_stack([march.model.node_yarn, march.state.u])
    return len(np.unique(places, axis=0)) < len(places)


def scene(cloth: Cloth, random: np.random.Generator, layers: int) -> dict:
    """Return a stack on a lowest patch that is held at its edges; gravity presses it together, at random incline."""
    angle, place = 0.0, np.zeros(2)
    fabrics: list[dict] = []
    for layer in range(layers):
        if layer > 0:
            turn, shift = _placed_on(random)
            along = np.array([cos(radians(angle)), sin(radians(angle))])
            place = place + cloth.spacing * (shift[0] * along + shift[1] * np.array([-along[1], along[0]]))
            angle = (angle + turn) % 360.0
        warps, wefts = random.integers(4, 6, size=2)
        fabrics.append({
            "name": f"layer-{layer}", "material": cloth.material, "pattern": cloth.pattern,
            "warps": int(warps), "wefts": int(wefts), "spacing": cloth.spacing,
            "position": [*place, 0.0], "rotation": [0.0, 0.0, angle], "friction": random.uniform(),
            "pins": "none" if layer else "edges",
        })
    down = random.normal(size=3) * [1.0, 1.0, 0.0] - [0.0, 0.0, 2.0]
    return {
        "strandline": 1, "name": "degenerate", "gravity": (EARTH * down / np.linalg.norm(down)).tolist(),
        "duration": 1.0, "step": {"default": STEP}, "fabrics": fabrics,
        "contacts": [
            {"lower": f"layer-{layer}", "upper": f"layer-{layer + 1}", "min_angle": random.choice([10.0, 45.0]),
             "friction": random.choice([0.0, random.uniform()])}
            for layer in range(layers - 1)
        ],
    }


def _placed_on(random: np.random.Generator) -> tuple[float, np.ndarray]:
    """Return angle [deg] and offset [spacings] of a layer in the frame of the one below: yarns on yarns, nearly so, or any."""
    likeness = random.integers(3)
    quarter = 90.0 * random.integers(4)
    if likeness == 0:
        return quarter, random.integers(-1, 2, size=2)
    if likeness == 1:
        return quarter + random.uniform(-5.0, 5.0), random.uniform(-0.1, 0.1, size=2)
    return random.uniform(0.0, 360.0), random.uniform(-1.5, 1.5, size=2)
