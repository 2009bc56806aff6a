"""The axis on devices that send frames of their own accord, or when they are asked or commanded."""

from __future__ import annotations

import contextlib
import functools
import math
from typing import TYPE_CHECKING

from teleop_rt.axis import NO_AXIS_FAULT, AxisError, AxisFault, Sample, Timing
from teleop_rt.kernels.jit import bound
from teleop_rt_drivers.framed.config import SerialDeviceConfig
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.framed.drive import ForceDrive, FramedDrive
from teleop_rt_drivers.framed.drive_config import ForceDriveConfig
from teleop_rt_drivers.framed.first_frames import nothing_good
from teleop_rt_drivers.framed.quiet import quiet_lines
from teleop_rt_drivers.framed.signal import MeasuredSignal, Switch
from teleop_rt_drivers.framed.stream import keep_arrivals
from teleop_rt_drivers.framed.taking import (
    FORCE_SHIFT,
    SILENT,
    TOO_OLD,
    UNUSUAL,
    new_values,
    settle_cycle,
)
from teleop_rt_drivers.quantity import plausible_force, plausible_position
from teleop_rt_drivers.transport import serial_transport, timing_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.drivetrain import Drivetrain
    from teleop_rt_drivers.framed.config import FramedPart
    from teleop_rt_drivers.framed.drive_config import FramedDriveConfig
    from teleop_rt_drivers.framed.quiet import QuietLines
    from teleop_rt_drivers.framed.source import FramedPort, Source
    from teleop_rt_drivers.framed.stream import Watched


POLL_S = 0.001
"""Longest wait at one port for first answers, before the next: short beside their time-out."""


class FramedAxis:
    """Position, force and drive, as far as the config names them, on ports that the axis closes.

    `counters` contains the rejected frames by reason. A fault stays until `configure` is called
    again. `drive` is one with its own protocol, if there is one, and `timing` its latency as an
    operator's device. A `drivetrain` removes friction and inertia of the motor from the force.
    """

    def __init__(
        self,
        config: FramedPart,
        rig: RigConfig,
        ports: Mapping[str, FramedPort],
        now_ns: Callable[[], int],
        counters: FramedCounters | None = None,
        drive: FramedDrive | None = None,
        timing: Timing | None = None,
    ) -> None:
        self.counters = FramedCounters() if counters is None else counters
        self._config = config
        self._rig = rig
        self._now_ns = now_ns
        self._ports = tuple(ports.values())
        self._position = self._make_position(ports)
        self._force = self._make_force(ports)
        self._timing = timing
        self._drive = drive
        if drive is None and config.drive is not None:
            self._drive = self._make_drive(config.drive, ports)
        self._switch = None
        if (switch := config.switch) is not None:
            self._switch = Switch(switch, _source(ports, switch.source))
        self._signals = [s for s in (self._position, self._force) if s is not None]
        self.drivetrain: Drivetrain | None = None
        self._fault = NO_AXIS_FAULT
        self._complaint = ""
        self._found = 0
        self._bind(Sample())
        self._configured = False
        self._watching = False
        self._lines: QuietLines | None = None

    def _make_position(self, ports: Mapping[str, FramedPort]) -> MeasuredSignal | None:
        if (config := self._config.position) is None:
            return None
        source, unit = _source(ports, config.source), self._rig.units.position
        key = f"position.scale_{unit}_per_unit"
        scale = source.scale(config.field, unit, config.scale, config.sign, config.offset, key)
        bounds, held_ms = plausible_position(self._rig), config.held_ms(self._rig.rate_hz)
        name = f"position from {source.name}"
        return MeasuredSignal(name, config, source, scale, bounds, self.counters, held_ms)

    def _make_force(self, ports: Mapping[str, FramedPort]) -> MeasuredSignal | None:
        if (config := self._config.force) is None:
            return None
        source, unit = _source(ports, config.source), self._rig.units.force
        key = f"force.scale_{unit}_per_unit"
        scale = source.scale(config.field, unit, config.scale, config.sign, config.offset, key)
        bounds, held_ms = plausible_force(self._rig), config.held_ms(self._rig.rate_hz)
        name = f"force from {source.name}"
        return MeasuredSignal(name, config, source, scale, bounds, self.counters, held_ms)

    def _make_drive(
        self, config: FramedDriveConfig, ports: Mapping[str, FramedPort]
    ) -> FramedDrive:
        port, answer = _port_that_sends(ports, config.command), _source(ports, config.answer)
        by_force = isinstance(config, ForceDriveConfig)
        unit = self._rig.units.force if by_force else self._rig.units.position
        key = f"drive.scale_{unit}_per_unit"
        scales = [
            source.scale(field, unit, config.scale, config.sign, config.offset, key)
            for source, field in (
                (port.commands[config.command], config.target),
                (answer, config.actual),
            )
        ]
        kind = ForceDrive if by_force else FramedDrive
        return kind(config, port, answer, (scales[0], scales[1]), self.counters)

    @property
    def timing(self) -> Timing:
        """Return the part of a device's latency by lines, frames and drive, at worst."""
        if self._timing is not None:
            return self._timing
        if not isinstance(self._config, SerialDeviceConfig):
            raise AxisError("only an operator's device answers with a force: name the rig of one")
        return timing_of(serial_transport(self._config, self._rig), self._rig)

    def configure(self) -> None:
        """Open the ports and wait for a good frame of every source. Raises AxisError."""
        self._configured = False
        self.listen()
        if self._drive is not None:
            self._drive.command(0.0)
        self._await_frames()
        if self._drive is not None and self._drive.faulty:
            said = f" ({self._drive.complaint})" if self._drive.complaint else ""
            raise AxisError(f"the drive reports a fault{said}: clear it by its manual")
        self._configured = True

    def listen(self) -> None:
        """Begin with frames from now on. Raises AxisError where a port cannot be opened."""
        for port in self._ports:
            port.open()
        self._fault = NO_AXIS_FAULT
        self._complaint = ""
        self._sample.missing = 0
        self._watching = False
        self._lines = quiet_lines(self._ports)
        now_ns = self._now_ns()
        for signal in self._signals:
            signal.reset(now_ns)
        if self.drivetrain is not None:
            self.drivetrain.reset()
        if self._drive is not None:
            self._drive.reset(now_ns)

    def _await_frames(self) -> None:
        """Wait until every signal and the drive are known; raises AxisError naming who is not."""
        end_ns = self._now_ns() + self._config.answer_timeout_ms * 1_000_000
        while silent := self._drain_once():
            before_ns = self._now_ns()
            for port in self._ports:
                port.wait(POLL_S)
            # A clock that stands still while we wait is a simulated one: nothing more will come.
            if self._now_ns() >= end_ns or self._now_ns() == before_ns:
                timeout_ms = self._config.answer_timeout_ms
                raise AxisError(nothing_good(silent, timeout_ms, self.counters))

    def _drain_once(self) -> list[str]:
        """Take the frames that have come; return the devices that have not been heard."""
        now_ns = self._now_ns()
        for port in self._ports:
            port.drain(now_ns)
        silent = [s.source.name for s in self._signals if not (s.settle(now_ns) or s.known)]
        if self._drive is not None and not self._drive.known:
            silent.append(self._drive.name)
        return silent

    def arm(self) -> None:
        """Ask the drive to hold its present position under power; takes effect over cycles.

        Raises AxisError before `configure`, and while a fault is latched.
        """
        if not self._configured:
            raise AxisError(
                "cannot arm: the devices are not configured; `teleop-rt reset` configures them"
            )
        if self._fault is not NO_AXIS_FAULT:
            raise AxisError(f"cannot arm: {self._fault.name}; remove the cause and configure again")
        if self._drive is not None:
            self._drive.arm()

    def read_into(self, sample: Sample) -> None:
        """Take the frames that have arrived. Never raises."""
        if sample is not self._sample:
            self._bind(sample)
        now_ns, lines, wrong = self._now_ns(), self._lines, False
        if lines is None or not lines.are_quiet(now_ns):
            for port in self._ports:
                port.drain(now_ns)
                wrong |= port.fault is not NO_AXIS_FAULT
        if not self._watching:
            self._begin(now_ns)
        closed = self._switch is not None and self._switch.closed
        found = self._settle(now_ns, closed, self.counters.rejected, self._fault)
        sample.stale = ""
        if (drive := self._drive) is not None:
            wrong |= drive.settle(now_ns)
            drive.fill(sample)
        if wrong or found & UNUSUAL:
            self._found = found
            self._correct(sample)
        if self.drivetrain is not None and self._force is not None:
            self.drivetrain.free(sample)
        sample.complaint = self._complaint

    def _correct(self, sample: Sample) -> None:
        """Write rare events into a filled sample: no new value, a jump, a fault."""
        for signal, found in self._found_of_signals():
            signal.note(found)
            if found & TOO_OLD:
                sample.stale = sample.stale or signal.too_old
        if sample.stale:
            self.counters["cycles_without_sample"] += 1
            sample.missing += 1
        self._find_faults()
        sample.rejected, sample.fault = self.counters.rejected, self._fault

    def _found_of_signals(self) -> list[tuple[MeasuredSignal, int]]:
        """Return the findings on the last cycle's values."""
        found = (self._position, self._found), (self._force, self._found >> FORCE_SHIFT)
        return [(signal, bits) for signal, bits in found if signal is not None]

    def _bind(self, sample: Sample) -> None:
        """Fill this sample from now on."""
        self._sample, signals = sample, (self._position, self._force)
        values = [new_values(1) if one is None else one.stored for one in signals]
        has = tuple(one is not None for one in signals)
        usual = *has, 0, False, 0, 0
        settle = bound(settle_cycle, (*values, sample.stored), *usual)
        self._settle = functools.partial(settle, *has)

    @property
    def watched(self) -> list[Watched]:
        """The open lines and buses, whose arrivals can be kept."""
        return [one for port in self._ports for one in port.watched]

    def watch(self, seconds: float) -> None:
        """Wait so long, and note the time of each arrival meanwhile."""
        keep_arrivals(self.watched, seconds)

    def write(self, position: float) -> None:
        """Command a position [rig unit]."""
        if self._drive is not None and self._configured:
            self._drive.command(position)

    def push(self, force: float) -> None:
        """Command a force [rig unit] in place of a position, as an operator's device does.

        Raises AxisError where the drive takes positions.
        """
        if not isinstance(self._drive, ForceDrive):
            raise AxisError("the drive takes positions: take a format that sends a force")
        if self._configured:
            most = self._rig.limits.force_max
            self._drive.push(max(-most, min(most, force)) if math.isfinite(force) else force)

    def stop(self) -> None:
        """Stop the drive at once. Never raises."""
        if self._drive is not None and self._configured:
            self._drive.stop()

    def close(self) -> None:
        """Stop the drive and release the ports."""
        self.stop()
        self._configured, self._lines = False, None
        for port in self._ports:
            with contextlib.suppress(OSError):
                port.close()

    def _begin(self, now_ns: int) -> None:
        """Begin to watch: since `configure` any time may have passed."""
        self._watching = True
        for signal in self._signals:
            signal.begin(now_ns)
        if self._drive is not None:
            self._drive.begin(now_ns)

    def _find_faults(self) -> None:
        """Latch the first fault; later ones are its consequences."""
        if self._fault is not NO_AXIS_FAULT:
            return
        for port in self._ports:
            if port.fault is not NO_AXIS_FAULT:
                self._fault = port.fault
                return
        drive = self._drive
        if drive is not None and (drive.faulty or drive.fell_out):
            self._fault, self._complaint = AxisFault.DRIVE_FAULT, drive.complaint
        elif lost := self._silent():
            self._fault, self._complaint = AxisFault.DEVICE_LOST, lost

    def _silent(self) -> str:
        """Return which device has been silent for longer than its timeout, "" for none."""
        for signal, found in self._found_of_signals():
            if found & SILENT:
                return signal.lost
        drive = self._drive
        return drive.lost if drive is not None and drive.silent else ""


def _source(ports: Mapping[str, FramedPort], name: str) -> Source:
    """Return a source by its name. Raises AxisError naming those that there are."""
    for port in ports.values():
        if name in port.sources:
            return port.sources[name]
    known = sorted({source for port in ports.values() for source in port.sources})
    raise AxisError(f"there is no source {name!r}; there are: {', '.join(known)}")


def _port_that_sends(ports: Mapping[str, FramedPort], command: str) -> FramedPort:
    """Return the port that can send a command. Raises AxisError naming the commands there are."""
    for port in ports.values():
        if command in port.commands:
            return port
    known = sorted({name for port in ports.values() for name in port.commands})
    raise AxisError(f"there is no command {command!r}; there are: {', '.join(known) or 'none'}")
