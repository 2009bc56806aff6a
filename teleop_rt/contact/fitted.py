"""Effects with fitted parameters, and the slopes that a renderer needs of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.errors import ExpectedError

_PROBE = 1e-3
"""A small displacement, as a share of the depth, for numerical slopes."""
_REST_STEPS = 20
"""Steps at one depth after which a state counts as at rest; `_REST_S` [s] is each."""
_REST_S = 1e-3  # a sample of the slave at 1 kHz


class ExtendedModelError(ExpectedError):
    """A model with effects cannot be used; the message names the key and the expected value."""


@dataclass(frozen=True)
class FittedEffect:
    """An effect with the amplitude and the shape parameters that diagnosis found.

    Of a term `in_quadrature` the amplitude is the whole effect's, and `share` is this term's part.
    """

    effect: Effect
    amplitude: float
    eta: Vector
    share: float = 1.0


def code_of(effect: Effect) -> int:
    """Return the number by which the link names an effect: of its name and law, 32 bits."""
    return crc32(f"{effect.name}|{effect.law}".encode())


def fitted_effect(
    place: str, name: str, law: str, parameters: Mapping[str, object], library: Sequence[Effect]
) -> FittedEffect:
    """Return an effect of the library with these parameters; raises ExtendedModelError.

    `place` says where they are written.
    """
    known = [e for e in library if e.name == name and e.law == law]
    if not known:
        laws = [e.law for e in library if e.name == name]
        names = ", ".join(dict.fromkeys(e.name for e in library))
        hint = f"take one of its laws: {', '.join(laws)}" if laws else f"take one of: {names}"
        raise ExtendedModelError(f"{place}: effects: no effect {name!r} of law {law!r}; {hint}")
    effect = known[0]
    wanted = [shape.name for shape in effect.shapes]
    if not effect.amplitude.unity:
        wanted.append(effect.amplitude.name)
    numbers = {
        key: float(value)
        for key in wanted
        if isinstance(value := parameters.get(key), float | int) and np.isfinite(value)
    }
    lacking = [key for key in wanted if key not in numbers]
    if lacking:
        raise ExtendedModelError(
            f"{place}: effects: {name}: give a number for {', '.join(lacking)}"
        )
    amplitude = 1.0 if effect.amplitude.unity else numbers[effect.amplitude.name]
    eta = np.array([numbers[shape.name] for shape in effect.shapes] or [0.0])
    return FittedEffect(effect, amplitude, eta)


def in_quadrature(fitted: FittedEffect) -> tuple[FittedEffect, ...]:
    """Return the linear terms of an additive effect: two, at phases 0 and pi/2, if it has one.

    A phase cannot be reused in another run, where clock or surface may differ; two linear
    amplitudes estimate it again. A phase in time is unknown beforehand: the shares are 0.
    """
    effect = fitted.effect
    places = [j for j, shape in enumerate(effect.shapes) if shape.phase]
    if not places:
        return (fitted,)
    phase = float(fitted.eta[places[0]])
    known = 0.0 if effect.stage == "sensor" else 1.0
    amplitude = replace(effect.amplitude, nonnegative=False)
    terms = []
    for suffix, angle, part in (("sine", 0.0, np.cos(phase)), ("cosine", np.pi / 2, np.sin(phase))):
        eta = fitted.eta.copy()
        eta[places[0]] = angle
        term = replace(effect, name=f"{effect.name}_{suffix}", amplitude=amplitude)
        terms.append(FittedEffect(term, fitted.amplitude, eta, known * float(part)))
    return tuple(terms)


def at_rest(effect: Effect, eta: Vector, depth: float) -> float:
    """Return an effect's value per unit amplitude at a depth, at rest, for one without memory.

    0 for an effect with memory or of time: its force does not depend on the depth alone.
    """
    if effect.state_size:
        return 0.0
    return effect.step(np.zeros(1), depth, 0.0, 0.0, 0.0, _REST_S, eta)


def slopes(effect: Effect, eta: Vector, depth: float, speed: float) -> tuple[float, float]:
    """Return the largest of |df/dx| and |df/dv| per unit amplitude at a depth, up to a speed.

    The internal springs of an effect with memory count as stiffness: its response to a quick and
    small displacement.
    """
    kick = _PROBE * depth
    if effect.state_size:
        state = np.zeros(effect.state_size)
        value = 0.0
        for _ in range(_REST_STEPS):
            value = effect.step(state, depth, 0.0, 0.0, 1.0, _REST_S, eta)
        rates = []
        for sign in (1.0, -1.0):
            moved = effect.step(
                state.copy(), depth + sign * kick, sign * kick / 1e-6, 0.0, 1.0, 1e-6, eta
            )
            rates.append(abs(moved - value) / kick)
        return max(rates), 0.0
    none = np.zeros(1)

    def value_at(x: float, v: float) -> float:
        return effect.step(none, x, v, 0.0, 1.0, _REST_S, eta)

    stiffness = damping = 0.0
    for v in (-speed, 0.0, speed):
        change = value_at(depth + kick, v) - value_at(depth - kick, v)
        stiffness = max(stiffness, abs(change) / (2.0 * kick))
        by_speed = value_at(depth, v + _PROBE * speed) - value_at(depth, v - _PROBE * speed)
        damping = max(damping, abs(by_speed) / (2.0 * _PROBE * speed))
    return stiffness, damping
