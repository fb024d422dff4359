"""Newton's iteration on an incremental potential, in which what is most nonlinear is settled by itself beforehand.

After an iteration for all of a cloth, the largest forces left over are at few points: where a node is about to reach another
segment, a contact stands beside a table's edge, the Hessian is indefinite. They decide how many more iterations there
are. So before each one, a piece around the worst points is solved while everything else stands still (nonlinear elimination:
Lanzkron, Rose and Wilkes 1996); within the piece, which has worst points of its own, again the same.
"""

import numpy as np

from engine.arrays import Floats, Ints
from engine.steppers.incremental_potential import IncrementalPotential
from engine.steppers.line_search import line_search
from engine.steppers.newton_system import NewtonSystem
from engine.steppers.piece import Piece, piece_of, points_around
from engine.steppers.step_report import Stopwatch

Iterate = tuple[Floats, Floats, float, Floats]  # x [P, 3], u [N], energy and gradient [P, 5]

FEWEST_ROWS = 1000  # of a system that has pieces: of smaller ones every iteration is cheap
SHARE = 0.1  # of the rows that are free in a piece, at most
SEEDS = 300  # worst points, at most, around which it is
RINGS = 4  # of points around them
MOST = 20  # iterations in a piece
LESS = 0.1  # of the residual that stays outside is small enough inside
MARGIN = 0.3  # of the goal, for what a piece does to what is around it


def newton(potential: IncrementalPotential, system: NewtonSystem, at: Iterate, goal: float) -> tuple[Iterate | None, int]:
    """Return the next iterate, None if there is no descent, and how many iterations of conjugate gradients it took.

    It ends where no component of the gradient is larger than `goal` [N]. Where the true Hessian leads nowhere, as close to
    points at which the energy is not smooth, the positive form does everywhere.
    """
    start, at = at, settle_pieces(potential, system, at, goal)
    x, u, energy, gradient = at
    if np.abs(gradient).max() <= goal:
        return at, 0
    total, found = 0, None
    for convex in (False, True):
        if found is None and not (convex and system.convex.all()):
            direction, iterations = system.direction(x, u, gradient, goal, convex)
            total += iterations
            found = line_search(potential, x, u, energy, gradient, direction, further=bool(system.convex.any()))
            system.watch.lap("line_search")
    if found is not None:
        potential.update_pull(x, u, direction)
    elif at is not start:
        found = at
    return found, total


def settle_pieces(potential: IncrementalPotential, system: NewtonSystem, at: Iterate, goal: float) -> Iterate:
    """Return the iterate with a piece around the worst points settled, and more of them while all bad points are within one."""
    worst = np.inf
    if potential.offsets is not None:  # normals reach from piece to piece
        return at
    while system.layout.matrix.rows >= FEWEST_ROWS:
        residual = np.abs(at[3]).max(axis=1)
        if not (goal < residual.max() <= 0.5 * worst and np.isfinite(residual.max())):
            break
        worst = residual.max()
        seeds = worst_points(residual, goal, system)
        if len(seeds) == 0:
            break
        piece = piece_of(potential, points_around(seeds, RINGS, system.layout))
        outside = np.delete(residual, piece.moving).max(initial=0.0)
        at = settle(potential, system, at, piece, max(MARGIN * goal, LESS * outside))
        if outside > goal:
            break
    system.watch.lap("pieces")
    return at


def worst_points(residual: Floats, goal: float, system: NewtonSystem) -> Ints:
    """Return the points with the largest `residual` [P] over the goal: as many as make a piece that is small."""
    count = min(SEEDS, int(np.count_nonzero(residual > goal)))
    worst = np.argsort(-residual, kind="stable")[:count]
    while count and points_around(worst[:count], RINGS, system.layout).sum() > SHARE * system.layout.matrix.rows:
        count //= 2
    return worst[:count]


def settle(potential: IncrementalPotential, system: NewtonSystem, at: Iterate, piece: Piece, goal: float) -> Iterate:
    """Return the iterate with a piece settled, as far as it goes: the same where that is nowhere."""
    own = NewtonSystem(piece.potential, system.settings, Stopwatch(), system)
    x, u = at[0].copy(), at[1].copy()
    own_x, own_u = x[piece.points], u[piece.nodes]
    first = inner = (own_x, own_u, *piece.potential.gradient(own_x, own_u))
    for _ in range(MOST):
        if np.abs(inner[3]).max() <= goal:
            break
        found, _ = newton(piece.potential, own, inner, goal)
        if found is None:
            break
        inner = found
    if inner is first:
        return at
    piece.put_back(inner[0], inner[1], x, u, potential)
    return x, u, *potential.gradient(x, u)
