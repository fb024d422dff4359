"""A small standing wave in a tank: its frequency against that of linear theory."""

from math import pi, sqrt, tanh

import numpy as np
from scipy.optimize import curve_fit

from engine.liquid.settings import LiquidSettings
from engine.scene.liquid import Wave
from engine.scene.liquid_materials import LiquidMaterial
from engine.validate.catalogue import CaseResult, Row, case, timed_rows
from engine.validate.fit import fitted_exponent
from engine.validate.liquids import EARTH, FLOOR, Vessel, box, ends, liquid, planes, rows

CELLS = (32, 64, 128)  # in a wavelength
JUDGED = 64
STEPS = (25, 50, 100)  # in a period
WAVELENGTH, DEPTH, AMPLITUDE = 1.0, 0.5, 0.01  # [m]; the length of the tank is a wavelength
WIDTH = 4  # cells, after which the tank repeats
PERIODS = 2.0
SETTINGS = LiquidSettings(pressure_tolerance=1e-7)

WAVENUMBER = 2.0 * pi / WAVELENGTH  # [1/m]
OMEGA = sqrt(EARTH * WAVENUMBER * tanh(WAVENUMBER * DEPTH))  # [1/s]


@case("liq-wave", bar=0.02, summary="frequency of a standing gravity wave against omega^2 = g k tanh(k H)")
def wave(quick: bool) -> CaseResult:
    """Relative error of the frequency at 64 cells per wavelength and the shortest step; orders in cells and steps beside it."""
    damping: dict[str, float] = {}
    if quick:
        by_cells = timed_rows("cells per wavelength", CELLS[:1], lambda n: _error(round(n), STEPS[0], damping))
        return CaseResult(by_cells, by_cells[0].error, note=f"at {CELLS[0]} cells per wavelength and {STEPS[0]} steps per period")
    ringing(CELLS[0], STEPS[0])  # compiles the kernels, untimed
    by_cells = rows("cells per wavelength", CELLS, lambda n: _error(round(n), STEPS[-1], damping))
    by_step = rows("dt [period]", [1.0 / count for count in STEPS], lambda h: _error(JUDGED, round(1.0 / h), damping))
    note = f"order {_order(by_cells, -1.0)} in dx, {_order(by_step, 1.0)} in dt; damping ratio " + ", ".join(
        f"{ratio:.2g} at {which}" for which, ratio in damping.items())
    judged = by_cells[CELLS.index(JUDGED)].error
    return CaseResult([*by_cells, *by_step], judged, note=note)


def _error(cells: int, steps: int, damping: dict[str, float]) -> float:
    omega, damping[f"{cells} cells and {steps} steps"] = ringing(cells, steps)
    return abs(omega / OMEGA - 1.0)


def _order(rows: list[Row], sign: float) -> str:
    order = fitted_exponent([row.value for row in rows], [row.error for row in rows])
    return "unknown" if order is None else f"{sign * order:.2g}"


def ringing(cells: int, steps: int) -> tuple[float, float]:
    """Return the frequency of the wave [1/s] and its damping ratio, at so many cells per wavelength and steps per period."""
    model = liquid(LiquidMaterial(density=1000.0), WAVELENGTH / cells, period=(0, WIDTH, 0))
    size = (WAVELENGTH, WIDTH * model.spacing, DEPTH)
    state = box(model, size, wave=Wave(amplitude=AMPLITUDE, wavelength=WAVELENGTH))
    vessel = Vessel(model, state, (0.0, 0.0, -EARTH), planes(FLOOR, *ends(WAVELENGTH)), SETTINGS)
    h = 2.0 * pi / OMEGA / steps
    time = h * np.arange(round(PERIODS * steps) + 1)
    mode = np.empty(len(time))
    for n in range(len(time)):
        if n:
            vessel.step(h)
        mode[n] = state.volume @ np.cos(WAVENUMBER * state.x[:, 0])

    def decaying(t, size, omega, ratio, phase, middle):
        return size * np.exp(-ratio * omega * t) * np.cos(omega * t + phase) + middle

    fit, _ = curve_fit(decaying, time, mode / mode[0], p0=[1.0, OMEGA, 0.0, 0.0, 0.0])
    return float(fit[1]), float(fit[2])
