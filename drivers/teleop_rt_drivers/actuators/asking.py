"""The port of a drive that is asked where it is as a cycle begins, and commanded as it ends.

The answer to a command has the place of a cycle ago; only the answer to the question is
handed on as a sample. Both may look alike, so each answer belongs to the oldest frame without one.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisFault
from teleop_rt_drivers.actuators.port import ActuatorPort

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt_drivers.actuators.codec import AskedCodec, Frames
    from teleop_rt_drivers.actuators.wire import Wire

MOST_FRAMES_OWED = 16
"""Frames without an answer that are remembered; the longest set-up of a drive has five."""


class AskingPort(ActuatorPort):
    """Speaks a codec as its base does; `drain` asks, and waits for the answer for `answer_ns`.

    A cycle without that answer has no sample, and an answer after its time is none. Where one is
    still missing as a cycle begins, nothing is asked for that cycle: an answer until its end
    belongs to an earlier question, and a later one is lost.
    """

    def __init__(
        self,
        codec: AskedCodec,
        wire: Wire,
        counters: dict[str, int],
        now_ns: Callable[[], int],
        state_timeout_ns: int,
        watchdog_ns: int | None,
        answer_ns: int,
    ) -> None:
        super().__init__(codec, wire, counters, now_ns, state_timeout_ns, watchdog_ns, codec)
        self._question = (codec.question(),)
        self._answer_ns = answer_ns
        self._owed: deque[tuple[bool, int]] = deque(maxlen=MOST_FRAMES_OWED)
        self._asks_now = self._waiting = False
        self._paused = False

    def drain(self, now_ns: int) -> None:
        """Take all that has arrived; then ask where the drive is, and wait for its answer."""
        super().drain(now_ns)
        if self._owed and not self._paused:
            self._paused = True
            return
        self._owed.clear()
        self._paused = False
        if self.wire.fault is not AxisFault.NONE:
            return
        self._asks_now = self._waiting = True
        self._order(self._question)
        self._asks_now = False
        last_ns = -1
        while self._waiting:
            at_ns = self._now_ns()
            super().drain(at_ns)
            # A clock that stands still while we wait is a simulated one: nothing more will come.
            if at_ns - now_ns > self._answer_ns or at_ns == last_ns:
                self._waiting = False
            last_ns = at_ns

    def _order(self, frames: Frames) -> None:
        at_ns = self._now_ns()
        self._owed.extend([(self._asks_now, at_ns)] * len(frames))
        super()._order(frames)

    def _deliver(self, now_ns: int) -> None:
        """Hand the answer to a question on; that to a command changes the state alone."""
        asked, sent_ns = self._owed.popleft() if self._owed else (False, now_ns)
        self._state_ns = self._measured_ns(sent_ns)
        if asked:
            self._answer(self._state_ns)

    def _place(self) -> None:
        """Hand a position on: answers owed for older frames will not come."""
        while self._owed:
            asked, sent_ns = self._owed.popleft()
            if asked:
                self._answer(self._measured_ns(sent_ns))
                return

    def _answer(self, measured_ns: int) -> None:
        """Hand the answer to a question on, unless its time is over."""
        if self._waiting:
            self._waiting = False
            self._hand_on(measured_ns)
        else:
            self._counters["answered_late"] += 1
