"""The slave as a daemon: its loop obeys commands, feeds the watchdog and counts its own times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from teleop_rt.axis import AxisError, EndOfRecording
from teleop_rt.realtime.clock import Clock
from teleop_rt.realtime.histogram import TimingHistograms
from teleop_rt.realtime.loop import run_loop
from teleop_rt.realtime.ring_folder import LAST_FAULT
from teleop_rt.realtime.state_file import leave
from teleop_rt.service.mailbox import Command, CommandBox, Reply
from teleop_rt.service.notify import Notifier
from teleop_rt.service.status import PROBLEM
from teleop_rt.slave.faults import INTERNAL, NO_FAULT, State
from teleop_rt.slave.slave import Slave

_SETTLING_TICKS = 50
"""Ticks of stop commands after the end was asked for."""


class Daemon:
    """Runs the slave's cycle until it is asked to end, or to begin again with another config."""

    def __init__(
        self,
        slave: Slave,
        ring_folder: Path,
        notifier: Notifier,
        histograms: TimingHistograms,
        *,
        arm_at_once: bool = False,
    ) -> None:
        """Make the mailbox; `arm_at_once` arms and starts as soon as a sample came."""
        self._slave = slave
        self._ring_folder = ring_folder
        self.notifier = notifier
        self._histograms = histograms
        self._box = CommandBox(ring_folder, create=True)
        self.arm_at_once = arm_at_once
        self._leave_for = Command.NONE
        self._left = slave.stopped

    def run(self, new_clock: Callable[[], Clock], should_stop: Callable[[], bool]) -> bool:
        """Serve until `should_stop()`; true where the config is to be loaded again.

        Whatever is raised, the last thing that the axis hears is stop, and it is raised again.
        """
        slave = self._slave
        try:
            self.serve(new_clock, should_stop)
            slave.disarm()
            settled = slave.tick + _SETTLING_TICKS
            run_loop(new_clock(), slave.cycle, lambda: slave.tick >= settled)
        except EndOfRecording:
            slave.disarm()
        except BaseException:
            slave.stop(INTERNAL)
            raise
        finally:
            slave.close()
        return self._leave_for is Command.RELOAD

    def serve(self, new_clock: Callable[[], Clock], should_stop: Callable[[], bool]) -> None:
        """Run the loop; between two loops, with a clock of their own, devices are reset."""

        def leave() -> bool:
            return should_stop() or self._leave_for is not Command.NONE

        while not leave():
            run_loop(new_clock(), self.cycle, leave)
            if self._leave_for is Command.RESET:
                self.notifier.standing(reloading=False)
                self._box.answer(self._reset())
                self._leave_for = Command.NONE
                self.notifier.going()

    def cycle(self, skipped: int, wake_latency_ns: int) -> None:
        """Run one tick, execute a pending command, and feed the watchdog; stop comes first."""
        if self._box.stop_asked():
            self._stop()
        self._slave.cycle(skipped, wake_latency_ns)
        self._note_fault()
        self._histograms.add(wake_latency_ns * 1e-3, self._slave.work_us)
        if self.arm_at_once:
            self.arm_at_once = not self._slave.arm()
        command = self._box.poll()
        if command is not Command.NONE:
            self._obey(command)
        self.notifier.tick()

    def _note_fault(self) -> None:
        """Leave a new fault for status and log; nothing moves any more by then."""
        now = self._slave.stopped
        if now is self._left:
            return
        self._left = now
        if now.fault is not NO_FAULT:
            last = {"stamp_ns": now.stamp_ns, "fault": now.fault.name, "said": now.said}
            last |= {"traceback": now.traceback} if now.traceback else {}
            leave(self._ring_folder / LAST_FAULT, last)

    def _stop(self) -> None:
        self.arm_at_once = False
        self._slave.disarm()
        self._box.stopped()

    def _obey(self, command: Command) -> None:
        """Carry a command out; reset is answered after the devices are configured again."""
        reply = self._reply_to(command)
        if reply is Reply.DONE and command in {Command.RESET, Command.RELOAD}:
            self._leave_for = command
        if reply is not Reply.DONE or command is not Command.RESET:
            self._box.answer(reply)

    def _reply_to(self, command: Command) -> Reply:
        safety = self._slave.safety
        faulty = safety.state in {State.SAFE_STOP, State.FAULT}
        if command is Command.RESET:
            return Reply.DONE if self._slave.resettable else Reply.NO_FAULT
        if command is Command.RELOAD:
            return Reply.POWERED if safety.powered else Reply.DONE
        if faulty:
            return Reply.FAULT_LATCHED
        if command is Command.ARM:
            return self._arm()
        return Reply.DONE if safety.start() else Reply.NOT_ARMED

    def _arm(self) -> Reply:
        if self._slave.safety.powered:
            return Reply.NOT_DISARMED
        try:
            return Reply.DONE if self._slave.arm(start=False) else Reply.NO_SAMPLE
        except AxisError as error:
            self._publish(error)
            return Reply.AXIS_REFUSED

    def _reset(self) -> Reply:
        try:
            self._slave.reset()
        except AxisError as error:
            self._publish(error)
            return Reply.AXIS_REFUSED
        return Reply.DONE

    def _publish(self, error: AxisError) -> None:
        (self._ring_folder / PROBLEM).write_text(str(error), encoding="utf-8")
