"""Additive effects: their declared step functions, compiled into one call per tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numba
import numpy as np

from teleop_rt.contact.effect import Effect, Vector

TermsFunction = Callable[[float, float, float, float, float, Vector, Vector, Vector], None]


class Terms:
    """The values of additive effects at the amplitude `scales`, advanced tick by tick.

    `values` (effects,) is written in place; `scales` (effects,) is 1 unless given. `shapes`
    overrides the effects' start values of their shape parameters: effect name -> values in the
    order of declaration. Raises ValueError for a wrong number of them.
    """

    def __init__(
        self,
        effects: Sequence[Effect],
        shapes: Mapping[str, Sequence[float]],
        values: Vector,
        scales: Sequence[float] = (),
    ) -> None:
        etas = []
        for effect in effects:
            eta = list(shapes.get(effect.name, [shape.start for shape in effect.shapes]))
            if len(eta) != len(effect.shapes):
                wanted = ", ".join(shape.name for shape in effect.shapes)
                raise ValueError(f"effect {effect.name!r} has the shape parameters: {wanted}")
            etas.append(eta)
        self.effects = tuple(effects)
        self.values = values
        self._eta: Vector = np.array([value for eta in etas for value in eta], dtype=np.float64)
        self._state: Vector = np.zeros(sum(effect.state_size for effect in effects))
        self._step = _compile(self.effects, tuple(scales) or (1.0,) * len(effects))

    def reset(self) -> None:
        """Forget the effects' memory."""
        self._state[:] = 0.0
        self.values[:] = 0.0

    def advance(self, x: float, v: float, a: float, t: float, dt: float) -> None:
        """Advance all effects by dt [s] to penetration x, velocity v, acceleration a, time t."""
        self._step(x, v, a, t, dt, self._state, self._eta, self.values)


def _compile(effects: tuple[Effect, ...], scales: tuple[float, ...]) -> TermsFunction:
    """Chain the step functions of the effects, each times its scale, into one compiled function.

    Chained closures, because a kernel cannot loop over functions of different types. They are not
    cached: numba's cache cannot distinguish them.
    """

    @numba.njit(error_model="numpy")
    def nothing(
        x: float, v: float, a: float, t: float, dt: float, state: Vector, eta: Vector, out: Vector
    ) -> None:
        """Do nothing: the end of the chain."""

    chain: TermsFunction = nothing
    state_at = eta_at = 0
    for index, (effect, scale) in enumerate(zip(effects, scales, strict=True)):
        slots = (state_at, state_at + effect.state_size, eta_at, eta_at + len(effect.shapes))
        chain = _link(chain, effect.step, scale, index, slots)
        state_at, eta_at = slots[1], slots[3]
    return chain


def _link(
    before: TermsFunction, step: object, scale: float, index: int, slots: tuple[int, int, int, int]
) -> TermsFunction:
    """Return a compiled function that calls `before` and then applies one more effect."""
    s0, s1, e0, e1 = slots

    @numba.njit(error_model="numpy")
    def link(
        x: float, v: float, a: float, t: float, dt: float, state: Vector, eta: Vector, out: Vector
    ) -> None:
        before(x, v, a, t, dt, state, eta, out)
        value = step(state[s0:s1], x, v, a, t, dt, eta[e0:e1])  # type: ignore[operator]
        out[index] = scale * value if np.isfinite(value) else 0.0

    compiled: TermsFunction = link
    return compiled
