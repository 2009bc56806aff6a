"""Kernels that run an effect, or a material behind a compliance, over a whole recording."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.jit import kernel

_F8 = types.float64
_ROW = types.Array(_F8, 1, "C")
_STEP = types.FunctionType(_F8(_ROW, _F8, _F8, _F8, _F8, _F8, _ROW))


@kernel
def _advance(
    step: Any,
    x: Vector,
    v: Vector,
    a: Vector,
    t: Vector,
    dt: float,
    eta: Vector,
    state: Vector,
    out: Vector,
) -> None:
    for i in range(x.size):
        out[i] = step(state, x[i], v[i], a[i], t[i], dt, eta)


# Compiled for function pointers, once: left alone, numba would compile it anew for each effect.
_RUNNER: Any = _advance
_RUNNER.compile(types.void(_STEP, _ROW, _ROW, _ROW, _ROW, _F8, _ROW, _ROW, _ROW))
_RUNNER.disable_compile()


def run_step(
    effect: Effect, x: Vector, v: Vector, a: Vector, t: Vector, dt: float, eta: Vector
) -> Vector:
    """Return the effect's value at every sample, its memory starting empty."""
    state = np.zeros(max(1, effect.state_size))
    value = np.empty_like(x)
    _RUNNER(effect.step, x, v, a, t, dt, eta, state, value)
    return value


def press_in_series(
    x: Vector, v: Vector, k: float, n: float, b: float, nb: float, c: float, dt: float
) -> Vector:
    """Return the force f = k p^n + b p^nb p' with p = x - c f, behind the compliance c.

    Implicit in f, whose rate is its backward difference; Newton's method, where F falls with f.
    """
    force = np.zeros_like(x)
    _press_in_series(x, v, k, n, b, nb, c, dt, force)
    return force


@kernel
def _press_in_series(
    x: Vector,
    v: Vector,
    k: float,
    n: float,
    b: float,
    nb: float,
    c: float,
    dt: float,
    out: Vector,
) -> None:
    last = 0.0
    for i in range(x.size):
        if x[i] <= 0.0:
            last = 0.0
            continue
        f = last
        for _ in range(12):
            f = min(f, 0.999 * x[i] / c)
            p = x[i] - c * f
            w = v[i] - c * (f - last) / dt
            value = k * p**n + b * p**nb * w
            slope = -c * (k * n * p ** (n - 1.0) + b * p**nb / dt)
            if nb > 0.0:
                slope -= c * b * nb * p ** (nb - 1.0) * w
            step = (value - f) / (1.0 - min(slope, 0.0))
            f += step
            if abs(step) < 1e-9 * (1.0 + abs(f)):
                break
        out[i] = f
        last = f
