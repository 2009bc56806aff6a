"""A drive that takes position and control value in a frame, and reports state and position."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

from teleop_rt.axis import sample_place
from teleop_rt_drivers.drive_intent import ARMING, IDLE, POWERING, RUNNING, STOPPED
from teleop_rt_drivers.framed.written_frame import new_aim
from teleop_rt_drivers.quantity import Scale

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt.axis import Sample
    from teleop_rt_drivers.framed.drive_config import FramedDriveConfig
    from teleop_rt_drivers.framed.source import FramedPort, Source, Values
    from teleop_rt_drivers.framed.written_frame import AimFields

_ENABLED, _POSITION = sample_place("enabled"), sample_place("drive_position")
_HAS_POSITION, _HAS_FORCE = map(sample_place, ("has_drive_position", "has_drive_force"))


class FramedDrive:
    """Asks the drive to follow, and finds out when it does not.

    Until it follows, the commanded position is the actual one, so that enabling never jumps. A
    drive that stops following by itself is not asked to follow again. `settle` finds out whether
    it is `enabled`, following by a recent report of its own, and whether it is `silent`, for longer
    than its timeout.
    """

    _as_sent: Callable[[Scale, float], float] = staticmethod(Scale.counts)
    """How the command carries a target [rig unit]."""

    def __init__(
        self,
        config: FramedDriveConfig,
        port: FramedPort,
        answer: Source,
        scale: tuple[Scale, Scale],
        counters: dict[str, int],
    ) -> None:
        self.intent = IDLE
        self.fell_out = False
        self.known = False
        self.enabled = self.silent = False
        self.name = answer.name
        self.lost = f"drive ({answer.name}): silent for more than {config.timeout_ms} ms"
        self._config = config
        self._command = config.command
        self._states, self._controls = config.states, config.controls
        self._port = port
        self._target_scale, self._actual_scale = scale
        self._counters = counters
        fields = port.commands[config.command]
        self._fields = [0.0] * len(fields.fields)
        self._control_slot = fields.slot(config.control)
        self._target_slot = fields.slot(config.target)
        self._state_slot = answer.slot(config.state)
        self._actual_slot = answer.slot(config.actual)
        self._timeout_ns = config.timeout_ms * 1_000_000
        self._state = -1
        self._actual = 0.0
        self._target = 0.0
        self._aligned = True
        self._heard_ns = 0
        self._aims = new_aim()
        self._bind_sender()
        answer.listen(self._take)

    def _bind_sender(self) -> None:
        """Let the port send a target in one step, if it can, by the present scale."""
        self._send_target = self._port.target_sender(self._aims)
        aim, scale = cast("AimFields", self._aims[0]), self._target_scale
        aim.target_slot, aim.control_slot = self._target_slot, self._control_slot
        aim.follow = self._controls.follow
        aim.per_count, aim.sign, aim.offset = scale.per_count, scale.sign, scale.offset

    def _take(self, values: Values, now_ns: int) -> None:
        actual = self._actual_scale.value(values[self._actual_slot])
        state = values[self._state_slot]
        if not (math.isfinite(actual) and math.isfinite(state)):
            self._counters["not_a_number"] += 1
            return
        self._state = int(state)
        self._actual = actual
        self._heard_ns = now_ns
        self.known = True

    @property
    def faulty(self) -> bool:
        """Return whether the drive reports a fault."""
        return self._state == self._states.fault

    def reset(self, now_ns: int) -> None:
        """Begin again without power."""
        self.intent = IDLE
        self.fell_out = self.known = False
        self._state = -1
        self._heard_ns = now_ns

    def begin(self, now_ns: int) -> None:
        """Begin to watch: the drive has its whole timeout from now."""
        self._heard_ns = max(self._heard_ns, now_ns)

    def arm(self) -> None:
        """Begin to ask the drive to follow."""
        self.fell_out = False
        self.intent = ARMING
        self._aligned = self._config.zero == "encoder"

    def settle(self, now_ns: int) -> bool:
        """Advance the intent by this cycle's frames; return whether anything is wrong."""
        following = self._state == self._states.following
        if self.intent is ARMING and following:
            self.intent = RUNNING
        elif self.intent is RUNNING and not following:
            self.intent = STOPPED
            self.fell_out = True
        self.silent = silent = now_ns - self._heard_ns > self._timeout_ns
        self.enabled = self.intent is RUNNING and not silent
        return silent or self.fell_out or self._state == self._states.fault

    def fill(self, sample: Sample) -> None:
        """Write the drive's report: its state, and the position that it measures [rig unit]."""
        counts = sample.counts  # without a call for each number
        counts[_ENABLED], counts[_HAS_POSITION], counts[_HAS_FORCE] = self.enabled, True, False
        sample.floats[_POSITION] = self._actual

    def command(self, position: float) -> None:
        """Send the command for a position [rig unit]; one that is no number repeats the last."""
        if self.intent is not RUNNING:
            self._target = self._at_rest()
            self._send(self._control())
            return
        if math.isfinite(position):
            if not self._aligned:
                self._align(position)
            self._target = position
        else:
            self._counters["bad_command"] += 1
        send = self._send_target
        if send is None or not send(self._target):
            self._send(self._controls.follow)

    def _align(self, position: float) -> None:
        """Take the position as that where the drive stands."""
        self._aligned = True
        moved = position - self._actual
        self._target_scale = self._target_scale.moved(moved)
        self._aims["offset"] = self._target_scale.offset
        self._actual_scale = self._actual_scale.moved(moved)
        self._actual = position

    def stop(self) -> None:
        """Stop at once, and ask for nothing else from now on."""
        self.intent = STOPPED
        self._target = self._at_rest()
        self._send(self._control())

    def _at_rest(self) -> float:
        """Return the target of a drive that is not to move: where it is."""
        return self._actual

    def _control(self) -> int:
        """Return the control value for the present intent and state."""
        controls, states = self._controls, self._states
        if self.intent in POWERING:
            return controls.follow
        moving = self._state in (states.following, states.stopping)
        return controls.stop if self.intent is STOPPED and moving else controls.off

    @property
    def complaint(self) -> str:
        """The drive's own description of its fault, in words; empty if it gives none."""
        return ""

    def _send(self, control: int) -> None:
        self._fields[self._control_slot] = control
        self._fields[self._target_slot] = self._as_sent(self._target_scale, self._target)
        self._port.send(self._command, self._fields)


class ForceDrive(FramedDrive):
    """A drive that takes forces: zero until it follows, and zero for not-a-number."""

    def fill(self, sample: Sample) -> None:
        """Write the drive's report: its state, and the force that it pushes with [rig unit]."""
        sample.enabled = self.enabled
        sample.drive_position, sample.drive_force = None, self._actual

    def push(self, force: float) -> None:
        """Send the command for a force [rig unit]."""
        if not math.isfinite(force):
            self._counters["bad_command"] += 1
            force = 0.0
        self.command(force)

    def _at_rest(self) -> float:
        """Return no force."""
        return 0.0
