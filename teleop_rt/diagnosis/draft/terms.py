"""The terms of which a law is drafted: each an expression that NumPy and a kernel read alike.

An expression holds scaled quantities only: `s` penetration (or position about the middle of its
range), `r` distance from the surface on either side, `u` velocity, `w` acceleration, `p` time over
the recording's length, `g` the base model's force; and memories that a kernel advances sample by
sample: `q` the stretch of a Maxwell arm, `z` Dahl's friction, `y` the force as a first-order lag
passes it on, `d` the deepest penetration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from teleop_rt.contact.effect import Family, Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.models.base import Base
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.simulate import first_order
from teleop_rt.kernels.jit import kernel

Group = Literal["position", "velocity", "acceleration", "past", "time", "force"]
GROUPS: tuple[Group, ...] = ("position", "velocity", "acceleration", "past", "time", "force")
BEYOND = 1.3  # of the range seen: further out a law stays as it is there, whatever it would do
# Of a past, as a record of seconds can show it: time constants [s], yield travels [of the range].
TIMES_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
TRAVELS = (0.005, 0.02, 0.06, 0.2)


@dataclass(frozen=True)
class Memory:
    """A state that a kernel advances: its parameter's name, unit and grid, and the statement."""

    parameter: str
    unit: str
    grid: tuple[float, ...]
    update: str


MEMORIES = {
    "q": Memory("relaxation_time", "s", TIMES_S, "q = (q + ds) * exp(-dt / {0})"),
    "z": Memory(
        "yield_travel", "1", TRAVELS,
        "z += (sign(ds) - z) * (1.0 - exp(-abs(ds) / {0}))",
    ),
    "y": Memory("lag", "s", TIMES_S[:4], "y += (g - y) * (1.0 - exp(-dt / {0}))"),
    "d": Memory("", "", (), "d = max(d, s)"),
}  # fmt: skip


@dataclass(frozen=True)
class Term:
    """One term: the quantity, its expression, and the value of its memory's parameter."""

    group: Group
    family: Family
    expression: str
    words: str
    memory: str = ""
    value: float = 0.0


@dataclass(frozen=True)
class Scaling:
    """How a motion becomes the quantities of expressions; all in the rig's units and s.

    `k`, `b` and `force` make g of penetration and velocity. `touches`: s counts from the surface.
    """

    middle: float
    travel: float
    speed: float
    acceleration: float
    duration: float
    k: float
    b: float
    force: float
    touches: bool

    @classmethod
    def of(cls, problem: Problem, fit: Fit) -> Scaling:
        """Return the scaling of a recording and its fitted base."""
        motion, base = problem.motion, fit.model.base
        x = motion.x + fit.model.shift(fit.zeta)
        linear = dict(zip((t.name for t in base.terms), fit.theta.tolist(), strict=False))
        middle = 0.0 if base.touches else 0.5 * float(np.max(x) + np.min(x))
        travel = float(np.max(x)) if base.touches else 0.5 * float(np.ptp(x))
        return cls(
            middle,
            travel,
            motion.scales["speed"],
            max(float(np.quantile(np.abs(motion.a), 0.99)), 1e-12),
            float(motion.t[-1]),
            linear.get("k", 0.0) * (travel ** (fit.zeta[0] - 1.0) if base.has_power else 1.0),
            0.0 if base.has_power else linear.get("b", linear.get("c", 0.0)),
            motion.scales["force"],
            base.touches,
        )


def candidates(base: Base) -> list[Term]:
    """Return the terms that a law of this base may hold, memories at each value of their grid."""
    found = [*_POSITION, *_VELOCITY, *_TIME, *_ACCELERATION, *_FORCE]
    found += _IN_CONTACT if base.touches else _WITHOUT
    for term in _PAST + (_DEEPEST if base.touches else []):
        grid = MEMORIES[term.memory].grid or (0.0,)
        found += [replace(term, value=value) for value in grid]
    return found


def quantities(problem: Problem, fit: Fit, scaling: Scaling) -> dict[str, Vector]:
    """Return s, r, u, w, p and g at every sample, and the step `ds` of s."""
    motion = problem.motion
    x = motion.x + fit.model.shift(fit.zeta)
    s = np.clip((x - scaling.middle) / scaling.travel, 0.0 if scaling.touches else -BEYOND, BEYOND)
    inside = touches(x) | (not scaling.touches)
    return {
        "s": s,
        "r": np.minimum(np.abs(x - scaling.middle) / scaling.travel, BEYOND),
        "u": np.clip(motion.v / scaling.speed, -BEYOND, BEYOND),
        "w": np.clip(motion.a / scaling.acceleration, -BEYOND, BEYOND),
        "p": np.clip(motion.t / scaling.duration, 0.0, BEYOND),
        "g": np.where(inside, (scaling.k * (x - scaling.middle) + scaling.b * motion.v), 0.0)
        / scaling.force,
        "ds": np.where(inside, motion.v * motion.dt / scaling.travel, 0.0),
    }


def row_of(term: Term, known: Mapping[str, Vector], dt: float) -> Vector:
    """Return a term's value at every sample."""
    names: dict[str, object] = {"exp": np.exp, "tanh": np.tanh, "abs": np.abs, **known}
    if term.memory:
        names[term.memory] = _remembered(term, known, dt)
    value = eval(term.expression, {"__builtins__": {}}, names)  # noqa: S307 - our own table
    return np.asarray(value, dtype=np.float64) * np.ones_like(known["s"])


def _remembered(term: Term, known: Mapping[str, Vector], dt: float) -> Vector:
    """Return a memory at every sample, as its statement in MEMORIES advances it."""
    if term.memory == "d":
        return np.asarray(np.maximum.accumulate(np.maximum(known["s"], 0.0)), dtype=np.float64)
    if term.memory == "z":
        found = np.empty_like(known["ds"])
        _dahl(known["ds"], term.value, found)
        return found
    kept = float(np.exp(-dt / term.value))
    ahead, row = (kept, "ds") if term.memory == "q" else (1.0 - kept, "g")
    return first_order(known[row], kept, ahead, 0.0)


@kernel
def _dahl(steps: Vector, travel: float, out: Vector) -> None:
    state = 0.0
    for i in range(steps.size):
        sign = (steps[i] > 0.0) - (steps[i] < 0.0)
        state += (sign - state) * (1.0 - np.exp(-abs(steps[i]) / travel))
        out[i] = state


def _hinge(of: str, at: float) -> str:
    return f"0.5 * ({of} - {at:g} + abs({of} - {at:g}))"


_POSITION = [
    Term("position", "bias", "1.0", "a constant"),
    Term("position", "stiffening", "s", "the position"),
    Term("position", "stiffening", "s * s", "the square of the position"),
    Term("position", "stiffening", "s * s * s", "the cube of the position"),
]
_IN_CONTACT = [
    *(Term("position", "stiffening", _hinge("s", at), f"the depth beyond {at:g} of the largest")
      for at in (0.15, 0.3, 0.45, 0.6, 0.75)),
    *(Term("position", "adhesion", f"exp(-r / {w:g})", "the neighbourhood of the surface")
      for w in (0.02, 0.08)),
    *(Term("velocity", "adhesion", f"(1.0 - tanh(u / 0.05)) * exp(-r / {w:g})",
           "withdrawal near the surface") for w in (0.02, 0.08)),
    # An adhesive bridge pulls the tool back in free air until it breaks, and not on the way in.
    *(Term("velocity", "adhesion",
           f"(1.0 - tanh(u / 0.05)) * (1.0 - tanh(s / 0.002)) * exp(-r / {w:g})",
           "withdrawal beyond the surface") for w in (0.01, 0.03, 0.09)),
]  # fmt: skip
_WITHOUT = [Term("position", "stiffening", "abs(s)", "the distance from the middle")]
_VELOCITY = [
    Term("velocity", "damping", "u", "the velocity"),
    *(Term("velocity", "friction", f"tanh(u / {w:g})", "the direction") for w in (0.01, 0.05, 0.2)),
    Term("velocity", "damping", "u * abs(u)", "the square of the velocity"),
    Term("velocity", "damping", _hinge("u", 0.0), "the velocity forwards"),
    Term("velocity", "damping", "s * u", "position times velocity"),
    Term("velocity", "damping", "s * u * abs(u)", "position times the square of the velocity"),
    *(Term("velocity", "friction", f"s * tanh(u / {w:g})", "position times direction")
      for w in (0.01, 0.05, 0.2)),
]  # fmt: skip
_TIME = [
    Term("time", "drift", "p", "the time"),
    Term("time", "drift", "p * p", "the square of the time"),
    *(Term("time", "drift", f"1.0 - exp(-p / {q:g})", "a time that settles")
      for q in (0.05, 0.15, 0.4)),
    *(Term("time", "drift", f"s * (1.0 - exp(-p / {q:g}))", "position times a time that settles")
      for q in (0.05, 0.15, 0.4)),
    Term("time", "drift", "s * p", "position times time"),
]  # fmt: skip
_ACCELERATION = [
    Term("acceleration", "inertia", "w", "the acceleration"),
    Term("acceleration", "inertia", "s * w", "position times acceleration"),
]
_FORCE = [
    *(Term("force", "saturation", _hinge("g", at), f"the force beyond {at:g} of its peak")
      for at in (0.4, 0.6, 0.8)),
    Term("force", "stiffening", "g * abs(g)", "the square of the force"),
]  # fmt: skip
_PAST = [
    Term("past", "relaxation", "q", "a stretch that relaxes", "q"),
    Term("past", "relaxation", "s * q", "position times a stretch that relaxes", "q"),
    Term("past", "hysteresis", "z", "the way since the last reversal", "z"),
    Term("past", "hysteresis", "s * z", "position times the way since the last reversal", "z"),
    Term("past", "delay", "y - g", "the lag of the force", "y"),
]
_DEEPEST = [
    Term("past", "hysteresis", "d", "the deepest penetration", "d"),
    Term("past", "hysteresis", "s * d", "position times the deepest penetration", "d"),
    Term("past", "hysteresis", "s * (d - s)", "how far the position is from its deepest", "d"),
    Term("past", "hysteresis", "s * s * (d - s)", "the same, times the position", "d"),
]
