"""What every yarn has by itself: inertia, stretch and bending along its chain of EoL nodes, all yarns at once.

A yarn's own nodes belong to no other yarn, so gradients by node need no care. Second derivatives of a yarn couple each
node to the next two, which makes a band of 4 x 4 blocks (x and u) along its chain; where two yarns share a point, the rows
of the Hessian gather from both bands.
"""

import numpy as np
from numba import njit, prange

from engine.linalg.block_matrix import locate
from engine.yarns import bending, inertia, stretch

CHUNK = 256  # rows that are one piece of work


@njit(cache=True, parallel=True, error_model="numpy")
def add_gradient(
    chain, chain_start, node_point, density, kinematic, stretch_stiffness, stretch_damping, bending_stiffness, h, u0,
    prediction, corner_force, x, u, place, centre0, centre, gradient,
):
    """Add the gradient of all yarns to `gradient` [N, 4] and return their energy [J].

    `chain` [E] and `chain_start` [Y+1] are those of `Chain`; the constants are those of `YarnModel`, the prediction and
    the corner forces those of `inertia`; 0 marks the start of the step of size h [s]. Stretch and bending are those of the
    `centre` lines, `place` [N] says where in them nodes are (`crimp`); they move with x.
    """
    yarns = len(chain_start) - 1
    energy = np.zeros(yarns)
    for y in prange(yarns):
        nodes = chain[chain_start[y] : chain_start[y + 1]]
        if not kinematic[y]:
            energy[y] += inertia.add_gradient(nodes, node_point, density[y], h, u0, prediction, corner_force, x, u, gradient)
        energy[y] += stretch.add_gradient(
            nodes, place, stretch_stiffness[y], stretch_damping[y], h, centre0, u0, centre, u, gradient)
        if bending_stiffness[y] > 0.0:
            energy[y] += bending.add_gradient(nodes, place, bending_stiffness[y], centre, u, gradient)
    total = 0.0
    for y in range(yarns):
        total += energy[y]
    return total


@njit(cache=True, parallel=True, error_model="numpy")
def hessian(
    chain, chain_start, density, kinematic, stretch_stiffness, stretch_damping, bending_stiffness, h, u0,
    prediction, u, place, centre0, centre, convex, band,
):
    """Write the second derivatives of all yarns to `band` [E, 3, 4, 4], where `convex` [N] a positive form of them."""
    for y in prange(len(chain_start) - 1):
        first, last = chain_start[y], chain_start[y + 1]
        nodes, own = chain[first:last], band[first:last]
        own[:] = 0.0
        if not kinematic[y]:
            inertia.add_hessian(nodes, density[y], h, u0, prediction, u, own)
        stretch.add_hessian(
            nodes, place, stretch_stiffness[y], stretch_damping[y], h, centre0, u0, centre, u, convex, own)
        if bending_stiffness[y] > 0.0:
            bending.add_hessian(nodes, place, bending_stiffness[y], centre, u, convex, own)


@njit(cache=True, parallel=True, error_model="numpy")
def gather(
    point, row, point_nodes, place, chain, chain_start, node_yarn, node_point, node_slot, band, sliding, start, column, block,
):
    """Write the rows of the Hessian that the yarns' bands and `sliding` [P, 2, 2] make up; all else becomes zero.

    `point` [R] and `row` [P] say which point each row belongs to and the other way round, `place` [N] where each EoL node
    stands in `chain`, -1 for the others.
    """
    rows = len(point)
    for chunk in prange((rows + CHUNK - 1) // CHUNK):
        for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, rows)):
            block[start[i] : start[i + 1]] = 0.0
            own = block[locate(start, column, i, i)]
            for r in range(2):
                for c in range(2):
                    own[3 + r, 3 + c] += sliding[point[i], r, c]
            for slot in range(2):
                n = point_nodes[point[i], slot]
                if n < 0 or place[n] < 0:
                    continue
                e = place[n]
                first, last = chain_start[node_yarn[n]], chain_start[node_yarn[n] + 1]
                for f in range(max(e - 2, first), min(e + 3, last)):
                    m = chain[f]
                    k = locate(start, column, i, row[node_point[m]])
                    if f >= e:
                        _add_block(band[e, f - e], False, 3 + slot, 3 + node_slot[m], block[k])
                    else:
                        _add_block(band[f, e - f], True, 3 + slot, 3 + node_slot[m], block[k])


@njit(cache=True, error_model="numpy")
def _add_block(part, transposed, u_row, u_column, block):
    """Add a 4 x 4 block in (x, u) of two nodes to the 5 x 5 block of their points."""
    for r in range(4):
        for c in range(4):
            value = part[c, r] if transposed else part[r, c]
            block[r if r < 3 else u_row, c if c < 3 else u_column] += value
