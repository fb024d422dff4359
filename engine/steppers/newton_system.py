"""The linear system of a Newton iteration, and its solution by preconditioned conjugate gradients."""

import numpy as np

from engine.arrays import Flags, Floats
from engine.linalg.coarse_space import CoarseSpace, TwoLevels
from engine.linalg.conjugate_gradient import Preconditioner, conjugate_gradient
from engine.linalg.incomplete_cholesky import LARGEST_SHIFT, factorise, incomplete_cholesky
from engine.steppers.incremental_potential import IncrementalPotential
from engine.steppers.layout import Layout
from engine.steppers.step_report import Stopwatch
from engine.yarns import constraints, contact, fabric_motion
from engine.yarns.settings import YarnSettings

OUTLIER = 8.0  # eigenvalue that a sound preconditioner does not leave: incomplete factors reach 2, with patches 3
STALE = 2  # times as many iterations as with a fresh factor end the use of an old one
MANY = 1000  # points from which on a coarse space pays, and single precision
FAR = 15.0  # segments that a wave of stretch runs within a step, from where on it pays
PATCH = 8.0  # edge of a patch of cloth in rest segments
PLACES = 3  # times that the positive form is tried around negative curvature before it is taken everywhere
SHARE = 0.1  # rows with at least this part of the most negative row's share in p.Ap are places of negative curvature
MARGIN = 0.3  # of Newton's goal, for what the Hessian does not foresee


def precision(points: int) -> type[np.floating]:
    """Return the type of the numbers in the matrix of so many `points`."""
    return np.float32 if points >= MANY else np.float64


class NewtonSystem:
    """The Hessian of a step, whose pattern stays while its values change with the iterations."""

    def __init__(
        self, potential: IncrementalPotential, settings: YarnSettings, watch: Stopwatch, whole: "NewtonSystem | None" = None,
    ):
        """Lay out the matrix and its incomplete factor, of large systems in single precision: a direction needs no more.

        That of a piece, which has the precision of its `whole`, has no coarse space: nothing runs far in it.
        """
        self.potential, self.settings, self.watch = potential, settings, watch
        points = int(np.count_nonzero(potential.state.active))
        self.layout: Layout = potential.lay_out(precision(points) if whole is None else whole.layout.matrix.block.dtype)
        self.factor = incomplete_cholesky(self.layout.matrix)
        self.preconditioner: Preconditioner = self.factor
        self.coarse = self._coarse_space() if whole is None else None
        if self.coarse is not None:
            self.preconditioner = TwoLevels(self.factor, self.coarse)
        self.fresh_iterations = 0  # that the last fresh factor took
        self.usable: bool | None = None  # the factor is of the Hessian that is convex everywhere, or of another
        self.convex = np.zeros(potential.model.point_count, np.bool_)  # points with the positive form, in the last direction

    def _coarse_space(self) -> CoarseSpace | None:
        """Return the patches of cloth that is so stiff, or steps so long, that a pull runs over many yarns within a step."""
        p, m, layout = self.potential, self.potential.model, self.layout
        reach = p.h * np.sqrt(m.stretch_stiffness / m.density) / m.rest_segment  # of a wave of stretch, in segments
        if layout.matrix.rows < MANY or reach.max(initial=0.0) < FAR:
            return None
        fabrics = fabric_motion.fabrics_at(m)
        response = fabric_motion.responses(m, p.state, p.chain, fabrics, p.projector, layout.point)
        edge = PATCH * float(m.rest_segment.max())
        return CoarseSpace(layout.matrix, p.x0[layout.point], fabrics[layout.point], response, edge)

    def forget_factor(self) -> None:
        """Say that the Hessian has changed too much for the factor that there is."""
        self.usable = None

    def direction(
        self, x: Floats, u: Floats, gradient: Floats, goal: float, convex: bool = False
    ) -> tuple[Floats, int]:
        """Return the Newton direction [P, 5] and the conjugate-gradient iterations it took.

        It solves H d = -g with the true Hessian or, where that is found indefinite, with its positive form, and no further
        than Newton's `goal` [N] for the largest component of g asks for. Few places have negative curvature as a rule, and
        elsewhere the positive form would slow Newton down: so it is taken around those that conjugate gradients find, and
        everywhere if they go on or factors break down, or if `convex` asks for it.
        """
        total, places = 0, 0
        self.convex[:] = convex
        while True:
            descends, negative = False, None
            if self.potential.hessian(x, u, self.convex, self.layout):
                self.watch.lap("assemble")
                direction, iterations, descends, negative = self._solve(-gradient, goal)
                total += iterations
            self.watch.lap("assemble")
            if descends or self.convex.all():
                return direction if descends else -gradient, total
            places += 1
            grown = self.convex if negative is None else self.convex | self._around(negative)
            stuck = places > PLACES or np.array_equal(grown, self.convex)
            self.convex = np.ones_like(grown) if stuck else grown
            self.forget_factor()

    def _around(self, curvature: Floats) -> Flags:
        """Return the points of the rows that have most of a negative `curvature` [R], and of those coupled to them, shape [P]."""
        a, layout = self.layout.matrix, self.layout
        around = np.zeros(len(layout.row), np.bool_)
        for i in np.flatnonzero(curvature <= SHARE * curvature.min()):
            around[layout.point[a.column[a.start[i] : a.start[i + 1]]]] = True
        return around

    def _solve(self, load: Floats, goal: float) -> tuple[Floats, int, bool, Floats | None]:
        """Solve for a load [P, 5]; the last factor serves as long as it is of the same form and not much worse than fresh.

        Returns the solution, the iterations, whether the matrix proved positive, and the curvature by rows that did not.
        """
        layout, convex = self.layout, bool(self.convex.all())
        reduced = load[layout.point]
        contact.condense_load(layout.condensed_points, layout.condensed, layout.others, layout.row, layout.inverse,
                              layout.coupling, load, reduced)
        solution = np.empty_like(reduced)
        total, sound, stronger = 0, False, False
        while not sound:
            fresh = self.usable is not convex
            if fresh and not self._factorise(convex, stronger):
                return load, total, False, None
            iterations, positive, sound, negative = conjugate_gradient(
                layout.matrix, reduced, solution, self.preconditioner, self.settings.linear_tolerance,
                self.settings.max_linear, MARGIN * goal, OUTLIER if self.factor.shift < LARGEST_SHIFT else np.inf)
            total += iterations
            self.watch.lap("solve")
            if not sound:
                self.forget_factor()
                stronger = fresh
        if fresh:
            self.fresh_iterations = iterations
        if not positive or iterations > STALE * self.fresh_iterations:
            self.forget_factor()
        direction = np.zeros_like(load)
        direction[layout.point] = solution
        contact.expand(layout.condensed_points, layout.condensed, layout.others, layout.inverse, layout.coupling, load,
                       direction)
        # single precision leaves a trace of what S cancels where its directions are oblique, and steps would add these up
        constraints.project_gradient(self.potential.constrained_points, self.potential.projector, direction)
        self.watch.lap("solve")
        return direction, total, positive, negative

    def _factorise(self, convex: bool, stronger: bool) -> bool:
        """Prepare the preconditioner for the present Hessian; `stronger` is one that stays clearer of breakdown than the last."""
        positive = factorise(self.factor, stronger) and (self.coarse is None or stronger or self.coarse.refresh())
        self.usable = convex if positive else None
        self.watch.lap("factor")
        return positive
