"""One step of a bulk liquid: particles to a staggered grid and back (Fei 2019, algorithm 2, the liquid's part).

Shear stress comes first, then pressure, each implicit where settings do not say otherwise. What is absent costs nothing: a
liquid without elastic strain keeps none, one that is incompressible knows no volume, and viscosity that diffuses by less than
`DIFFUSES` of a cell in a step is taken along by the transfer, unless it sticks to walls.
"""

from dataclasses import dataclass, replace

import numpy as np

from engine.arrays import Flags, Floats
from engine.geometry.solids import Solids
from engine.liquid import evolve
from engine.liquid.boundary_layer import extend
from engine.liquid.grid import Grid, Indices, face_means, sorted_grid, taken
from engine.liquid.mirror import collect_mass, collect_momentum, reflect
from engine.liquid.model import LiquidModel, LiquidState
from engine.liquid.observe import of_cells, stressed
from engine.liquid.pressure import Wet, accelerate, air_pressure, divergence, pressure, spread_outwards, wet_cells
from engine.liquid.settings import LiquidSettings
from engine.liquid.shear import add_to_cells, shear_solve
from engine.liquid.surface import deep, depths
from engine.liquid.surface import volume as volume_of
from engine.liquid.transfer import to_grid, to_particles
from engine.liquid.walls import Walls, fold, open_space, push_out, walls
from engine.steppers.step_report import StepReport, Stopwatch

DIFFUSES = 0.05  # viscosity h / (density spacing^2), below which an explicit step is as good
NOISE = 0.1  # by which cells near the surface look too full when they are not: with less, liquid swells by up to 1.5 %
SPREAD_TOLERANCE, SPREAD_LIMIT = 1e-2, 0.1  # of its linear solve; spacings that it moves a particle by, at most


@dataclass
class Flow:
    """The liquid on the grid, within one step."""

    h: float  # the step [s]
    begin: Solids | None  # solids at its begin, None where there are none
    end: Solids | None  # and at its end
    grid: Grid
    walls: Walls
    mass: Floats  # of faces [kg], shape [3, B, 64]
    u: Floats  # of faces [m/s], shape [3, B, 64]
    filled: Floats  # share of cells, shape [B, 64]
    depth: Floats  # of cell centres below the surface [spacings], shape [B, 64]
    compression: Floats  # of cells, shape [B, 64]; [0, 64] where nothing is compressed
    inertia: Floats | None = None  # that of `Sheared`, where there is a boundary layer


class LiquidStepper:
    """Advances a liquid, one step at a time."""

    def __init__(self, model: LiquidModel, gravity: Floats, settings: LiquidSettings | None = None):
        """Keep what does not change between steps; `gravity` [3] in m/s^2."""
        self.model, self.settings = model, settings or LiquidSettings()
        self.gravity = np.asarray(gravity, np.float64)
        self.flow: Flow | None = None  # of the last step
        self.wet: Wet | None = None
        self.pressure = np.zeros(0)  # of wet cells in the last step [Pa]
        self.particle_pressure = np.zeros(0, np.float32)  # [Pa], shape [P]
        self.order: Indices = np.zeros(0, np.int32)  # which particle before the last step each one was, shape [P]

    def step(self, state: LiquidState, h: float, begin: Solids | None = None, end: Solids | None = None) -> StepReport:
        """Advance `state` by `h` [s], in which solids move from `begin` to `end`; a rejected step only reorders particles."""
        report, watch = StepReport(), Stopwatch()
        report.residual, self.flow, self.wet = 0.0, None, None
        if not len(state.x):
            self.order, self.particle_pressure, report.accepted = np.zeros(0, np.int32), np.zeros(0, np.float32), True
            return report
        if not self._is_slow_enough(float(np.abs(state.velocity).max()), h, report):
            return report
        if self._outruns_ripples(h, report):
            return report
        grid = self._sort(state)
        watch.lap("sort")
        flow = self._to_grid(grid, state, h, begin, end)
        watch.lap("to grid")
        if not self._shear(flow, state, report):
            return report
        watch.lap("shear")
        wet = self._wet_cells(flow)
        p, change, solved = self._pressure(flow, wet, report)
        if not report.reason:
            known = spread_outwards(grid, flow.mass, solved, change)
            flow.u += change
            rate = self._divergence(flow, wet)  # before faces behind walls become mirror images, which let liquid through
            reflect(flow.walls.mirror, flow.u)
            fastest = float(np.abs(flow.u[known]).max(initial=0.0))
            self._is_slow_enough(fastest, h, report)
        watch.lap("pressure")
        if report.reason:
            return report
        by = self._spread(flow, wet)
        watch.lap("spread")
        self._to_particles(flow, wet, p, rate, by, state)
        watch.lap("to particles")
        self.flow, self.wet, self.pressure = flow, wet, p
        report.stages, report.accepted = watch.laps, True
        return report

    def volume(self, state: LiquidState, begin: Solids | None = None, end: Solids | None = None) -> float:
        """Return the volume [m^3] that a liquid takes up among solids that stand still."""
        sorted_ = replace(state)  # the order of particles is that of the last step, for whoever holds more of them
        flow = self._to_grid(self._sort(sorted_), sorted_, 1.0, begin, end)  # the step is that of velocities, which do not matter
        return volume_of(flow.grid, flow.filled, flow.walls.distance)

    def _is_slow_enough(self, fastest: float, h: float, report: StepReport) -> bool:
        """Say so in the report where a speed [m/s] is beyond the largest Courant number."""
        courant = fastest * h / self.model.spacing
        if courant > self.settings.courant:
            report.reason = f"Courant number {courant:.3g}, above {self.settings.courant:g}"
        return courant <= self.settings.courant

    def _outruns_ripples(self, h: float, report: StepReport) -> bool:
        """Say so in the report where surface tension, which acts explicitly, moves ripples by more than a cell in a step."""
        stiffness = 2.0 * np.pi * self.model.surface_tension / (self.model.density * self.model.spacing**3)
        if h * h * stiffness > 1.0:
            report.reason = f"surface tension allows steps of {stiffness**-0.5:.3g} s"
        return bool(report.reason)

    def _sort(self, state: LiquidState) -> Grid:
        """Take particles in the order of the grid that they lie on."""
        self.order = np.zeros(0, np.int32)  # that of the last step goes before memory is at its peak
        grid, order = sorted_grid(self.model, state.x)
        self.order = order
        for name, values in vars(state).items():
            if values is not None and name not in ("emitted", "drained"):
                setattr(state, name, taken(values, order))
        return grid

    def _to_grid(self, grid: Grid, state: LiquidState, h: float, begin: Solids | None, end: Solids | None) -> Flow:
        """Map particles to the grid (item 3), with what explicit stress does to them."""
        model = self.model
        mass, u, filled = grid.faces(), grid.faces(), grid.cells()
        explicit = not self._shear_is_implicit(h)
        stress = stressed(state.strain, model.shear_modulus) if explicit and state.strain is not None else np.zeros((0, 6))
        consistency = model.consistency if explicit and not model.elastic else 0.0
        to_grid(grid, state.x, state.velocity, state.affine, state.volume, model.density, h, consistency, stress, mass, u, filled)
        found = open_space(grid) if end is None or begin is None else walls(grid, begin, end, h, model.no_slip, mass)
        if self._has_boundary_layer(h):
            np.divide(u, mass, out=u, where=mass > 0.0)
            collect_mass(found.mirror, mass)
        else:
            collect_momentum(found.mirror, mass, u)
            collect_mass(found.mirror, mass)
            np.divide(u, mass, out=u, where=mass > 0.0)
        reflect(found.mirror, u)
        fold(found, filled)
        compression = np.zeros((0, 64))
        if state.compression is not None:
            present = grid.cells()
            add_to_cells(grid, state.x, state.volume * state.compression / model.spacing**3, present)
            fold(found, present)
            compression = np.divide(present, filled, out=np.ones_like(filled), where=filled > 1e-9)
            filled = present
        depth = np.empty_like(filled)
        depths(filled, depth)
        return Flow(h, begin, end, grid, found, mass, u, filled, depth, compression)

    def _has_boundary_layer(self, h: float) -> bool:
        """Say whether velocities before walls are taken as they are, and stress alone brakes them.

        Explicit stress is part of the momentum behind walls, which then has to be that of mirror images.
        """
        return self.model.no_slip and self._shear_is_implicit(h)

    def _shear_is_implicit(self, h: float) -> bool:
        model = self.model
        if model.elastic:
            return self.settings.shear == "implicit"
        sticks = model.no_slip and model.consistency > 0.0
        return sticks or 0.5 * model.consistency * h > DIFFUSES * model.density * model.spacing**2

    def _shear(self, flow: Flow, state: LiquidState, report: StepReport) -> bool:
        """Let gravity and, where it is implicit, shear stress act (eq. 14.6); False where that does not converge."""
        h = flow.h
        free = flow.u + (h * self.gravity)[:, None, None] * (flow.mass > 0.0)
        if not self._shear_is_implicit(h):
            flow.u = free
            return True
        sheared = shear_solve(flow.grid, self.model, self.settings, state.x, state.volume, state.strain, flow.walls.mirror,
                              flow.mass, flow.u, free, h)
        report.newton_iterations, report.linear_iterations = sheared.newton, sheared.linear
        report.residual, flow.u, flow.inertia = sheared.residual, sheared.u, sheared.inertia
        if not sheared.converged:
            report.reason = f"shear did not converge: {sheared.residual:.2g} left of it after {sheared.newton} iterations"
        return sheared.converged

    def _wet_cells(self, flow: Flow) -> Wet:
        """Return the cells that have a pressure, and their system (eq. 14.32)."""
        model, grid = self.model, flow.grid
        conductance = self._acceleration(flow) / model.spacing**2
        compliance = np.broadcast_to(0.0, flow.filled.shape)
        if not model.incompressible:
            compliance = 1.0 / (flow.h * 0.5 * model.bulk_modulus * (flow.compression + 1.0 / flow.compression))
        return wet_cells(grid, flow.filled, flow.depth, flow.walls.open, conductance, compliance, model.period)

    def _pressure(self, flow: Flow, wet: Wet, report: StepReport) -> tuple[Floats, Floats, Flags]:
        """Solve for the pressure (eq. 14.31); returns it [N] [Pa], how it changes faces [m/s], and which of them it acts on."""
        model, settings = self.model, self.settings
        air = air_pressure(wet, flow.depth, model.surface_tension, flow.grid)
        if model.incompressible or settings.pressure == "implicit":
            load = -self._divergence(flow, wet)
            if not model.incompressible:
                load += self._pressure_of_compression(flow, wet) / (flow.h * self._stiffness(flow, wet))
            if model.surface_tension > 0.0:
                load += self._from_air(flow, wet, air)
            p, how = pressure(wet, load, settings.pressure_tolerance, settings.max_linear)
            report.linear_iterations += how.iterations
            report.residual = max(report.residual, how.residual)
            if how.residual > settings.pressure_tolerance:
                report.reason = f"pressure did not converge: {how.residual:.2g} left of it after {how.iterations} iterations"
        else:
            p = self._pressure_of_compression(flow, wet)
        change = flow.grid.faces()
        factor = self._acceleration(flow)
        return p, change, accelerate(flow.grid, wet.row, p, air, flow.depth, flow.walls.open, factor, change)

    def _acceleration(self, flow: Flow) -> Floats:
        """Return h / density at faces, by which a pressure gradient changes velocities [m^3 s/kg], shape [3, B, 64]."""
        at_rest = flow.h / self.model.density
        if self.model.incompressible:
            return np.broadcast_to(at_rest, flow.mass.shape)
        return at_rest * face_means(flow.grid, flow.compression)

    @staticmethod
    def _divergence(flow: Flow, wet: Wet) -> Floats:
        """Return the divergence of velocity in wet cells [N] [1/s]."""
        rate = np.empty(len(wet.cell))
        divergence(flow.grid, flow.u, flow.walls.open, flow.walls.speed, wet.cell, rate)
        return rate

    def _pressure_of_compression(self, flow: Flow, wet: Wet) -> Floats:
        """Return the pressure of wet cells [N] [Pa] before the step (eq. 13.8 with eq. 13.4)."""
        volume = flow.compression.reshape(-1)[wet.cell]
        return -0.5 * self.model.bulk_modulus * (volume - 1.0 / volume)

    def _stiffness(self, flow: Flow, wet: Wet) -> Floats:
        volume = flow.compression.reshape(-1)[wet.cell]
        return 0.5 * self.model.bulk_modulus * (volume + 1.0 / volume)

    def _from_air(self, flow: Flow, wet: Wet, air: Floats) -> Floats:
        """Return what a pressure of the air [N] [Pa] adds to the load.

        Its conductances are what diagonals have beyond rows and what compresses.
        """
        system = wet.system
        inner = system.coupling.sum(axis=1)
        for axis in range(3):
            before = system.beside[:, 2 * axis]
            inner += np.where(before >= 0, system.coupling[before, axis], 0.0)
        if not self.model.incompressible:
            inner += 1.0 / (flow.h * self._stiffness(flow, wet))
        return (system.diagonal - inner) * air

    def _spread(self, flow: Flow, wet: Wet) -> Floats:
        """Return displacements of faces [m] that spread particles evenly again: volume is kept beyond any one step.

        They are the gradient of a potential, found like the pressure, and have nothing to do with velocities.
        """
        model, by = self.model, flow.grid.faces()
        if self.settings.spread == 0.0:
            return by
        _, twice = deep(flow.grid, flow.filled, flow.walls.distance)
        excess = flow.filled - 1.0
        wrong = np.where(twice, excess, np.maximum(excess - NOISE, 0.0)).reshape(-1)[wet.cell]
        q, _ = pressure(wet, self.settings.spread * wrong, SPREAD_TOLERANCE, self.settings.max_linear)
        factor = self._acceleration(flow)
        moved = accelerate(flow.grid, wet.row, q, np.zeros(len(q)), flow.depth, flow.walls.open, factor, by)
        spread_outwards(flow.grid, flow.mass, moved, by)
        limit = SPREAD_LIMIT * model.spacing
        return np.clip(by, -limit, limit, out=by)

    def _to_particles(self, flow: Flow, wet: Wet, p: Floats, rate: Floats, by: Floats, state: LiquidState) -> None:
        """Map velocities back, strain particles and move them (items 7 to 12).

        `p` [N] [Pa] and `rate` [N] [1/s] are pressure and divergence of wet cells, `by` displacements of faces [m].
        """
        model, grid, h = self.model, flow.grid, flow.h
        to_particles(grid, state.x, flow.u, state.velocity, state.affine)
        self.particle_pressure = np.empty(len(state.x), np.float32)
        of_cells(grid, state.x, wet.row, p, self.particle_pressure)
        if state.compression is not None:
            rates, wets = grid.cells(), grid.cells()
            rates.reshape(-1)[wet.cell], wets.reshape(-1)[wet.cell] = rate, 1.0
            evolve.swell(grid, state.x, rates, wets, h, state.compression)
        if model.elastic:
            evolve.flow(state.affine, h, model.shear_modulus, np.sqrt(2.0 / 3.0) * model.yield_stress, model.consistency,
                        model.flow_index, model.recovery_rate, self.settings.plastic_flow == "implicit", state.strain,
                        state.plastic_strain)
            if state.compression is not None and np.isfinite(model.tearing_strain):
                evolve.tear(state.plastic_strain, model.tearing_strain, state.compression)
        if flow.inertia is not None and flow.begin is not None and flow.end is not None:
            extend(grid, flow.begin, flow.end, h, flow.walls.mirror.face, flow.mass, flow.inertia, flow.u)
            near_walls = grid._replace(turn=grid.turn[flow.walls.near[grid.turn]])
            to_particles(near_walls, state.x, flow.u, state.velocity, state.affine)
        evolve.shift(grid, state.x, by)
        evolve.move(state.x, state.velocity, h)
        if flow.begin is not None and flow.end is not None:
            moved_by = self.settings.courant + SPREAD_LIMIT
            push_out(grid, flow.walls.near, flow.walls.distance, moved_by, flow.begin, flow.end, h, state.x, state.velocity)
        evolve.wrap(state.x, model.origin, model.spacing * model.period)
