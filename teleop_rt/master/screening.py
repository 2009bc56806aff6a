"""Which streamed models are fit to be rendered; the others are refused and counted."""

from __future__ import annotations

from dataclasses import replace

from teleop_rt.link.messages import Model

EXPONENT_MIN, EXPONENT_MAX = 1.0, 5.0
JUMP_MAX = 100.0
INSISTENCE = 10
"""A jump that this many models in a row confirm is a new environment, not a wild estimate."""


class Screening:
    """Refuses wild parameters: negative stiffness, impossible exponents, jumps.

    Stiffness is compared as the force at `reference_depth` [rig unit], which makes models of
    different kinds comparable. A negative damping, which no passive contact has, is rendered
    as 0 and counted: an estimate may well scatter around 0.
    """

    def __init__(self, reference_depth: float) -> None:
        self._reference_depth = reference_depth
        self.reset()

    def reset(self) -> None:
        """Forget the models and the counts."""
        self._accepted = self._doubtful = 0.0
        self._insisted = 0
        self.refused: dict[str, int] = {}
        self.clamped = 0

    def check(self, model: Model) -> Model | None:
        """Return the model as it may be rendered, or None where it is refused."""
        reason = self._fault(model)
        if reason:
            self.refused[reason] = self.refused.get(reason, 0) + 1
            return None
        if model.b >= 0:
            return model
        self.clamped += 1
        return replace(model, b=0.0)

    def _fault(self, model: Model) -> str | None:
        if model.k < 0:
            return "negative stiffness"
        is_hunt_crossley = model.model == "hunt-crossley"
        if is_hunt_crossley and not EXPONENT_MIN <= model.n <= EXPONENT_MAX:
            return "exponent"
        if is_hunt_crossley and not model.surface_known:
            return "no surface"
        force = model.k * self._reference_depth ** (model.n if is_hunt_crossley else 1.0)
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
