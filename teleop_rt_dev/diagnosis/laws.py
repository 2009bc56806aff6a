"""The laws of the synthetic recordings, each integrated step by step, none of our library."""

from __future__ import annotations

import numba
import numpy as np

from teleop_rt_dev.diagnosis.motions import RATE_HZ, Array

H = 1.0 / RATE_HZ


@numba.njit(cache=True)
def lugre(v, coulomb, static, stribeck, bristle):  # type: ignore[no-untyped-def]
    out = np.empty_like(v)
    z = 0.0
    sigma0 = coulomb / bristle
    sigma1 = 0.3 * np.sqrt(sigma0)
    for i in range(v.size):
        level = coulomb + (static - coulomb) * np.exp(-((v[i] / stribeck) ** 2))
        steps = 1 + int(abs(v[i]) * 1e-4 / (0.2 * bristle))
        h = 1e-4 / steps
        dz = 0.0
        for _ in range(steps):
            dz = v[i] - sigma0 * abs(v[i]) / level * z
            z += h * dz
        out[i] = sigma0 * z + sigma1 * dz * 0.01
    return out


@numba.njit(cache=True)
def arms(depth, stiffness, tau):  # type: ignore[no-untyped-def]
    out = np.zeros_like(depth)
    for j in range(stiffness.size):
        damper = depth[0] * 0.0
        for i in range(depth.size):
            stretch = depth[i] - damper
            out[i] += stiffness[j] * stretch
            damper += 1e-4 * stretch / tau[j]
    return out


@numba.njit(cache=True)
def power_law_memory(depth, order, dt):  # type: ignore[no-untyped-def]
    n = depth.size
    weights = np.empty(n)
    weights[0] = 1.0
    for j in range(1, n):
        weights[j] = weights[j - 1] * (1.0 - (order + 1.0) / j)
    out = np.empty(n)
    for i in range(n):
        total = 0.0
        for j in range(i + 1):
            total += weights[j] * depth[i - j]
        out[i] = total / dt**order
    return out


@numba.njit(cache=True)
def bouc_wen(x, travel, beta, gamma, n):  # type: ignore[no-untyped-def]
    out = np.empty_like(x)
    z = 0.0
    for i in range(x.size):
        if i > 0 and x[i] > 0.0:
            d = (x[i] - max(x[i - 1], 0.0)) / travel
            z += d - beta * abs(d) * abs(z) ** (n - 1.0) * z - gamma * d * abs(z) ** n
        out[i] = z if x[i] > 0.0 else 0.0
    return out


@numba.njit(cache=True)
def play(x, gap):  # type: ignore[no-untyped-def]
    out = np.empty_like(x)
    tip = x[0]
    for i in range(x.size):
        if x[i] - tip > 0.5 * gap:
            tip = x[i] - 0.5 * gap
        elif tip - x[i] > 0.5 * gap:
            tip = x[i] + 0.5 * gap
        out[i] = tip
    return out


@numba.njit(cache=True)
def behind_spring(x, k, b, n, linear, ks):  # type: ignore[no-untyped-def]
    """Spring ks in series with a material, its rate implicit, by bisection: ks (x - p) = F(p)."""
    out = np.zeros_like(x)
    before = max(x[0], 0.0) * (ks / (k + ks) if linear else 0.9)
    for i in range(x.size):
        if x[i] <= 0.0:
            before = 0.0
            continue
        low, high = 0.0, x[i] + 1e-3
        for _ in range(45):
            p = 0.5 * (low + high)
            speed = (p - before) / 1e-4
            force = k * p + b * speed if linear else p**n * (k + b * speed)
            if force > ks * (x[i] - p):
                high = p
            else:
                low = p
        before = 0.5 * (low + high)
        out[i] = ks * (x[i] - before)
    return out


@numba.njit(cache=True)
def first_order(row, tau):  # type: ignore[no-untyped-def]
    out = np.empty_like(row)
    state = row[0]
    for i in range(row.size):
        state += 1e-4 * (row[i] - state) / tau
        out[i] = state
    return out


def adhesion_bridge(x: Array, reach: float) -> Array:
    row = np.zeros_like(x)
    touched = False
    for i, depth in enumerate(x):
        if depth > 0.0:
            touched = True
        elif depth < -reach:
            touched = False
        elif touched:
            row[i] = -(1.0 - (depth / reach) ** 2)
    return row


@numba.njit(cache=True)
def resonance(a, frequency, damping):  # type: ignore[no-untyped-def]
    w = 2.0 * np.pi * frequency
    out = np.empty_like(a)
    x, v = 0.0, 0.0
    for i in range(a.size):
        v += 1e-4 * (a[i] - 2.0 * damping * w * v - w * w * x)
        x += 1e-4 * v
        out[i] = x
    return out
