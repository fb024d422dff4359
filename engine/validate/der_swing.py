"""A cantilever let go from level: its swing under gravity against an independent solve, with both integrators."""

from functools import partial
from typing import get_args

import numpy as np
from scipy.integrate import solve_ivp

from engine.arrays import Floats
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandMaterial
from engine.strands.settings import StrandSettings
from engine.validate.catalogue import CaseResult, Row, case, timed_rows
from engine.validate.der_order import ORDERS, Integrator
from engine.validate.fit import fitted_exponent
from engine.validate.strands import EARTH, cantilever

SEGMENTS, LENGTH, RADIUS = 12, 0.2, 1e-3  # [m]
RUBBER = StrandMaterial(density=1000.0, young=2e7, shear=7e6, damping=2e-3)  # bends by gravity, Gamma = 16
DURATION = 0.32  # [s], of the swing to the far side and half of the way back
STEPS = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4)  # [s]


@case("der-swing", bar=1e-3, order=ORDERS["bdf2"], summary="cantilever let go from level: places at the end of its swing")
def swing(quick: bool) -> CaseResult:
    """Largest error of a vertex over the length at the end, with BDF2; that of implicit Euler beside it, at equal steps."""
    wanted = chain_places()
    rows: dict[Integrator, list[Row]] = {}
    for integrator in get_args(Integrator):
        error = partial(_error, integrator, wanted)
        rows[integrator] = timed_rows(f"dt [s], {integrator}", STEPS[:4] if quick else STEPS, error)
    orders = {name: fitted_exponent([row.value for row in own], [row.error for row in own]) or 0.0 for name, own in rows.items()}
    gains = ", ".join(f"{a.error / b.error:.3g}" for a, b in zip(rows["euler"], rows["bdf2"], strict=True))
    note = f"order of euler {orders['euler']:.2f}; at equal steps its error is {gains} times that of bdf2"
    return CaseResult(rows["euler"] + rows["bdf2"], rows["bdf2"][-1].error, order=orders["bdf2"], note=note)


def _error(integrator: Integrator, wanted: Floats, h: float) -> float:
    model, state = cantilever(SEGMENTS, LENGTH, RADIUS, RUBBER)
    settings = StrandSettings(integrator=integrator, tolerance=1e-8, contact="none")
    stepper = StrandStepper(model, np.array([0.0, 0.0, -EARTH]), settings)
    for _ in range(round(DURATION / h)):
        report = stepper.step(state, h)
        if not report.accepted:
            raise RuntimeError(report.reason)
    return float(np.linalg.norm(state.x[2:, [0, 2]] - wanted, axis=1).max() / LENGTH)


def chain_places() -> Floats:
    """Return where the vertices that are not held end in the plane of the swing [m], shape [SEGMENTS, 2].

    The equations of the chain, M x'' = M g - B^T K (q - q0 + damping B x') with B = dq/dx of its lengths and angles q, are solved
    by Radau's method of order 5 at tight tolerances.
    """
    segment = LENGTH / (SEGMENTS + 0.5)
    area = np.pi * RADIUS**2
    mass = np.full((SEGMENTS, 1), RUBBER.density * area * segment)
    mass[-1] /= 2
    stiffness = np.repeat([RUBBER.young * area / segment, RUBBER.young * area * RADIUS**2 / (4 * segment)], SEGMENTS)
    rest = np.repeat([segment, 0.0], SEGMENTS)
    level = segment * np.column_stack([np.arange(SEGMENTS) + 1.5, np.zeros(SEGMENTS)])

    def rates(_: float, y: Floats) -> Floats:
        x, velocity = y.reshape(2, SEGMENTS, 2)
        q, b = _strains(x, segment)
        moments = stiffness * (q - rest + RUBBER.damping * b @ velocity.reshape(-1))
        force = -(moments @ b).reshape(SEGMENTS, 2)
        return np.concatenate([velocity, force / mass + [0.0, -EARTH]]).reshape(-1)

    solved = solve_ivp(rates, (0.0, DURATION), np.concatenate([level, 0 * level]).reshape(-1), "Radau", rtol=1e-9, atol=1e-11)
    if not solved.success:
        raise RuntimeError(solved.message)
    return solved.y[: 2 * SEGMENTS, -1].reshape(SEGMENTS, 2)


def _strains(x: Floats, segment: float) -> tuple[Floats, Floats]:
    """Lengths of the free edges and kappa = 2 tan(angle / 2) between all, and their derivatives by x [n, 2], shape [2n, 2n]."""
    count = len(x)
    edge = np.diff(np.vstack([[[-segment / 2, 0.0], [segment / 2, 0.0]], x]), axis=0)
    length = np.linalg.norm(edge, axis=1)
    along = edge / length[:, None]
    turn = np.column_stack([-along[:, 1], along[:, 0]]) / length[:, None]  # d(direction)/d(edge)
    direction = np.arctan2(edge[:, 1], edge[:, 0])
    kappa = 2 * np.tan(np.diff(direction) / 2)
    by_angle = 1 + kappa**2 / 4
    b = np.zeros((2 * count, count + 2, 2))  # by all vertices, the two that are held first
    for i in range(count):
        b[i, i + 2], b[i, i + 1] = along[i + 1], -along[i + 1]
        b[count + i, i + 2] += by_angle[i] * turn[i + 1]
        b[count + i, i + 1] -= by_angle[i] * (turn[i + 1] + turn[i])
        b[count + i, i] += by_angle[i] * turn[i]
    return np.concatenate([length[1:], kappa]), b[:, 2:].reshape(2 * count, -1)
