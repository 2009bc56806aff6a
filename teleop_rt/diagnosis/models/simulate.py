"""Kernels that run an effect over a whole recording."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.experimental.function_type import _get_wrapper_address

from teleop_rt.contact.effect import Effect, StepFunction, Vector
from teleop_rt.kernels.jit import kernel

_F8 = types.float64
_ROW = types.Array(_F8, 1, "C")
_SIGNATURE = _F8(_ROW, _F8, _F8, _F8, _F8, _F8, _ROW)
_STEP = types.FunctionType(_SIGNATURE)


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


# Compiled for function pointers, once: otherwise numba would compile it again for each effect.
_RUNNER: Any = _advance
_RUNNER.compile(types.void(_STEP, _ROW, _ROW, _ROW, _ROW, _F8, _ROW, _ROW, _ROW))
_RUNNER.disable_compile()


class _Address(types.WrapperAddressProtocol):
    """A compiled step as numba passes it on fastest; looking it up again takes 50 us a call."""

    _numba_type_ = _STEP  # declared here, because a look-up at each call takes as long

    def __init__(self, step: StepFunction) -> None:
        self._address = _get_wrapper_address(step, _SIGNATURE)  # type: ignore[no-untyped-call]

    def __wrapper_address__(self) -> int:
        return int(self._address)

    def signature(self) -> Any:
        return _SIGNATURE


@cache
def _address_of(step: StepFunction) -> _Address:
    return _Address(step)


def run_step(
    effect: Effect, x: Vector, v: Vector, a: Vector, t: Vector, dt: float, eta: Vector
) -> Vector:
    """Return the effect's value at every sample, its memory starting empty."""
    state = np.zeros(max(1, effect.state_size))
    value = np.empty_like(x)
    _RUNNER(_address_of(effect.step), x, v, a, t, dt, eta, state, value)
    return value


def first_order(row: Vector, kept: float, ahead: float, before: float) -> Vector:
    """Return y_i = `kept` y_(i-1) + `ahead` row_i; `before` is the value before the first."""
    found = np.empty_like(row)
    _first_order(row, kept, ahead, before, found)
    return found


@kernel
def _first_order(row: Vector, kept: float, ahead: float, before: float, out: Vector) -> None:
    value = before
    for i in range(row.size):
        value = kept * value + ahead * row[i]
        out[i] = value


def late(row: Vector, steps: float) -> Vector:
    """Return a row of samples later by so many steps, in straight lines between two of them.

    Beyond its ends it stays as it is there.
    """
    found = np.empty_like(row)
    _late(row, steps, found)
    return found


@kernel
def _late(row: Vector, steps: float, out: Vector) -> None:
    whole, last = math.floor(steps), row.size - 1
    share = steps - whole
    for i in range(row.size):
        nearer = row[min(max(i - whole, 0), last)]
        out[i] = nearer + share * (row[min(max(i - whole - 1, 0), last)] - nearer)


def over_steps(velocity: Vector) -> Vector:
    """Return the velocity midway between each sample and the one before, where a memory advances.

    The velocity at the sample itself would advance it by half a sample, and look like a delay. A
    cubic through four samples keeps the reversals that the mean of two would round: a damper's
    error on held-out blocks is 0.037 by it and 0.066 by the mean.
    """
    found = np.empty_like(velocity)
    _over_steps(velocity, found)
    return found


@kernel
def _over_steps(v: Vector, out: Vector) -> None:
    last = v.size - 1
    out[0] = v[0]
    for i in range(1, v.size):
        middle, beyond = v[i - 1] + v[i], v[max(i - 2, 0)] + v[min(i + 1, last)]
        out[i] = 0.5625 * middle - 0.0625 * beyond  # weights of a cubic: 9/16 and -1/16


def rate_of(row: Vector, dt: float) -> Vector:
    """Return the rate of change by central differences, one-sided at the ends."""
    found = np.empty_like(row)
    _rate_of(row, dt, found)
    return found


@kernel
def _rate_of(row: Vector, dt: float, out: Vector) -> None:
    last = row.size - 1
    for i in range(1, last):
        out[i] = (row[i + 1] - row[i - 1]) / (2.0 * dt)
    out[0], out[last] = (row[1] - row[0]) / dt, (row[last] - row[last - 1]) / dt
