"""How a drive on a serial line, and the adapter before it, are set: asked, and compared."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.actuators import dynamixel, feetech
from teleop_rt_drivers.actuators.line_config import DynamixelPart, FeetechPart
from teleop_rt_drivers.actuators.wire import LineWire
from teleop_rt_drivers.bus_load import line_turn_s
from teleop_rt_drivers.findings import Finding
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.registry import parts_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.actuators.codec import Frame
    from teleop_rt_drivers.framed.stream import ByteStream

ADAPTERS = Path("/sys/bus/usb-serial/devices")
"""Where Linux shows the latency timers of FTDI chips."""
ASKED_AGAIN, WAIT_S = 3, 0.05
"""Times that a question is repeated, and the wait for each answer [s]."""
DELAY_STEP_US = 2.0
"""Unit of both makers' return delay."""
WATCHDOG_FIRMWARE = 38
"""First firmware of a Dynamixel that has the bus watchdog."""
MULTI_TURN, STEPS_PER_S = 0x10, 0x04
"""Bits of a Feetech's phase byte."""


def survey_lines(
    rig: RigConfig,
    open_line: Callable[[str, int], ByteStream],
    now_ns: Callable[[], int],
    adapters: Path = ADAPTERS,
) -> list[Finding]:
    """Return how the rig's drives on serial lines and their adapters are set."""
    findings = []
    for part in parts_of(rig.axis).values():
        if isinstance(part, DynamixelPart | FeetechPart):
            findings.append(latency_timer(part.path, part.usb_latency_ms, adapters))
            asking = _Asking(part, rig, partial(open_line, part.path, part.baud), now_ns)
            try:
                findings += asking.findings()
            except AxisError as error:
                step = "check power, wiring, baud rate and servo_id"
                findings.append(Finding("error", str(error), "drive", step))
            finally:
                asking.close()
    return findings


def latency_timer(path: str, declared_ms: float, adapters: Path) -> Finding:
    """Compare the adapter's latency timer with the rig's value; other chips have none."""
    where, file = "drive, adapter", adapters / Path(path).resolve().name / "latency_timer"
    try:
        found_ms = float(file.read_text())
    except (OSError, ValueError):
        what = f"the adapter shows no latency timer; {declared_ms:g} ms are counted on"
        return Finding("ok", what, where)
    what = f"the adapter keeps bytes back for {found_ms:g} ms, usb_latency_ms is {declared_ms:g}"
    if found_ms > declared_ms:
        step = f"`echo {max(1, int(declared_ms))} > {file}`, or the udev rule of config/udev"
        return Finding("error", what, where, step)
    return Finding("ok", what, where)


class _Asking:
    """Asks a drive for registers, one after another."""

    def __init__(
        self,
        part: DynamixelPart | FeetechPart,
        rig: RigConfig,
        open_stream: Callable[[], ByteStream],
        now_ns: Callable[[], int],
    ) -> None:
        self._part = part
        self._rig = rig
        self._codec = part.codec(rig)
        self._now_ns = now_ns
        self._content = b""
        turn_ns = round(1e9 * line_turn_s(part, rig))
        self._wire = LineWire(self._codec, open_stream, FramedCounters(), turn_ns)

    def close(self) -> None:
        """Release the line."""
        self._wire.close()

    def _hear(self, frame: Frame, _: int) -> None:
        self._content = self._codec.registers(frame) or self._content

    def _read(self, register: int, size: int) -> int:
        """Return a register. Raises AxisError where the drive does not answer."""
        self._content = b""
        for _ in range(ASKED_AGAIN):
            self._wire.settle()
            self._wire.order((self._codec.read(register, size),), self._now_ns())
            self._wire.wait(WAIT_S)
            self._wire.drain(self._now_ns())
            if len(self._content) == 1 + size:
                return int.from_bytes(self._content[1:], "little")
        raise AxisError(
            f"servo {self._part.servo_id} on {self._part.path} does not answer"
            ": check power, wiring, id and baud rate"
        )

    def findings(self) -> list[Finding]:
        """Return the drive's report of itself. Raises AxisError."""
        self._wire.open(self._hear)
        if isinstance(self._part, DynamixelPart):
            return self._dynamixel(self._part)
        return self._feetech()

    def _return_delay(self, register: int) -> Finding:
        delay_us, declared_us = DELAY_STEP_US * self._read(register, 1), self._part.return_delay_us
        what = f"the drive answers after {delay_us:g} us, return_delay_us is {declared_us:g}"
        if delay_us > declared_us:
            step = "set its Return Delay Time to 0 with the maker's tool, or say so in the rig"
            return Finding("error", what, "drive, return delay", step)
        return Finding("ok", what, "drive, return delay")

    def _dynamixel(self, part: DynamixelPart) -> list[Finding]:
        model, firmware = self._read(dynamixel.MODEL, 2), self._read(dynamixel.FIRMWARE, 1)
        what = f"Dynamixel model {model}, firmware {firmware}"
        old = firmware < WATCHDOG_FIRMWARE
        step = "update it with Dynamixel Wizard: firmware 38 brought the bus watchdog"
        findings = [Finding("error" if old else "ok", what, "drive", step if old else "")]
        findings.append(self._return_delay(dynamixel.RETURN_DELAY))
        limits = part.codec(self._rig)
        for name, register, size, asked in (
            ("Velocity Limit", dynamixel.VELOCITY_LIMIT, 4, limits.fastest),
            ("Current Limit", dynamixel.CURRENT_LIMIT, 2, limits.current),
        ):
            found, where = self._read(register, size), f"drive, {name}"
            what = f"its {name} is {found}, the rig asks for {asked}"
            if found < asked:
                step = f"raise it with Dynamixel Wizard, or lower the rig's: {asked} is refused"
                findings.append(Finding("error", what, where, step))
            else:
                findings.append(Finding("ok", what, where))
        return findings

    def _feetech(self) -> list[Finding]:
        findings = [self._return_delay(feetech.RETURN_DELAY)]
        mode, phase = self._read(feetech.OPERATING_MODE, 1), self._read(feetech.PHASE, 1)
        limits = self._read(feetech.ANGLE_LIMITS, 4)
        turns = bool(phase & MULTI_TURN) and limits == 0
        what = f"Feetech in mode {mode}, {'several turns' if turns else 'one turn'}"
        what += ", speeds in steps/s" if phase & STEPS_PER_S else ", speeds in 0.732 rpm"
        if mode == 0 and turns and phase & STEPS_PER_S:
            return [*findings, Finding("ok", what, "drive")]
        step = "with Feetech's tool set mode 0, both angle limits 0, and bits 2 and 4 of the phase"
        return [*findings, Finding("error", what, "drive", step)]
