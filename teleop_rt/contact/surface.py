"""Refinement of the surface after each contact, by fits in which the surface is free.

A straight line finds it from recursive sums (free intercept). A curved characteristic would
extrapolate to a wrong surface, so Hunt-Crossley's law is fitted too, over a thinned record of the
contact: one candidate surface per tick, by golden section, so that no tick is long.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import spring_force_of_log
from teleop_rt.kernels.jit import kernel

Matrix = NDArray[np.float64]

# Sums over a contact of products of (1, x, v, f).
N, X, V, F, XX, XV, VV, XF, VF, FF, N_SUMS = range(11)
# The refit: samples recorded, one of how many, samples passed, and the search's state.
(
    KEPT,
    STRIDE,
    PASSED,
    STEP,
    LOW,
    HIGH,
    INNER_LOW,
    INNER_HIGH,
    AT_LOW,
    AT_HIGH,
    LINEAR_SHIFT,
    LINEAR_VARIANCE,
    LINEAR_RESIDUAL,
    LINEAR_STIFFNESS,
    FOUND,
    FOUND_VARIANCE,
    SPAN,
    N_REFIT,
) = range(18)
BUFFER = 512
"""Samples kept of a contact; a full buffer is thinned by half."""
LEAST_SAMPLES = 100.0
"""Samples below which neither line nor power law is fitted."""
IDLE, SEARCH_STEPS, DONE = 0.0, 26.0, 29.0
"""Steps of a refit: golden sections, each 0.62 of the last (26: 4e-6 of the span), then a fit, a
comparison and the end; one in each tick, so that no tick pays for all."""
GOLDEN = 0.6180339887498949
"""(sqrt 5 - 1)/2, the share of an interval that golden-section search keeps."""
# A line is believed when its residual is below these: deviations of noise, share of the force.
RESIDUAL_NOISE = 3.0
RESIDUAL_SHARE = 0.01
# Filtered residuals are correlated in time: one sample of this many counts as independent.
CORRELATED = 10.0
# The power law replaces the line where it leaves less than this share of its residual power.
CURVED = 0.5
UNKNOWN = 1e30
"""Variance of a surface that no line was believed to give."""
# A surface found to no better than this share of the motion's span is no news.
VAGUE = 0.1


@kernel
def add_sample(
    sums: Vector, buffer: Matrix, refit: Vector, x: float, v: float, f: float, least: float
) -> None:
    """Add one sample of a contact: penetration x, velocity v and force f, through one filter.

    buffer (3, BUFFER) keeps those above the force `least`, thinned by half whenever it is full.
    """
    sums[N] += 1.0
    sums[X] += x
    sums[V] += v
    sums[F] += f
    sums[XX] += x * x
    sums[XV] += x * v
    sums[VV] += v * v
    sums[XF] += x * f
    sums[VF] += v * f
    sums[FF] += f * f
    if not f > least:
        return
    refit[PASSED] += 1.0
    if refit[PASSED] < refit[STRIDE]:
        return
    refit[PASSED] = 0.0
    if refit[KEPT] >= BUFFER:
        for i in range(BUFFER // 2):
            for j in range(3):
                buffer[j, i] = buffer[j, 2 * i]
        refit[KEPT] = BUFFER // 2
        refit[STRIDE] *= 2.0
    kept = int(refit[KEPT])
    buffer[0, kept], buffer[1, kept], buffer[2, kept] = x, v, f
    refit[KEPT] += 1.0


@kernel
def forget_contact(sums: Vector, refit: Vector) -> None:
    """Make room for a new contact."""
    for i in range(N_SUMS):
        sums[i] = 0.0
    refit[KEPT] = refit[PASSED] = 0.0
    refit[STRIDE] = 1.0
    refit[STEP] = IDLE


@kernel
def fit_line(sums: Vector, refit: Vector, force_noise: float) -> None:
    """Fit f = c + k x + b v: the surface shifts by -c/k; UNKNOWN variance if not believed.

    Not believed: too few samples, no motion, a stiffness that is not positive, or a residual that
    a straight line does not explain.
    """
    refit[LINEAR_VARIANCE] = UNKNOWN
    refit[LINEAR_RESIDUAL] = UNKNOWN
    n = sums[N]
    if n < LEAST_SAMPLES:
        return
    mx, mv, mf = sums[X] / n, sums[V] / n, sums[F] / n
    sxx = sums[XX] / n - mx * mx
    sxv = sums[XV] / n - mx * mv
    svv = sums[VV] / n - mv * mv
    sxf = sums[XF] / n - mx * mf
    svf = sums[VF] / n - mv * mf
    sff = sums[FF] / n - mf * mf
    determinant = sxx * svv - sxv * sxv
    if not determinant > 1e-6 * sxx * svv:
        return
    k = (svv * sxf - sxv * svf) / determinant
    b = (sxx * svf - sxv * sxf) / determinant
    residual = max(sff - k * sxf - b * svf, 0.0)
    refit[LINEAR_RESIDUAL] = residual
    allowed = max(RESIDUAL_NOISE * force_noise, RESIDUAL_SHARE * 2.0 * math.sqrt(max(sff, 0.0)))
    if not k > 0.0 or not residual < allowed * allowed:
        return
    shift = mx - (mf - b * mv) / k
    noise = max(residual, force_noise * force_noise) * CORRELATED / n
    lever = mx - shift
    refit[LINEAR_SHIFT], refit[LINEAR_STIFFNESS] = shift, k
    refit[LINEAR_VARIANCE] = noise / (k * k) * (1.0 + lever * lever * svv / determinant)


@kernel
def power_law(buffer: Matrix, kept: int, shift: float) -> tuple[float, float, float]:
    """Fit Hunt-Crossley's law with the surface at `shift`: its mean square error, ln k and n.

    Least squares of ln f on [1, v, ln(x - shift)], weighted by f^2 (2.6). UNKNOWN error without
    motion.
    """
    s0 = s1 = s2 = s11 = s12 = s22 = sy = s1y = s2y = syy = 0.0
    for i in range(kept):
        f = buffer[2, i]
        w = f * f
        v = buffer[1, i]
        lx = math.log(max(buffer[0, i] - shift, 1e-9))
        y = math.log(f)
        s0 += w
        s1 += w * v
        s2 += w * lx
        s11 += w * v * v
        s12 += w * v * lx
        s22 += w * lx * lx
        sy += w * y
        s1y += w * v * y
        s2y += w * lx * y
        syy += w * y * y
    a11, a12, a22 = s11 - s1 * s1 / s0, s12 - s1 * s2 / s0, s22 - s2 * s2 / s0
    c1, c2, cy = s1y - s1 * sy / s0, s2y - s2 * sy / s0, syy - sy * sy / s0
    determinant = a11 * a22 - a12 * a12
    if not determinant > 1e-9 * a11 * a22:
        return UNKNOWN, 0.0, 0.0
    ratio = (a22 * c1 - a12 * c2) / determinant
    exponent = (a11 * c2 - a12 * c1) / determinant
    scale = (sy - ratio * s1 - exponent * s2) / s0
    return max(cy - ratio * c1 - exponent * c2, 0.0) / kept, scale, exponent


@kernel
def power_residual(buffer: Matrix, kept: int, shift: float) -> float:
    """Return the mean square force error of Hunt-Crossley's law with the surface at `shift`."""
    return power_law(buffer, kept, shift)[0]


@kernel
def start_search(buffer: Matrix, refit: Vector, resolution: float) -> None:
    """Bracket the surface between the shallowest sample and as far above it as the motion spans."""
    kept = int(refit[KEPT])
    if kept < LEAST_SAMPLES:
        refit[STEP] = DONE
        refit[FOUND_VARIANCE] = UNKNOWN
        refit[AT_LOW] = UNKNOWN
        return
    shallow, deep = buffer[0, 0], buffer[0, 0]
    for i in range(kept):
        shallow = min(shallow, buffer[0, i])
        deep = max(deep, buffer[0, i])
    refit[HIGH] = shallow - resolution
    refit[LOW] = refit[HIGH] - (deep - shallow)
    refit[STEP] = 1.0
    span = deep - shallow
    refit[SPAN] = span
    refit[INNER_LOW] = refit[HIGH] - GOLDEN * span
    refit[INNER_HIGH] = refit[LOW] + GOLDEN * span
    refit[AT_LOW] = power_residual(buffer, kept, refit[INNER_LOW])
    refit[AT_HIGH] = power_residual(buffer, kept, refit[INNER_HIGH])


@kernel
def search_step(buffer: Matrix, refit: Vector) -> None:
    """Try one more candidate surface; the last steps measure the curvature about the best."""
    kept = int(refit[KEPT])
    refit[STEP] += 1.0
    if refit[STEP] <= SEARCH_STEPS:
        if refit[AT_LOW] < refit[AT_HIGH]:
            refit[HIGH], refit[INNER_HIGH] = refit[INNER_HIGH], refit[INNER_LOW]
            refit[AT_HIGH] = refit[AT_LOW]
            refit[INNER_LOW] = refit[HIGH] - GOLDEN * (refit[HIGH] - refit[LOW])
            refit[AT_LOW] = power_residual(buffer, kept, refit[INNER_LOW])
        else:
            refit[LOW], refit[INNER_LOW] = refit[INNER_LOW], refit[INNER_HIGH]
            refit[AT_LOW] = refit[AT_HIGH]
            refit[INNER_HIGH] = refit[LOW] + GOLDEN * (refit[HIGH] - refit[LOW])
            refit[AT_HIGH] = power_residual(buffer, kept, refit[INNER_HIGH])
        return
    if refit[STEP] == SEARCH_STEPS + 1.0:
        best = 0.5 * (refit[LOW] + refit[HIGH])
        refit[FOUND] = best
        refit[AT_LOW] = power_residual(buffer, kept, best)
        return
    h = 0.01 * refit[SPAN]
    if refit[STEP] == SEARCH_STEPS + 2.0:
        refit[AT_HIGH] = power_residual(buffer, kept, refit[FOUND] - h)
        return
    above = power_residual(buffer, kept, refit[FOUND] + h)
    curvature = kept * (refit[AT_HIGH] + above - 2.0 * refit[AT_LOW]) / (h * h)
    independent = CORRELATED / refit[STRIDE]
    noise = refit[AT_LOW] * max(independent, 1.0)
    refit[FOUND_VARIANCE] = 2.0 * noise / curvature if curvature > 0.0 else UNKNOWN


@kernel
def choose_surface(buffer: Matrix, refit: Vector, air: float, unnoticed: float) -> bool:
    """Put the better of line and power law in FOUND; return whether there is one to believe.

    Not believed: a law by which the tool would have felt more than the force `unnoticed` at a place
    `air`, where it met nothing on its way in. A body in layers is bent by no power law, and the
    best of them begins millimetres before its surface.
    """
    curved = refit[AT_LOW] < CURVED * refit[LINEAR_RESIDUAL]
    if not curved:
        refit[FOUND] = refit[LINEAR_SHIFT]
        refit[FOUND_VARIANCE] = refit[LINEAR_VARIANCE]
    limit = VAGUE * refit[SPAN]
    if not refit[FOUND_VARIANCE] < limit * limit:
        return False
    depth = air - refit[FOUND]
    if not (0.0 < depth < np.inf):
        return True
    force = refit[LINEAR_STIFFNESS] * depth
    if curved:
        _, scale, exponent = power_law(buffer, int(refit[KEPT]), refit[FOUND])
        force = spring_force_of_log(depth, scale, exponent)
    return bool(force < unnoticed)
