"""Exact signed distance to a closed triangle surface, by a tree of boxes and angle-weighted normals.

The sign is that of the offset from the closest point along the normal there: of the face, the sum of both faces at an
edge, the angle-weighted sum at a vertex (Baerentzen and Aanaes 2005), which is right wherever the surface is closed.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from engine.arrays import Floats, Ints

LEAF = 4  # triangles in a box that is not divided further
DEPTH = 64  # of the tree, at most: boxes are divided at the median


@dataclass(frozen=True)
class TriangleTree:
    """F triangles in boxes of boxes."""

    corners: Floats  # [m], shape [F, 3, 3]
    normals: Floats  # of the face, its three vertices, its edges 01, 12 and 20, shape [F, 7, 3]
    triangle: Ints  # triangles, box after box, shape [F]
    low: Floats  # [m], shape [B, 3]
    high: Floats  # [m], shape [B, 3]
    inside: Ints  # first of two successive boxes inside, or -1, then the range in `triangle`, shape [B, 3]


def triangle_tree(vertices: Floats, faces: Ints) -> TriangleTree:
    """Return the tree of a closed surface with `vertices` [V, 3] and `faces` [F, 3], counter-clockwise from outside."""
    corners = np.ascontiguousarray(vertices[faces], np.float64)
    triangle = np.arange(len(faces))
    low, high = np.empty((2 * len(faces), 3)), np.empty((2 * len(faces), 3))
    inside = np.empty((2 * len(faces), 3), np.int64)
    count = _divide(corners, corners.mean(axis=1), triangle, low, high, inside)
    return TriangleTree(corners, _normals(corners, faces, len(vertices)), triangle, low[:count], high[:count], inside[:count])


def signed_distances(tree: TriangleTree, points: Floats, step: float) -> Floats:
    """Return the distance of each of `points` [n, 3], negative inside, shape [n] [m].

    Successive points that are `step` [m] apart are found fastest; any others are right as well.
    """
    found = np.empty(len(points))
    _distances(tree.corners, tree.normals, tree.triangle, tree.low, tree.high, tree.inside, points, step, found)
    return found


def _normals(corners: Floats, faces: Ints, vertex_count: int) -> Floats:
    edge = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edge[:, 0], edge[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    back = -np.roll(edge, 1, axis=1)
    cosine = np.sum(edge * back, axis=2) / (np.linalg.norm(edge, axis=2) * np.linalg.norm(back, axis=2))
    of_vertex = np.zeros((vertex_count, 3))
    np.add.at(of_vertex, faces, np.arccos(np.clip(cosine, -1.0, 1.0))[:, :, None] * normal[:, None])
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    _, number = np.unique(ends, axis=0, return_inverse=True)
    number = number.reshape(faces.shape)
    of_edge = np.zeros((int(number.max()) + 1, 3))
    np.add.at(of_edge, number, normal[:, None])
    return np.concatenate([normal[:, None], of_vertex[faces], of_edge[number]], axis=1)


@njit(cache=True)
def _divide(corners, middle, triangle, low, high, inside):
    """Write the boxes, dividing each at the median along the axis of its widest spread; returns their number."""
    count = 1
    inside[0, 1], inside[0, 2] = 0, len(triangle)
    box = 0
    while box < count:
        first, end = inside[box, 1], inside[box, 2]
        low[box], high[box] = np.inf, -np.inf
        widest, axis = -1.0, 0
        for k in range(3):
            least, most = np.inf, -np.inf
            for t in triangle[first:end]:
                least, most = min(least, middle[t, k]), max(most, middle[t, k])
                for c in range(3):
                    low[box, k] = min(low[box, k], corners[t, c, k])
                    high[box, k] = max(high[box, k], corners[t, c, k])
            if most - least > widest:
                widest, axis = most - least, k
        inside[box, 0] = -1
        if end - first > LEAF:
            range_of_box = triangle[first:end].copy()
            triangle[first:end] = range_of_box[np.argsort(middle[range_of_box, axis], kind="mergesort")]
            half = (first + end) // 2
            inside[box, 0] = count
            inside[count, 1], inside[count, 2] = first, half
            inside[count + 1, 1], inside[count + 1, 2] = half, end
            count += 2
        box += 1
    return count


@njit(cache=True)
def _distances(corners, normals, triangle, low, high, inside, points, step, found):
    stack, closest, best_offset = np.empty(2 * DEPTH, np.int64), np.empty(3), np.empty(3)
    before = np.inf
    for i in range(len(points)):
        x = points[i]
        if i > 0:
            moved = 0.0
            for k in range(3):
                moved += (x[k] - points[i - 1, k]) ** 2
            # whatever is closest is not further than that of the point before, had it to come all the way
            before = abs(found[i - 1]) + np.sqrt(moved) if moved <= (1.01 * step) ** 2 else np.inf
        best = (before * (1.0 + 1e-9) + 1e-300) ** 2
        sign = 1.0
        stack[0] = 0
        length = 1
        while length > 0:
            length -= 1
            box = stack[length]
            if _outside(x, low[box], high[box]) > best:
                continue
            if inside[box, 0] >= 0:
                near, far = inside[box, 0], inside[box, 0] + 1
                if _outside(x, low[near], high[near]) > _outside(x, low[far], high[far]):
                    near, far = far, near
                stack[length], stack[length + 1] = far, near
                length += 2
                continue
            for t in triangle[inside[box, 1] : inside[box, 2]]:
                part = _closest(x, corners[t, 0], corners[t, 1], corners[t, 2], closest)
                square = along = 0.0
                for k in range(3):
                    best_offset[k] = x[k] - closest[k]
                    square += best_offset[k] ** 2
                    along += best_offset[k] * normals[t, part, k]
                if square <= best:
                    best, sign = square, 1.0 if along >= 0.0 else -1.0
        found[i] = sign * np.sqrt(best)


@njit(cache=True)
def _outside(x, low, high):
    square = 0.0
    for k in range(3):
        d = max(low[k] - x[k], x[k] - high[k], 0.0)
        square += d * d
    return square


@njit(cache=True)
def _closest(x, a, b, c, closest):
    """Write the point of the triangle closest to x; returns where it is: 0 face, 1 to 3 vertices, 4 to 6 edges."""
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for k in range(3):
        ab, ac = b[k] - a[k], c[k] - a[k]
        d1 += ab * (x[k] - a[k])
        d2 += ac * (x[k] - a[k])
        d3 += ab * (x[k] - b[k])
        d4 += ac * (x[k] - b[k])
        d5 += ab * (x[k] - c[k])
        d6 += ac * (x[k] - c[k])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        part, s, t = 1, 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        part, s, t = 2, 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        part, s, t = 3, 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        part, s, t = 4, d1 / (d1 - d3), 0.0
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        part, s = 5, 1.0 - t
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        part, s, t = 6, 0.0, d2 / (d2 - d6)
    else:
        part, s, t = 0, vb / (va + vb + vc), vc / (va + vb + vc)
    for k in range(3):
        closest[k] = a[k] + s * (b[k] - a[k]) + t * (c[k] - a[k])
    return part
