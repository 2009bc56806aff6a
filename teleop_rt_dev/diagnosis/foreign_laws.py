"""The laws of the second generator: other forms than those of the first and of the library."""

from __future__ import annotations

import numba
import numpy as np

from teleop_rt_dev.diagnosis.foreign_motions import RATE_HZ

H = 1.0 / RATE_HZ


@numba.njit(cache=True)
def hunt_crossley_behind(x, k, b, n, ks):  # type: ignore[no-untyped-def]
    """Spring ks in front of p^n (k + b p'), backward Euler, bisection; n = 0: linear damper."""
    out = np.zeros_like(x)
    p = 0.0
    for i in range(x.size):
        if x[i] <= 0.0:
            p = 0.0
            continue
        low, high = 0.0, x[i]
        for _ in range(40):
            m = 0.5 * (low + high)
            rate = (m - p) * 1e4
            force = k * m + b * rate if n == 0.0 else m**n * (k + b * rate)
            if force > ks * (x[i] - m):
                high = m
            else:
                low = m
        p = 0.5 * (low + high)
        out[i] = ks * (x[i] - p)
    return out


@numba.njit(cache=True)
def elasto_plastic(v, breakaway, stiffness, share):  # type: ignore[no-untyped-def]
    """Friction after Dupont: purely elastic below a share of the breakaway stretch."""
    out = np.empty_like(v)
    z = 0.0
    top = breakaway / stiffness
    for i in range(v.size):
        d = v[i] * 1e-4
        steps = 1 + int(abs(d) / (0.1 * top))
        for _ in range(steps):
            alpha = 0.0
            if z * v[i] > 0.0 and abs(z) > share * top:
                u = min((abs(z) - share * top) / (top - share * top), 1.0)
                alpha = 0.5 - 0.5 * np.cos(np.pi * u)
            z += d / steps * (1.0 - alpha * z / top * np.sign(v[i]))
        out[i] = stiffness * z
    return out


@numba.njit(cache=True)
def jenkin(x, yields):  # type: ignore[no-untyped-def]
    """Parallel elastic-perfectly-plastic elements (Masing, Iwan): mean of their forces."""
    out = np.zeros_like(x)
    s = np.zeros_like(yields)
    for i in range(1, x.size):
        for j in range(yields.size):
            s[j] = min(max(s[j] + x[i] - x[i - 1], -yields[j]), yields[j])
            out[i] += s[j] / yields.size
    return out


@numba.njit(cache=True)
def play(x, gap, start):  # type: ignore[no-untyped-def]
    out = np.empty_like(x)
    tip = x[0] + start * 0.5 * gap
    for i in range(x.size):
        tip = min(max(tip, x[i] - 0.5 * gap), x[i] + 0.5 * gap)
        out[i] = tip
    return out


@numba.njit(cache=True)
def capillary(x, reach):  # type: ignore[no-untyped-def]
    out = np.zeros_like(x)
    wet = False
    for i in range(x.size):
        if x[i] > 0.0:
            wet = True
        elif x[i] < -reach:
            wet = False
        elif wet:
            out[i] = -1.0 / (1.0 - 1.5 * x[i] / reach) ** 2
    return out
