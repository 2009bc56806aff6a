"""Refinement of the surface after each contact, by a fit with a free intercept."""

from __future__ import annotations

from teleop_rt.contact.effect import Vector
from teleop_rt.jit import kernel

# Sums over a contact of products of (1, x, v, f).
N, X, V, F, XX, XV, VV, XF, VF, FF, N_SUMS = range(11)
LEAST_SAMPLES = 100.0
# The fit is believed when its residual is below these: deviations of noise, share of force range.
RESIDUAL_NOISE = 3.0
RESIDUAL_SHARE = 0.01


@kernel
def add_sample(sums: Vector, x: float, v: float, f: float) -> None:
    """Add one sample of a contact: penetration x, velocity v and force f, filtered alike."""
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


@kernel
def intercept_shift(sums: Vector, force_noise: float, out: Vector) -> bool:
    """Fit f = c + k x + b v and write the shift of the surface -c/k and its variance to `out`.

    Returns false when the fit cannot be believed: too few samples, no motion, a stiffness that is
    not positive, or a residual that a straight line does not explain (a curved characteristic
    extrapolates to a wrong surface).
    """
    n = sums[N]
    if n < LEAST_SAMPLES:
        return False
    mx, mv, mf = sums[X] / n, sums[V] / n, sums[F] / n
    sxx = sums[XX] / n - mx * mx
    sxv = sums[XV] / n - mx * mv
    svv = sums[VV] / n - mv * mv
    sxf = sums[XF] / n - mx * mf
    svf = sums[VF] / n - mv * mf
    sff = sums[FF] / n - mf * mf
    determinant = sxx * svv - sxv * sxv
    if not determinant > 1e-6 * sxx * svv:
        return False
    k = (svv * sxf - sxv * svf) / determinant
    b = (sxx * svf - sxv * sxf) / determinant
    residual = max(sff - k * sxf - b * svf, 0.0)
    allowed = max(RESIDUAL_NOISE * force_noise, RESIDUAL_SHARE * 2.0 * sff**0.5)
    if not k > 0.0 or not residual < allowed * allowed:
        return False
    out[0] = mx - (mf - b * mv) / k
    # Residuals are correlated in time: a tenth of the samples counts as independent.
    noise = max(residual, force_noise * force_noise) * 10.0 / n
    lever = mx - out[0]
    out[1] = noise / (k * k) * (1.0 + lever * lever * svv / determinant)
    return True
