"""Where the unknowns of a step stand in its linear system."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike

from engine.arrays import Floats, Ints
from engine.linalg.block_matrix import BLOCK, BlockMatrix, with_pattern


@dataclass
class Layout:
    """Every point has a row but for removed ones and those whose unknowns are condensed.

    A contact with two EIL nodes has two unknowns, both u, which only meet those of the four EoL nodes around it. They are
    eliminated by hand where the Hessian is put together: exactly, without fill, and without a row.
    """

    matrix: BlockMatrix
    row: Ints  # of every point, -1 for none, shape [P]
    point: Ints  # of every row, shape [R]
    condensed: Ints  # number of every condensed point, -1 for others, shape [P]
    condensed_points: Ints  # shape [C]
    others: Ints  # the four points around each condensed one, shape [C, 4]
    inverse: Floats  # of the blocks of the condensed unknowns, shape [C, 2, 2]
    coupling: Floats  # of the condensed unknowns to the others, shape [C, 2, 4, 5]


def lay_out(pairs: Ints, present: Ints, condensed_points: Ints, others: Ints, points: int, dtype: DTypeLike) -> Layout:
    """Return the layout of a system of so many `points`.

    `pairs` [m, 2] of points have a block; `present` [n] are the points with unknowns, those to be condensed among them.
    """
    condensed = np.full(points, -1, np.int64)
    condensed[condensed_points] = np.arange(len(condensed_points))
    rows_of = present[condensed[present] < 0]
    row = np.full(points, -1, np.int64)
    row[rows_of] = np.arange(len(rows_of))
    of_rows = row[pairs]
    matrix, number = with_pattern(len(rows_of), of_rows[(of_rows[:, 0] != of_rows[:, 1]) & (of_rows >= 0).all(axis=1)], dtype)
    row[rows_of] = number
    point = np.empty(len(rows_of), np.int64)
    point[number] = rows_of
    count = len(condensed_points)
    return Layout(matrix, row, point, condensed, condensed_points, others, np.empty((count, 2, 2)),
                  np.empty((count, 2, 4, BLOCK)))


def parts_of(layout: Layout, members: Ints) -> tuple[Ints, Ints]:
    """Sort terms so that those within one strip stand together; `members` [n, m] are the points that each touches.

    Returns the order [n] and where the part of each strip starts, shape [S+1]; what crosses strips comes behind the last.
    """
    strips = layout.matrix.strips.start
    count = len(strips) - 1
    strip = np.searchsorted(strips, layout.row[members], side="right") - 1
    strip[layout.row[members] < 0] = -1
    highest = strip.max(axis=1, initial=0)
    lowest = np.where(strip < 0, count, strip).min(axis=1, initial=count)
    strip_of_term = np.where(lowest == highest, highest, count)
    order = np.argsort(strip_of_term, kind="stable")
    return order, np.searchsorted(strip_of_term[order], np.arange(count + 1)).astype(np.int64)
