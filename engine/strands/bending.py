"""Bending of discrete elastic rods (Fei 2019, appendix I).

At vertex i between edges 0 and 1 the integrated curvature vector is kb = 2 t0 x t1 / (1 + t0.t1) (A1). The material frames
of both edges see it: kappa_1 = m2.kb, kappa_2 = -m1.kb (A6), and the energy is

    E = sum_j sum_c B_c (kappa_c^j - rest)^2 / 4    (A31; B_c is E I_c over the vertex's rest length)

Its derivatives are with respect to the two edges e0, e1 and the turns g0, g1 of their frames. For any fixed vector v, with
f = v.kb and chi = 1 + t0.t1,

    df/de0 = (2 t1 x v - f (t0 + t1)) / (|e0| chi),    df/de1 = (2 v x t0 - f (t0 + t1)) / (|e1| chi)

which is (A13) for v = m2. What edges do to their frames adds nothing to first order, since kb is across both, and
(m kb^T + kb m^T) / (2 |e|^2) to second, which (A23) to (A29) leave out. Edges that fold back on each other have chi = 0, where
kb is undefined: FOLD keeps it finite and changes nothing else. It rises to some million just before, and is 0 at the very fold.
"""

from numba import njit

from engine.geometry.frames import cross, dot, row

FOLD = 1e-12  # added to chi


@njit(cache=True, error_model="numpy")
def curvatures(t, m1, m2, binormal, kappa):
    """Write kb of the inner vertices to `binormal` [V, 3] and (kappa_1, kappa_2) in both frames to `kappa` [V, 2, 2].

    t, m1, m2 [V, 3] are tangents and material directions of edges; the last one of each is not read.
    """
    for i in range(1, len(t) - 1):
        t0, t1 = row(t, i - 1), row(t, i)
        kb = cross(t0, t1)
        scale = 2.0 / (1.0 + FOLD + dot(t0, t1))
        for k in range(3):
            binormal[i, k] = scale * kb[k]
        for j in range(2):
            kappa[i, j, 0] = scale * dot(row(m2, i - 1 + j), kb)
            kappa[i, j, 1] = -scale * dot(row(m1, i - 1 + j), kb)


@njit(cache=True, error_model="numpy")
def energy(kappa, rest, stiffness):
    """Energy of a strand [J]; `rest` [V, 2, 2] are its kappa at rest, `stiffness` [V, 2] is B [N m]."""
    total = 0.0
    for i in range(1, len(kappa) - 1):
        for j in range(2):
            for c in range(2):
                total += 0.25 * stiffness[i, c] * (kappa[i, j, c] - rest[i, j, c]) ** 2
    return total


@njit(cache=True, error_model="numpy")
def moments(i, j, kappa, rest, stiffness):
    """Derivatives of the energy by kappa_1 and kappa_2 of vertex i in the frame of edge j [N m]."""
    return (
        0.5 * stiffness[i, 0] * (kappa[i, j, 0] - rest[i, j, 0]), 0.5 * stiffness[i, 1] * (kappa[i, j, 1] - rest[i, j, 1])
    )


@njit(cache=True, error_model="numpy")
def couple(i, j, m1, m2, kappa, rest, stiffness):
    """The vector v whose v.kb varies as the energy of vertex i does by what the frame of edge j sees [N m]."""
    first, second = moments(i, j, kappa, rest, stiffness)
    e = i - 1 + j
    return (
        first * m2[e, 0] - second * m1[e, 0], first * m2[e, 1] - second * m1[e, 1], first * m2[e, 2] - second * m1[e, 2]
    )


@njit(cache=True, error_model="numpy")
def slopes(v, f, t0, t1, length0, length1, chi):
    """df/de0 and df/de1 of f = v.kb."""
    a, b = cross(t1, v), cross(v, t0)
    p, q = 1.0 / (length0 * chi), 1.0 / (length1 * chi)
    near = 1.0 + FOLD
    return (
        (
            p * (2.0 * a[0] - f * (near * t0[0] + t1[0])), p * (2.0 * a[1] - f * (near * t0[1] + t1[1])),
            p * (2.0 * a[2] - f * (near * t0[2] + t1[2])),
        ),
        (
            q * (2.0 * b[0] - f * (t0[0] + near * t1[0])), q * (2.0 * b[1] - f * (t0[1] + near * t1[1])),
            q * (2.0 * b[2] - f * (t0[2] + near * t1[2])),
        ),
    )


@njit(cache=True, error_model="numpy")
def add_gradient(i, t, length, m1, m2, binormal, kappa, rest, stiffness, gradient):
    """Add the derivatives of the energy at vertex i to `gradient` [8]: by e0 and e1 [N], then by g0 and g1 [N m]."""
    t0, t1, kb = row(t, i - 1), row(t, i), row(binormal, i)
    on_0 = couple(i, 0, m1, m2, kappa, rest, stiffness)
    on_1 = couple(i, 1, m1, m2, kappa, rest, stiffness)
    v = (on_0[0] + on_1[0], on_0[1] + on_1[1], on_0[2] + on_1[2])
    d0, d1 = slopes(v, dot(v, kb), t0, t1, length[i - 1], length[i], 1.0 + FOLD + dot(t0, t1))
    for k in range(3):
        gradient[k] += d0[k]
        gradient[3 + k] += d1[k]
    for j in range(2):
        first, second = moments(i, j, kappa, rest, stiffness)
        gradient[6 + j] += first * kappa[i, j, 1] - second * kappa[i, j, 0]


@njit(cache=True, error_model="numpy")
def add_hessian(i, t, length, m1, m2, binormal, kappa, rest, stiffness, positive, strain, hessian):
    """Add the second derivatives of the energy at vertex i to the lower half of `hessian` [8, 8].

    Where `positive`, those of the curvatures are left out. `strain` [4, 8] is memory for their first derivatives.
    """
    t0, t1, kb = row(t, i - 1), row(t, i), row(binormal, i)
    length0, length1, chi = length[i - 1], length[i], 1.0 + FOLD + dot(t0, t1)
    for j in range(2):
        d0, d1 = slopes(row(m2, i - 1 + j), kappa[i, j, 0], t0, t1, length0, length1, chi)
        c0, c1 = slopes(row(m1, i - 1 + j), -kappa[i, j, 1], t0, t1, length0, length1, chi)
        for k in range(3):
            strain[2 * j, k], strain[2 * j, 3 + k] = d0[k], d1[k]
            strain[2 * j + 1, k], strain[2 * j + 1, 3 + k] = -c0[k], -c1[k]
        strain[2 * j, 6 + j], strain[2 * j, 7 - j] = kappa[i, j, 1], 0.0
        strain[2 * j + 1, 6 + j], strain[2 * j + 1, 7 - j] = -kappa[i, j, 0], 0.0
    w0, w1 = 0.5 * stiffness[i, 0], 0.5 * stiffness[i, 1]
    for a in range(8):
        p, q, r, s = w0 * strain[0, a], w1 * strain[1, a], w0 * strain[2, a], w1 * strain[3, a]
        for b in range(a + 1):
            hessian[a, b] += p * strain[0, b] + q * strain[1, b] + r * strain[2, b] + s * strain[3, b]
    if not positive:
        _add_curvature(i, t0, t1, length0, length1, kb, chi, m1, m2, kappa, rest, stiffness, strain, hessian)


@njit(cache=True, error_model="numpy")
def _add_curvature(i, t0, t1, length0, length1, kb, chi, m1, m2, kappa, rest, stiffness, strain, hessian):
    """Add what the second derivatives of the curvatures make; `strain` [4, 8] are the first ones."""
    on_0 = couple(i, 0, m1, m2, kappa, rest, stiffness)
    on_1 = couple(i, 1, m1, m2, kappa, rest, stiffness)
    v = (on_0[0] + on_1[0], on_0[1] + on_1[1], on_0[2] + on_1[2])
    f, near = dot(v, kb), 1.0 + FOLD
    d0, d1 = slopes(v, f, t0, t1, length0, length1, chi)
    p, q = 1.0 / (length0 * chi), 1.0 / (length1 * chi)
    for a in range(3):
        s0, s1 = near * t0[a] + t1[a], t0[a] + near * t1[a]
        for b in range(3):
            z0, z1 = near * t0[b] + t1[b], t0[b] + near * t1[b]
            identity = 1.0 if a == b else 0.0
            if b <= a:
                hessian[a, b] -= p * (d0[a] * z0 + s0 * d0[b] + f * near * (identity - t0[a] * t0[b]) / length0)
                hessian[a, b] += 0.5 * (on_0[a] * kb[b] + kb[a] * on_0[b]) / (length0 * length0)
                hessian[3 + a, 3 + b] -= q * (d1[a] * z1 + s1 * d1[b] + f * near * (identity - t1[a] * t1[b]) / length1)
                hessian[3 + a, 3 + b] += 0.5 * (on_1[a] * kb[b] + kb[a] * on_1[b]) / (length1 * length1)
            hessian[3 + a, b] -= q * s1 * d0[b] + p * d1[a] * z0 + p * f * (near * t1[a] * t0[b] + identity) / length1
    scale = 2.0 * p / length1
    for a in range(3):  # 2 [v]_x
        b, c = (a + 1) % 3, (a + 2) % 3
        hessian[3 + a, b] -= scale * v[c]
        hessian[3 + b, a] += scale * v[c]
    for j in range(2):  # turns take kappa_1 to kappa_2, and kappa_2 to -kappa_1
        first, second = moments(i, j, kappa, rest, stiffness)
        hessian[6 + j, 6 + j] -= first * kappa[i, j, 0] + second * kappa[i, j, 1]
        for k in range(6):
            hessian[6 + j, k] += first * strain[2 * j + 1, k] - second * strain[2 * j, k]
