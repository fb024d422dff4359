"""Forces and second derivatives of discrete elastic rods against differences of their energy."""

import numpy as np

from engine.arrays import Floats
from engine.linalg.banded import WIDTH
from engine.strands import potential
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.backward_difference import implicit_euler
from engine.strands.loads import Inertia
from engine.strands.model import StrandModel, StrandState
from engine.validate.catalogue import CaseResult, case, timed_rows

H = 0.3  # step of the potential [s]
VERTICES = 6


@case("der-gradients", bar=1e-6, summary="random strands: forces and Hessian against differences of the energy")
def gradients(quick: bool) -> CaseResult:
    """Worst relative error over strands and over the widths of the differences, of which rows show each."""
    seeds = range(3 if quick else 30)

    def error(width: float) -> float:
        return max(max(errors(moved_chart(seed), width)) for seed in seeds)

    rows = timed_rows("difference [m, rad]", (4e-3, 2e-3, 1e-3), error)
    return CaseResult(rows, rows[-1].error, note=f"{len(seeds)} strands with stretch, bending, twist, friction and inertia")


class Chart:
    """The potential of a step around a state, over displacements of vertices and turns of edges."""

    def __init__(self, model: StrandModel, state: StrandState, h: float):
        """Place the chart's origin at the state."""
        self.model, self.state, self.h = model, state, h
        vertices = len(state.x)
        self.step, self.now, self.other = potential.step_of(vertices), potential.geometry(vertices), potential.geometry(vertices)
        difference = implicit_euler(model, h)
        inertia = Inertia(model.mass, state.x + h * state.velocity, 9.81 * model.mass, h * state.spin, difference.effective,
                          difference.lean, state.earlier_x, state.earlier_m1, state.earlier_twist)
        potential.begin(model, inertia, 0, state.x, state.m1, state.twist, self.step, self.now, self.other)
        self.x, self.turned = state.x, np.zeros(vertices)
        self.unknowns = 4 * vertices

    def move(self, q: Floats) -> None:
        """Let the origin be at the unknowns q [4V], away from the start of the step."""
        self.energy(q)
        self.x, self.turned = self.x + q.reshape(-1, 4)[:, :3], self.turned + q[3::4]
        self.now, self.other = self.other, self.now

    def energy(self, q: Floats) -> float:
        """Potential at the unknowns q [4V] [J]."""
        x, turn = self.x + q.reshape(-1, 4)[:, :3], q[3::4].copy()
        potential.follow(x, turn, self.now, self.other)
        return potential.energy(x, self.turned + turn, self.other, self.step, self.h)

    def gradient(self) -> Floats:
        """Gradient at the origin [4V]."""
        g = np.empty((len(self.x), 4))
        potential.gradient(self.x, self.turned, self.now, self.step, self.h, np.empty(8), g)
        return g.reshape(-1)

    def hessian(self, positive: bool = False) -> Floats:
        """Hessian at the origin [4V, 4V], or its positive form."""
        band = np.empty((self.unknowns, WIDTH + 1))
        potential.hessian(self.now, self.step, self.h, positive, np.empty((12, 8)), band)
        full = np.zeros((self.unknowns, self.unknowns))
        for d in range(WIDTH + 1):
            rows = np.arange(d, self.unknowns)
            full[rows, rows - d] = full[rows - d, rows] = band[rows - d, d]
        return full


def moved_chart(seed: int) -> Chart:
    """Return a chart of a random strand away from the start of its step, so that friction acts."""
    chart = Chart(*random_strand(seed), H)
    chart.move(np.random.default_rng(seed).normal(scale=0.1, size=chart.unknowns))
    return chart


def errors(chart: Chart, width: float) -> tuple[float, float]:
    """Errors of gradient and Hessian over their largest entries, against differences of fourth order of the given width."""
    free = ~chart.model.held.reshape(-1)
    free[-1] = False  # no edge is behind the last vertex
    unit = width * np.eye(chart.unknowns)[free]

    def slope(direction: Floats, at: Floats) -> float:
        near = chart.energy(at + direction) - chart.energy(at - direction)
        return (8 * near - chart.energy(at + 2 * direction) + chart.energy(at - 2 * direction)) / (12 * width)

    origin = np.zeros(chart.unknowns)
    g = np.array([slope(d, origin) for d in unit])
    rows = [
        [(8 * (slope(d, e) - slope(d, -e)) - slope(d, 2 * e) + slope(d, -2 * e)) / (12 * width) for d in unit] for e in unit
    ]
    wanted_g, wanted_h = chart.gradient()[free], chart.hessian()[np.ix_(free, free)]
    return (
        float(np.abs(g - wanted_g).max() / np.abs(wanted_g).max()),
        float(np.abs(np.array(rows) - wanted_h).max() / np.abs(wanted_h).max()),
    )


def random_strand(seed: int) -> tuple[StrandModel, StrandState]:
    """Return a strand of elliptic section, strained in every way and moving."""
    rng = np.random.default_rng(seed)
    rest = np.cumsum(rng.normal(size=(VERTICES, 3)) + np.array([1.0, 0.0, 0.0]), axis=0)
    assembly = StrandAssembly()
    assembly.strand(rest + rng.normal(scale=0.3, size=rest.shape), rng.uniform(0.5, 0.9, (VERTICES - 1, 2)),
                    StrandMaterial(density=1.0, young=2.0, shear=1.5, damping=0.2), rest=rest)
    model, state = assembly.build()
    state.velocity = rng.normal(size=state.x.shape)
    state.spin = rng.normal(size=VERTICES)
    curvature = model.rest_curvature + rng.normal(size=model.rest_curvature.shape)
    return model._replace(rest_twist=rng.normal(size=VERTICES), rest_curvature=curvature), state
