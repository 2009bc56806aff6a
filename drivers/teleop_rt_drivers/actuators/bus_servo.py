"""The frames that the codecs of servos on a shared line have in common."""

from __future__ import annotations

from teleop_rt_drivers.actuators.codec import Frame, Frames


class BusServoCodec:
    """A servo whose goal and torque are written without an answer: each cycle ends with a question.

    A derived class makes `_on`, `_off` and `_ask`, and the frame of a goal.
    """

    _on: Frame
    _off: Frame
    _ask: Frame

    def _goal(self, position: float) -> Frame:
        """Return the frame of a goal [turns]."""
        raise NotImplementedError

    def enable(self, position: float) -> Frames:
        """Return a goal where the shaft is, torque, and the question."""
        return self._goal(position), self._on, self._ask

    def disable(self) -> Frames:
        """Return no torque, and the question."""
        return self._off, self._ask

    def follow(self, position: float, velocity: float) -> Frames:  # noqa: ARG002 - it takes none
        """Return a goal, and the question."""
        return self._goal(position), self._ask
