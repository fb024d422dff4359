"""Stress of one point of liquid: the plastic return against its ODE, and simple shear against eq. 13.12 and the rheometer."""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from scipy.integrate import solve_ivp

from engine.arrays import Floats
from engine.liquid.rheology import analytic_return, deviator, implicit_return, shear
from engine.scene.liquid_materials import LIQUID_PRESETS, LiquidConstants, liquid_constants
from engine.validate.catalogue import CaseResult, case, timed_rows
from engine.validate.fit import fitted_exponent

INDICES = (0.2, 0.22, 0.27, 0.3162, 0.5, 0.5173, 0.62, 0.8, 0.98, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.02, 1.2, 1.5)
LOSSES = tuple(10.0**k for k in range(-6, 7))  # of excess stress at its first rate, over the excess
TRIAL, YIELD, CONSISTENCY, MODULUS = 80.0, 26.0, 27.2, 290.0  # of a shaving cream: [Pa], [Pa], [Pa s^n], [Pa]
NOTHING = 1e-13  # of the trial stress, below which excess is not followed

LIQUIDS = {name: liquid_constants(material) for name, material in LIQUID_PRESETS.items() if material.shear_modulus}
RATES = (1e-2, 1e-1, 1.0, 10.0, 100.0, 1000.0)  # [1/s]
QUICK = (("shaving-cream", "milk-chocolate"), (10.0,))
SCHEMES = ((False, False), (True, True))  # of (backward Euler, volume kept): the thesis's, and one with neither of its faults
SPAN, LONGEST = 3.0, 2.0  # strain of a run, from rest into steady flow: over the elastic strain of the law's stress; at most
LOOKS = 4  # at a run, evenly spaced
STEPS = (2**14, 2**16, 2**18, 2**21)  # of a run
STEADY = 20.0  # strain after which flow is steady, over the elastic strain of the law's stress
STIFFER = (1.0, 30.0, 1000.0)  # than the preset
FALLS = 30.0  # at least, from each to the next: of strain by as much, of the square of strain at best
LAW_BAR = 1e-4  # relative, for the stiffest
NOISE = 1e-7  # of what ODEs tell of it
START = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)


@case("liq-plastic", bar=1e-10, summary="plastic return of eq. 14.9 against the ODE of eq. 14.16, over the trial stress")
def plastic(quick: bool) -> CaseResult:
    """Worst error of stress over flow indices, and steps that lose from 1e-6 to 1e6 of the excess at its first rate."""
    first_order = []

    def error(n: float) -> float:
        first_rate = ((TRIAL - YIELD) / CONSISTENCY) ** (1.0 / n)
        worst = 0.0
        for loss in LOSSES:
            h = loss * (TRIAL - YIELD) / (2.0 * MODULUS * first_rate)
            exact = _flowed_stress(n, h)
            arguments = (TRIAL, MODULUS, h, YIELD, CONSISTENCY, n)
            worst = max(worst, abs(analytic_return(*arguments)[0] - exact) / TRIAL)
            first_order.append(abs(implicit_return(*arguments)[0] - exact) / TRIAL)
        return worst

    rows = timed_rows("n", INDICES[::3] if quick else INDICES, error)
    return CaseResult(rows, max(row.error for row in rows), note=f"backward Euler is within {max(first_order):.2g} of one step")


def _flowed_stress(n: float, h: float) -> float:
    """Return s [Pa] after h [s] of eq. 14.16, from TRIAL on, by a method of order 8."""
    def rate(_, s):
        return -2.0 * MODULUS * (np.maximum(s - YIELD, 0.0) / CONSISTENCY) ** (1.0 / n)

    def at_yield(_, s):
        return s[0] - YIELD - NOTHING * TRIAL

    at_yield.terminal = True  # type: ignore[attr-defined]
    run = solve_ivp(rate, (0.0, h), [TRIAL], method="DOP853", rtol=2.3e-14, atol=1e-13, events=at_yield)
    return float(run.y[0, -1])


@case("liq-rheometer", bar=1e-6, order=0.99, summary="simple shear of all presets, 1e-2 to 1e3 1/s, against eq. 13.12 as an ODE")
def rheometer(quick: bool) -> CaseResult:
    """Worst relative error of shear stress from rest into steady flow, of both schemes; the rheometer's law beside it."""
    names, rates = QUICK if quick else (tuple(LIQUIDS), RATES)
    runs = [(LIQUIDS[name], rate, *scheme) for name in names for rate in rates for scheme in SCHEMES]
    references = [_reference(liquid, rate, keeps) for liquid, rate, _, keeps in runs]

    def error(step: float) -> float:
        return max(_error(*run, round(1.0 / step), exact) for run, exact in zip(runs, references, strict=True))

    rows = timed_rows("dt [run]", [1.0 / steps for steps in STEPS], error)
    failures, notes = [], []
    for name in names:
        off = np.array([[_off_the_law(LIQUIDS[name], rate, stiffer) for stiffer in STIFFER] for rate in rates])
        if not (np.all(off[:, 1:] <= off[:, :-1] / FALLS + NOISE) and np.all(off[:, -1] <= LAW_BAR)):
            failures.append(f"{name}: off the rheometer's law by {off.max(axis=0)} for a shear modulus times {STIFFER}")
        notes.append(f"{name} {100.0 * off[:, 0].min():.2g} to {100.0 * off[:, 0].max():.2g} %")
    order = fitted_exponent([row.value for row in rows], [row.error for row in rows])
    note = f"with volume kept, steady flow is below the rheometer's law by finite strain: {', '.join(notes)}"
    return CaseResult(rows, rows[-1].error, order, note, failures)


def law(liquid: LiquidConstants, rate: float) -> float:
    """Return the shear stress [Pa] that a rheometer shows at a `rate` [1/s] where elastic strain is small."""
    return liquid.yield_stress / sqrt(3.0) + liquid.consistency / sqrt(2.0) * (rate / sqrt(2.0)) ** liquid.flow_index


def _off_the_law(liquid: LiquidConstants, rate: float, stiffer: float) -> float:
    """Return how far steady stress is from the law, over the law, where volume is kept: otherwise b is never steady."""
    liquid = liquid._replace(shear_modulus=stiffer * liquid.shear_modulus)
    stress = law(liquid, rate)
    flowing = sheared_strain(liquid, rate, [STEADY * stress / (liquid.shear_modulus * rate)], keeps=True)[-1]
    return abs(liquid.shear_modulus * flowing[0, 1] / stress - 1.0)


def _looks(liquid: LiquidConstants, rate: float) -> Floats:
    strain = min(SPAN * law(liquid, rate) / liquid.shear_modulus, LONGEST)
    return np.linspace(0.0, strain / rate, LOOKS + 1)[1:]


def _reference(liquid: LiquidConstants, rate: float, keeps: bool) -> Floats:
    b = sheared_strain(liquid, rate, _looks(liquid, rate), keeps)
    return b - np.trace(b, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)


def _error(liquid: LiquidConstants, rate: float, implicit: bool, keeps: bool, steps: int, exact: Floats) -> float:
    """Return the worst error of shear stress at all looks, over its norm then."""
    h = _looks(liquid, rate)[-1] / steps
    sigma = sqrt(2.0 / 3.0) * liquid.yield_stress
    b, worst = START, 0.0
    for wanted in exact:
        b = shear(b, rate, h, steps // LOOKS, liquid.shear_modulus, sigma, liquid.consistency, liquid.flow_index, implicit, keeps)
        xx, yy, zz, yz, xz, xy = deviator(b)
        found = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        worst = max(worst, float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted)))
    return worst


def sheared_strain(liquid: LiquidConstants, rate: float, times: Sequence[float] | Floats, keeps: bool) -> Floats:
    """Return b [T, 3, 3] at `times` [s] after rest, in simple shear at a `rate` [1/s], by a method of order 8.

    By eq. 13.12; where volume is kept, with as much of I in the flow as that takes.
    """
    gradient = np.zeros((3, 3))
    gradient[0, 1] = rate

    def change(_, flat):
        b = flat.reshape(3, 3)
        trace = np.trace(b)
        dev = b - trace / 3.0 * np.eye(3)
        size = np.linalg.norm(dev)
        excess = liquid.shear_modulus * size - sqrt(2.0 / 3.0) * liquid.yield_stress
        flow = np.zeros((3, 3))
        if excess > 0.0:
            flow = 2.0 / 3.0 * trace * (excess / liquid.consistency) ** (1.0 / liquid.flow_index) * dev / size
            if keeps:
                inverse = np.linalg.inv(b)
                flow -= np.trace(inverse @ flow) / np.trace(inverse) * np.eye(3)
        return (gradient @ b + b @ gradient.T - flow).ravel()

    with np.errstate(all="ignore"):  # where it tries too long a step, flow overflows and the step is refused
        run = solve_ivp(change, (0.0, times[-1]), np.eye(3).ravel(), method="DOP853", t_eval=times, rtol=1e-11, atol=1e-13)
    return run.y.T.reshape(-1, 3, 3)
