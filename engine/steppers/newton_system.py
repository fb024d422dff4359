"""The linear system of a Newton iteration, and its solution by preconditioned conjugate gradients."""

import numpy as np

from engine.arrays import Floats
from engine.linalg.conjugate_gradient import conjugate_gradient
from engine.linalg.incomplete_cholesky import elimination, factorise
from engine.steppers.incremental_potential import IncrementalPotential
from engine.steppers.step_report import Stopwatch
from engine.yarns.settings import YarnSettings


class NewtonSystem:
    """The Hessian of a step, whose pattern stays while its values change with the iterations."""

    def __init__(self, potential: IncrementalPotential, settings: YarnSettings, watch: Stopwatch):
        """Lay out the matrix and its incomplete factor."""
        self.potential, self.settings, self.watch = potential, settings, watch
        self.hessian = potential.pattern()
        self.order = elimination(self.hessian, potential.elimination_order())

    def direction(self, x: Floats, u: Floats, gradient: Floats) -> tuple[Floats, int]:
        """Return the Newton direction [P, 5] and the conjugate-gradient iterations it took.

        It solves H d = -g with the true Hessian or, where that is found indefinite, with its positive form.
        """
        direction = np.empty_like(gradient)
        total = 0
        for convex in (False, True):
            self.potential.hessian(x, u, convex, self.hessian)
            self.watch.lap("assemble")
            preconditioner = factorise(self.hessian, self.order)
            self.watch.lap("factor")
            if preconditioner is None:
                continue
            iterations, positive = conjugate_gradient(
                self.hessian, -gradient, direction, preconditioner, self.settings.linear_tolerance,
                self.settings.max_linear)
            self.watch.lap("solve")
            total += iterations
            if positive:
                return direction, total
        return -gradient, total
