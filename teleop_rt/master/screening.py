"""Which streamed models are fit to be rendered; the others are refused and counted."""

from __future__ import annotations

from teleop_rt.contact.law import EXPONENT_LEAST, EXPONENT_MOST, spring_force
from teleop_rt.link.messages import ModelMessage, StateMessage

EXPONENT_MIN, EXPONENT_MAX = 1.0, 5.0
"""Exponents of a Hunt-Crossley model that is rendered; Hertz's sphere has 1.5.

Others, from EXPONENT_LEAST to EXPONENT_MOST, are replaced; beyond, an estimate is refused.
"""
JUMP_MAX = 100.0
"""Ratio of two models' forces beyond which the later one must be repeated to be rendered."""
NEGLIGIBLE, ENORMOUS = 1e-9, 1e12
"""Bounds in the rig's units, far outside of any wall, that keep every product finite."""
INSISTENCE = 10
"""A jump that this many models in a row confirm is a new environment, not a wild estimate."""


class Screening:
    """Refuses wild parameters and places: negative stiffness, impossible exponents, jumps.

    Stiffness is compared as the force at `reference_depth` [rig unit], which makes models of
    different kinds comparable. A negative damping, which no passive contact has, is rendered
    as 0 and counted: an estimate may well scatter around 0. No surface lies further from the
    origin than `surface_farthest`: the master's target follows it within a tick.
    """

    def __init__(
        self, reference_depth: float, farthest: float, surface_farthest: float | None = None
    ) -> None:
        self._reference_depth = reference_depth
        self._farthest = farthest
        self._surface_farthest = farthest if surface_farthest is None else surface_farthest
        self.reset()

    def reset(self) -> None:
        """Forget the models and the counts."""
        self._accepted = self._doubtful = 0.0
        self._insisted = 0
        self.refused: dict[str, int] = {}
        self.clamped = 0

    def check(self, model: ModelMessage) -> ModelMessage | None:
        """Return the model as it may be rendered, or None where it is refused."""
        bounded = self._of_bounded_exponent(model)
        reason = self._fault(bounded)
        if reason:
            self.refuse(reason)
            return None
        self.clamped += bounded is not model
        model = bounded
        k = model.k if self._reference_force(model) > NEGLIGIBLE else 0.0
        self.clamped += model.b < 0
        return model if k == model.k and model.b >= 0 else model._replace(k=k, b=max(0.0, model.b))

    def _of_bounded_exponent(self, model: ModelMessage) -> ModelMessage:
        """Return a law of Hunt and Crossley with an exponent from 1 to 5.

        Below, its slope at the surface has no bound; above, it is a surface and a stop behind it.
        The nearest that has the same force at the reference depth takes its place: refused, it
        would leave the hand on whatever wall came before, which the slave's own force contradicts.
        """
        n = min(EXPONENT_MAX, max(EXPONENT_MIN, model.n))
        possible = EXPONENT_LEAST <= model.n <= EXPONENT_MOST
        if model.model != "hunt-crossley" or n == model.n or not possible:
            return model
        factor = self._reference_depth ** (model.n - n)
        return model._replace(k=model.k * factor, b=model.b * factor, n=n)

    @property
    def refusals(self) -> int:
        """How many were refused."""
        return sum(self.refused.values())

    def refuse(self, reason: str) -> None:
        """Count a model that is refused for a reason found elsewhere."""
        self.refused[reason] = self.refused.get(reason, 0) + 1

    def accepts(self, state: StateMessage) -> bool:
        """Return whether a slave's reported position lies within `farthest` of its origin."""
        if abs(state.position) <= self._farthest:
            return True
        self.refuse("position")
        return False

    def _reference_force(self, model: ModelMessage) -> float:
        n = model.n if model.model == "hunt-crossley" else 1.0
        return spring_force(self._reference_depth, model.k, n)

    def _fault(self, model: ModelMessage) -> str | None:
        if model.k < 0:
            return "negative stiffness"
        is_hunt_crossley = model.model == "hunt-crossley"
        if is_hunt_crossley and not EXPONENT_MIN <= model.n <= EXPONENT_MAX:
            return "exponent"
        force = self._reference_force(model)
        sizes = [model.k, force, model.b, abs(model.offset), abs(model.surface)]
        sizes += [abs(value) for e in model.effects for value in (e.amplitude, *e.shape)]
        if not max(sizes) <= ENORMOUS or not abs(model.surface) <= self._surface_farthest:
            return "range"
        if not model.surface_known and (is_hunt_crossley or force <= NEGLIGIBLE):
            return "no surface" if is_hunt_crossley else "no stiffness"
        if self._accepted > 0 and not _within(force, self._accepted, JUMP_MAX):
            return None if self._is_insisted_on(force) else "jump"
        self._insisted = 0
        self._accepted = force
        return None

    def _is_insisted_on(self, force: float) -> bool:
        self._insisted = self._insisted + 1 if _within(force, self._doubtful, 2.0) else 1
        self._doubtful = force
        if self._insisted < INSISTENCE:
            return False
        self._insisted, self._accepted = 0, force
        return True


def _within(value: float, reference: float, factor: float) -> bool:
    return reference / factor <= value <= reference * factor
