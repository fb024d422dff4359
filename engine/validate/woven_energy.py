"""Closed systems of woven cloth in free flight, layers that slide on each other or one with crimp, never gain energy."""

from time import perf_counter

import numpy as np

from engine.validate.catalogue import CaseResult, Row, case
from engine.validate.eol_march import March
from engine.validate.rods import WEIGHTLESS
from engine.yarns import observe

SPACING, YARNS = 5.6e-3, 5
COTTON = {"radius": 0.6e-3, "linear_density": 1e-3, "stretch_stiffness": 8.0, "bending_stiffness": 1e-6, "shear_stiffness": 0.08}
FRICTION = (0.0, 0.5)
CRIMP = ("flat", "set")
THROWN, STIRRED = 0.2, 0.05  # speed of a layer along the other, and of its yarns besides, at random [m/s]
DURATION = 0.03  # over which the layers slide by a spacing [s]
BAR = 1e-8


@case("woven-energy", bar=BAR, summary="cloth in free flight, two layers or with crimp: largest rise of energy over the start's")
def energy(quick: bool) -> CaseResult:
    """Largest rise over the least energy up to then, relative to the energy of the start, with and without friction."""
    rows, notes = [], []
    steps = (2e-3, 1e-3) if quick else (2e-3, 1e-3, 5e-4, 2.5e-4)
    for crimp in CRIMP:
        rise(FRICTION[0], steps[0], crimp)  # compiles the kernels, untimed
    for dt in steps:
        began = perf_counter()
        risen = {(mu, crimp): rise(mu, dt, crimp) for crimp in CRIMP for mu in FRICTION}
        rows.append(Row("dt [s]", dt, max(worst for worst, _ in risen.values()), perf_counter() - began))
        notes += [f"{dt:g} s, mu = {mu:g}, crimp {crimp}: rises by {worst:.1e}, {left:.0%} left"
                  for (mu, crimp), (worst, left) in risen.items()]
    return CaseResult(rows, max(row.error for row in rows), note="; ".join(notes))


def rise(mu: float, dt: float, crimp: str) -> tuple[float, float]:
    """Return the largest rise of energy and the energy at the end, both relative to that of the start."""
    march = March(scene(mu, dt, crimp))
    model, state = march.model, march.state
    random = np.random.default_rng(7)
    of_yarn = random.normal(scale=STIRRED, size=(model.yarn_count, 3)) + np.outer(model.fabric, [THROWN, 0.3 * THROWN, 0.0])
    state.velocity[:] = of_yarn[model.node_yarn][:, None]

    def now() -> float:
        return sum(observe.energies(model, march.state, WEIGHTLESS).values())

    start = least = now()
    worst = 0.0
    for attempt in march.attempts(DURATION):
        if attempt.report.accepted:
            worst, least = max(worst, now() - least), min(least, now())
    return worst / start, now() / start


def scene(mu: float, dt: float, crimp: str) -> dict:
    """Return two undamped layers that nothing holds, one on the other or, with crimp, apart; contacts that pull stay."""
    fabric = {"material": "cotton", "spacing": SPACING, "warps": YARNS, "wefts": YARNS, "friction": mu,
              "crimp": crimp}
    return {
        "strandline": 1, "name": "closed", "gravity": WEIGHTLESS.tolist(), "duration": 1.0,
        "step": {"default": dt, "separation_time": 10.0},
        "materials": {"cotton": COTTON},
        "fabrics": [
            fabric | {"name": "lower"},
            fabric | {"name": "upper", "position": [0.23 * SPACING, 0.37 * SPACING, 0.0 if crimp == "flat" else SPACING]},
        ],
        "contacts": [{"lower": "lower", "upper": "upper", "friction": mu}] if crimp == "flat" else [],
    }
