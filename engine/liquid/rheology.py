"""Shear stress of one point of liquid: elastic strain, Herschel-Bulkley flow, and how stress follows the velocity (Fei 2019).

A step strains a point elastically, b to b* (eq. 13.12 without its last term), then lets it flow: the shear stress s = mu dev(b)
keeps its direction, and its norm goes from s* to s by ds/dt = -2 mu_hat gamma(s) (eq. 14.16). Both returns to s are here, the
one in closed form and backward Euler. After a whole elastic step the closed form leaves too little: in steady flow of a liquid
without yield stress, n = 1, it has x / (e^x - 1) of the stress, x = 2 mu_hat h / eta (95 % at x = 0.1, 58 % at x = 1, 0.05 % at
x = 10), as all that the step strains has the whole step to flow. Backward Euler has all of it at any h.

Symmetric tensors are six numbers xx, yy, zz, yz, xz, xy, given as anything with an index and returned as tuples: a loop over
points allocates nothing. A velocity gradient [1/s] is [3, 3], its rows are components of velocity. The yield norm of all
functions is sigma = sqrt(2/3) tau_Y [Pa].
"""

import numpy as np
from numba import njit

MOST = 60  # Newton steps, of which it takes about five
CLOSE = 4.0 * np.finfo(np.float64).eps  # the last relative change of a root


@njit(cache=True, error_model="numpy")
def elastic_trial(b, gradient, h):
    """Return the strain b* = f b f^T [6] after the strain b [6] moved elastically with `gradient` for h [s].

    f = (I + h grad u) / det^(1/3) keeps volume, even where det is below zero; b* is not a number where it is zero.
    Source: Fei 2019, sec. 14.1, the trial state before eq. 14.9.
    """
    a, c, d = 1.0 + h * gradient[0, 0], h * gradient[0, 1], h * gradient[0, 2]
    e, f, g = h * gradient[1, 0], 1.0 + h * gradient[1, 1], h * gradient[1, 2]
    i, j, k = h * gradient[2, 0], h * gradient[2, 1], 1.0 + h * gradient[2, 2]
    scale = np.cbrt(a * (f * k - g * j) - c * (e * k - g * i) + d * (e * j - f * i)) ** -2
    xx, yy, zz, yz, xz, xy = b[0], b[1], b[2], b[3], b[4], b[5]
    ax, ay, az = a * xx + c * xy + d * xz, a * xy + c * yy + d * yz, a * xz + c * yz + d * zz  # rows of (I + h grad u) b
    ex, ey, ez = e * xx + f * xy + g * xz, e * xy + f * yy + g * yz, e * xz + f * yz + g * zz
    ix, iy, iz = i * xx + j * xy + k * xz, i * xy + j * yy + k * yz, i * xz + j * yz + k * zz
    return (
        scale * (ax * a + ay * c + az * d), scale * (ex * e + ey * f + ez * g), scale * (ix * i + iy * j + iz * k),
        scale * (ex * i + ey * j + ez * k), scale * (ax * i + ay * j + az * k), scale * (ax * e + ay * f + az * g),
    )


@njit(cache=True)
def deviator(a):
    """Return dev(a) [6]: `a` [6] without its mean diagonal."""
    mean = (a[0] + a[1] + a[2]) / 3.0
    return a[0] - mean, a[1] - mean, a[2] - mean, a[3], a[4], a[5]


@njit(cache=True)
def product(a, b):
    """Return a : b, the sum of products of all nine entries of symmetric `a` and `b` [6]."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2.0 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5])


@njit(cache=True)
def trial_stress(trial, shear_modulus):
    """Return what flow needs of b* = `trial` [6]: unit dev(b*) [6], ||dev(b*)||, and mu_hat = mu tr(b*) / 3 [Pa].

    The trial shear stress is s* = mu ||dev(b*)||. Where there is none, its direction is zero. Source: Fei 2019, eq. 14.9.
    """
    mean = (trial[0] + trial[1] + trial[2]) / 3.0
    a = deviator(trial)
    size = np.sqrt(product(a, a))
    inverse = 1.0 / size if size > 0.0 else 0.0
    unit = (inverse * a[0], inverse * a[1], inverse * a[2], inverse * a[3], inverse * a[4], inverse * a[5])
    return unit, size, shear_modulus * mean


@njit(cache=True, error_model="numpy")
def analytic_return(trial, mu_hat, h, yield_norm, consistency, flow_index):
    """Return the norm of shear stress s [Pa] that flow for h [s] leaves of s* = `trial` [Pa], and ds/ds*, in closed form.

    `mu_hat` and `yield_norm` are in Pa, `consistency` eta in Pa s^n. Below yield s is s*; at eta = 0 nothing is left above it.
    The excess s - sigma is e of the trial's, where e^(1 - 1/n) = 1 + (1/n - 1) y and y is what it would lose at its first rate:
    for n = 1, e^-y; for n > 1 nothing is left after a finite time. Source: Fei 2019, eq. 14.9, its exponent for n = 1 corrected.
    """
    excess = trial - yield_norm
    if excess <= 0.0:
        return trial, 1.0
    if consistency == 0.0:
        return yield_norm, 0.0
    power = 1.0 / flow_index - 1.0
    loss = 2.0 * mu_hat * h * (excess / consistency) ** (1.0 / flow_index) / excess
    if power == 0.0:
        left = np.exp(-loss)
    elif power * loss <= -1.0:
        left = 0.0
    else:
        left = np.exp(-np.log1p(power * loss) / power)
    return yield_norm + left * excess, left ** (1.0 / flow_index)


@njit(cache=True, error_model="numpy")
def implicit_return(trial, mu_hat, h, yield_norm, consistency, flow_index):
    """Return the norm of shear stress s [Pa] that flow for h [s] leaves of s* = `trial` [Pa], and ds/ds*, by backward Euler.

    Arguments as of `analytic_return`: s + 2 mu_hat h ((s - sigma) / eta)^(1/n) = s*, to round-off for any n.
    Source: Fei 2019, eq. 14.16 with eq. 13.13 at the end of the step.
    """
    excess = trial - yield_norm
    if excess <= 0.0:
        return trial, 1.0
    if consistency == 0.0:
        return yield_norm, 0.0
    loss = 2.0 * mu_hat * h * (excess / consistency) ** (1.0 / flow_index) / excess
    if flow_index <= 1.0:  # the share e that is left of the excess: e + y e^(1/n) = 1, and the same in e^(1/n)
        left = _root(1.0, loss, 1.0 / flow_index)
    else:
        left = _root(loss, 1.0, flow_index) ** flow_index
    return yield_norm + left * excess, flow_index * left / (flow_index * left + (1.0 - left))


@njit(cache=True)
def plastic_return(trial, mu_hat, h, yield_norm, consistency, flow_index, implicit):
    """Return the norm of shear stress s [Pa] and ds/ds*, by backward Euler where `implicit`, else in closed form."""
    if implicit:
        return implicit_return(trial, mu_hat, h, yield_norm, consistency, flow_index)
    return analytic_return(trial, mu_hat, h, yield_norm, consistency, flow_index)


@njit(cache=True, error_model="numpy")
def _root(a, b, k):
    """Return z of a z + b z^k = 1 for a, b >= 0, k >= 1: convex and rising, so Newton's steps from above only fall."""
    z = min(1.0 / a, b ** (-1.0 / k))
    for _ in range(MOST):
        bent = b * z**k
        fall = (a * z + bent - 1.0) / (a + k * bent / z)
        if not fall > CLOSE * z:
            break
        z -= fall
    return z


@njit(cache=True)
def relaxed_strain(trial, left):
    """Return the strain b [6] after flow: b* = `trial` [6] with `left` = s/s* of its deviator, and its trace.

    Flow of this form makes det b grow at second order in the elastic strain, and with it mu_hat, without end in steady shear:
    see `volume_preserving`. Source: Fei 2019, sec. 14.1, below eq. 14.9.
    """
    rest = (1.0 - left) * (trial[0] + trial[1] + trial[2]) / 3.0
    return (
        left * trial[0] + rest, left * trial[1] + rest, left * trial[2] + rest,
        left * trial[3], left * trial[4], left * trial[5],
    )


@njit(cache=True)
def volume_preserving(b):
    """Return the strain [6] that has the deviator, so the shear stress, of b [6] and a determinant of 1.

    For b after flow, whose determinant is at least 1. Newton on det(dev(b) + t I) = 1 from above, where it is convex.
    Source: plastic flow keeps volume (Fei 2019, sec. 13.1), but its form in (13.12) has dropped the trace that this takes.
    """
    a = deviator(b)
    half = 0.5 * product(a, a)
    det = a[0] * (a[1] * a[2] - a[3] * a[3]) - a[5] * (a[5] * a[2] - a[3] * a[4]) + a[4] * (a[5] * a[3] - a[1] * a[4])
    t = (b[0] + b[1] + b[2]) / 3.0
    for _ in range(MOST):
        fall = ((t * t - half) * t + det - 1.0) / (3.0 * t * t - half)
        if not fall > CLOSE * t:
            break
        t -= fall
    return a[0] + t, a[1] + t, a[2] + t, a[3], a[4], a[5]


@njit(cache=True)
def plastic_strain(before, trial, s, mu_hat, recovery_rate, h):
    """Return the plastic strain after flow from s* = `trial` to s [Pa] in h [s], `before` it and forgotten at a rate [1/s].

    Flow adds the integral of gamma, which is (s* - s) / (2 mu_hat) by eq. 14.16; with recovery it is exact for an even rate.
    """
    decay = recovery_rate * h
    kept = -np.expm1(-decay) / decay if decay > 0.0 else 1.0
    return np.exp(-decay) * before + kept * (trial - s) / (2.0 * mu_hat)


@njit(cache=True)
def strain_rate(gradient):
    """Return dev((grad u + grad u^T) / 2) [6] of a velocity gradient [3, 3], both in 1/s."""
    mean = (gradient[0, 0] + gradient[1, 1] + gradient[2, 2]) / 3.0
    return (
        gradient[0, 0] - mean, gradient[1, 1] - mean, gradient[2, 2] - mean,
        0.5 * (gradient[1, 2] + gradient[2, 1]), 0.5 * (gradient[0, 2] + gradient[2, 0]),
        0.5 * (gradient[0, 1] + gradient[1, 0]),
    )


@njit(cache=True)
def newtonian_stress(gradient, consistency):
    """Return the shear stress [6] [Pa] of a Newtonian liquid of viscosity eta/2 [Pa s] (Fei 2019, eq. 13.15)."""
    e = strain_rate(gradient)
    return (
        consistency * e[0], consistency * e[1], consistency * e[2], consistency * e[3], consistency * e[4], consistency * e[5],
    )


@njit(cache=True)
def tangent_stress(e, unit, across, along):
    """Return the change of shear stress [6] [Pa] by a change of strain rate e = `strain_rate` of grad du [6] [1/s].

    It is across (e - (n : e) n) + along (n : e) n, for the direction n = `unit` [6] of the trial stress. Of the stress at the
    end of a step, across = 2 mu_hat h s/s* and along = 2 mu_hat h ds/ds* [Pa s]: symmetric and never negative, and the
    derivative of stress but for terms of the order of the elastic strain. Source: Fei 2019, eqs. 14.25 to 14.30, derived anew.
    """
    bend = (along - across) * product(unit, e)
    return (
        across * e[0] + bend * unit[0], across * e[1] + bend * unit[1], across * e[2] + bend * unit[2],
        across * e[3] + bend * unit[3], across * e[4] + bend * unit[4], across * e[5] + bend * unit[5],
    )


@njit(cache=True)
def flow_step(b, gradient, h, shear_modulus, yield_norm, consistency, flow_index, implicit):
    """Return the strain b [6] after a step of h [s] with `gradient`: strained, and returned as `implicit` says or in closed form.

    Moduli and `yield_norm` in Pa, `consistency` in Pa s^n.
    """
    trial = elastic_trial(b, gradient, h)
    _, size, mu_hat = trial_stress(trial, shear_modulus)
    if size == 0.0:
        return trial
    pull = shear_modulus * size
    s, _ = plastic_return(pull, mu_hat, h, yield_norm, consistency, flow_index, implicit)
    return relaxed_strain(trial, s / pull)


@njit(cache=True)
def shear(b, rate, h, steps, shear_modulus, yield_norm, consistency, flow_index, implicit, preserving):
    """Return the strain [6] of a point of strain b [6] after `steps` of h [s] in simple shear: grad u has `rate` [1/s] at xy.

    Other arguments as of `flow_step`; with `preserving` the determinant of b is kept, else it is as eq. 13.12 has it.
    """
    gradient = np.zeros((3, 3))
    gradient[0, 1] = rate
    for _ in range(steps):
        b = flow_step(b, gradient, h, shear_modulus, yield_norm, consistency, flow_index, implicit)
        if preserving:
            b = volume_preserving(b)
    return b
