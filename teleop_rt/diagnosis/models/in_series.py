"""The force of a material behind a joint in series, over a whole recording."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.contact.law import (
    damping_at,
    force_behind_joint,
    joint_deflection,
    spring_force,
    touches,
)
from teleop_rt.kernels.jit import kernel

_STEP = 1e-4  # of a parameter: step of the difference that is its derivative
_NEARLY = 1e-6  # of a force: size of the last Newton step, whose error is about its square
_MOST_STEPS = 12  # of Newton's method; three or four suffice


class SpringDamper(NamedTuple):
    """A spring k pⁿ with a damper b p^q p', at a penetration p: k, n, b, q."""

    k: float
    n: float
    b: float
    q: float


class Joint(NamedTuple):
    """A joint in series: its compliance [x/f], and the force at which it has seated [f].

    See `joint_deflection`; a linear one never seats (inf).
    """

    compliance: float
    seated: float


class BodyLoad(NamedTuple):
    """The force that effects of the body add: a row (samples,) [f], and a spring [f/x]."""

    force: Vector
    spring: float


NO_LOAD = BodyLoad(np.zeros(0), 0.0)


def press_in_series(
    x: Vector,
    v: Vector,
    material: SpringDamper,
    joint: Joint,
    dt: float,
    load: BodyLoad = NO_LOAD,
    *,
    clamped: bool,
    slopes: bool = False,
) -> Matrix:
    """Return the force f = k pⁿ + b p^q p' behind a joint, (1, samples), never < 0 if `clamped`.

    A `load` adds its force and that of its spring to f. With `slopes` its derivatives by k and b
    are the second and the third row.

    Implicit in f, whose rate is its backward difference; exact where material and joint are linear,
    for then a damper's force jumps at the contact.
    """
    found = np.zeros((3 if slopes else 1, x.size))
    more = load.force if load.force.size else np.zeros(x.size)
    if material.n == 1.0 and material.q == 0.0 and joint.seated == math.inf:
        k, b = material.k, material.b
        steps = np.diag([0.0, _STEP * k, _STEP * max(b, 1e-3 * k * dt)])[:, 1:]
        for row, (by_k, by_b) in zip(found, steps.tolist(), strict=False):
            stiff = k + by_k + load.spring
            _linear(x, v, stiff, b + by_b, joint.compliance, dt, more, clamped, row)
        found[1:] = (found[1:] - found[0]) / np.sum(steps[1 : len(found)], axis=1)[:, None]
    else:
        _implicit(x, v, material, joint, dt, more, load.spring, clamped, found)
    return found


@kernel
def _linear_in_series(
    x: Vector, v: Vector, i: int, k: float, b: float, c: float, dt: float, more: Vector, last: float
) -> float:
    """Return k p + b p' + `more` behind the compliance.

    It is a low-pass of k x + b v + `more`, from the contact on.
    """
    share = 1.0 + k * c
    touching = i > 0 and x[i - 1] > 0.0
    step, before = dt, k * x[i - 1] + b * v[i - 1] + more[i - 1]
    now = k * x[i] + b * v[i] + more[i]
    if not touching:
        step = min(dt, x[i] / v[i]) if v[i] > 0.0 and i > 0 else 0.0
        before = b * v[i] + more[i]
        last = 0.0 if i > 0 else now / share
    ratio = min(step * share / max(b * c, 1e-300), 1e9)
    if ratio < 1e-9:
        return last
    decay, slope = math.exp(-ratio), (now - before) / ratio
    return float((decay * (last * share - before + slope) + now - slope) / share)


@kernel
def _linear(
    x: Vector, v: Vector, k: float, b: float, c: float, dt: float, more: Vector, clamped: bool,
    out: Vector,
) -> None:  # fmt: skip
    last = 0.0
    for i in range(x.size):
        f = 0.0
        if touches(x[i]):
            f = _linear_in_series(x, v, i, k, b, c, dt, more, last)
        out[i] = last = max(f, 0.0) if clamped else f


@kernel
def _implicit(
    x: Vector, v: Vector, material: Any, joint: Any, dt: float, more: Vector, spring: float,
    clamped: bool, out: Matrix,
) -> None:  # fmt: skip
    k, n, b, q = material
    c, seated = joint
    last = rise = 0.0
    for i in range(x.size):
        if not touches(x[i]):
            last = rise = 0.0
            continue
        bent = joint_deflection(last, c, seated)
        if n == 1.0 and q == 0.0:
            rigid = (k + spring) * x[i] + b * (v[i] + bent / dt) + more[i]
            f = force_behind_joint(rigid, c * (k + spring + b / dt), seated)
        else:
            f = _newton(x[i], v[i], last + rise, bent, material, joint, dt, more[i], spring)
        pulls = clamped and f <= 0.0
        f = 0.0 if pulls else f
        p = x[i] - joint_deflection(f, c, seated)
        if out.shape[0] > 1 and not pulls and p != 0.0:  # a rigid body does not give way
            # By the implicit function theorem, from the derivatives a sample before.
            w = v[i] - (x[i] - p - bent) / dt
            own = spring_force(p, 1.0, n)
            unit = own if q == n else p**q
            by_p = (n * k * own + q * b * unit * w) / p + spring
            whole = 1.0 + _bending(f, c, seated) * (by_p + b * unit / dt)
            memory = b * unit * _bending(last, c, seated) / dt
            for row, by_it in ((1, own), (2, unit * w)):
                before = out[row, i - 1] if i > 0 else 0.0
                out[row, i] = (by_it + memory * before) / whole
        out[0, i] = f
        rise, last = f - last, f


@kernel
def _bending(force: float, compliance: float, seated: float) -> float:
    """Return the slope of the joint's deflection by the force."""
    slope: float = compliance / (1.0 + abs(force) / seated) ** 2
    return slope


@kernel
def _newton(
    x: float, v: float, guess: float, bent: float, material: Any, joint: Any, dt: float,
    more: float, beside: float,
) -> float:  # fmt: skip
    """Return the force behind a joint that was `bent` a sample before [x]."""
    k, n, b, q = material
    c, seated = joint
    most = math.inf if c * seated <= x else 0.999 * x / (c - x / seated)
    f = guess
    for _ in range(_MOST_STEPS):
        f = min(f, most)
        p = x - joint_deflection(f, c, seated)
        w = v - (x - p - bent) / dt
        spring = spring_force(p, k, n)
        damper = b * (spring / k) if q == n else damping_at(p, b, q)  # one power, not two
        value = spring + damper * w + beside * p + more
        by_p = (n * spring + q * damper * w) / p + damper / dt + beside
        slope = -_bending(f, c, seated) * by_p
        step = (value - f) / (1.0 - min(slope, 0.0))
        f += step
        if abs(step) < _NEARLY * (1.0 + abs(f)):
            break
    return min(f, most)
