"""The `axis` sections of framed devices: serial ports by format, a CAN bus by DBC."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from teleop_rt.config.rig import AxisConfig
from teleop_rt.config.section import Section
from teleop_rt.config.supervision import LONGEST_WATCH_MS, UnsafeWord
from teleop_rt_drivers.bus import WATCHED_SHARE, BusConfig, stamp_deviation_s
from teleop_rt_drivers.framed.checksum import ChecksumKind
from teleop_rt_drivers.framed.drive_config import ForceDriveConfig, FramedDriveConfig
from teleop_rt_drivers.framed.format import HexBytes
from teleop_rt_drivers.framed.signal_config import (
    ForceSignal,
    PositionSignal,
    SignalConfig,
    SwitchSignal,
)


class FramedPart(AxisConfig):
    """Common keys of serial and raw CAN."""

    position: PositionSignal | None = Field(
        None,
        description="Where the measured position comes from; null where another part gives it.",
    )
    force: ForceSignal | None = Field(
        None, description="Where the measured force comes from; null where another part gives it."
    )
    drive: FramedDriveConfig | None = Field(
        None,
        description=(
            "The drive: where commands go and answers come from; null where another part drives."
        ),
    )
    switch: SwitchSignal | None = Field(
        None, description="Where the home switch is read; null where there is none."
    )
    answer_timeout_ms: int = Field(
        1000,
        ge=1,
        le=60_000,
        description="Time at start-up in which every device must have sent a good frame.",
    )

    @property
    def signals(self) -> dict[str, SignalConfig]:
        """Return position and force, those that there are."""
        named: dict[str, SignalConfig | None] = {"position": self.position, "force": self.force}
        return {name: signal for name, signal in named.items() if signal is not None}

    @property
    def sample_rate_hz(self) -> float | None:
        """Declared rate of the slowest of position and force; None where none is declared."""
        rates = [s.rate_hz for s in self.signals.values() if s.rate_hz is not None]
        return min(rates, default=None)

    @property
    def paired(self) -> bool:
        """Whether position and force come in different frames."""
        position, force = self.position, self.force
        return position is not None and force is not None and position.source != force.source

    def arrival_deviation_s(self, period_s: float) -> float:
        """Return the standard deviation of an arrival's stamp [s]."""
        return WATCHED_SHARE * period_s

    def stamp_deviation_s(self, period_s: float) -> float:
        """Return that of the time between a position's stamp and a force's [s]."""
        return math.sqrt(2.0) * self.arrival_deviation_s(period_s) if self.paired else 0.0

    @model_validator(mode="after")
    def _some(self) -> FramedPart:
        if not self.signals and self.drive is None:
            raise ValueError("name at least one of position, force and drive")
        return self

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return the safeguards that the drive lacks: none of these protocols carries both."""
        lacks: dict[UnsafeWord, str] = {}
        drive = self.drive
        if drive is None:
            return lacks
        if drive.watchdog_ms is None or drive.watchdog_ms > LONGEST_WATCH_MS:
            lacks["watchdog"] = (
                f"drive.watchdog_ms is null or above {LONGEST_WATCH_MS}: so long the drive goes on"
                " without the daemon"
            )
        if isinstance(drive, ForceDriveConfig):
            lacks["position_comparison"] = (
                "the drive measures no position of its own: nothing is compared with the encoder"
            )
            return lacks
        lacks["force_comparison"] = (
            "the drive measures no force of its own: nothing is compared with the force sensor"
        )
        place = None if self.position is None else (self.position.source, self.position.field)
        if place == (drive.answer, drive.actual):
            lacks["position_comparison"] = (
                "position is the drive's own actual value: no second encoder is compared with it"
            )
        return lacks


class SerialPortConfig(Section):
    """One serial port."""

    device: str = Field(
        min_length=1,
        description="Device of the port: a name below folder such as ttyUSB0, or a whole path.",
    )
    baud: int = Field(
        ge=300, le=4_000_000, description="Bits per second of the line, such as 921600."
    )
    format: str = Field(
        description=(
            "Frames that the device sends: a path to a frame format, or the name of one of this "
            "package's."
        )
    )
    command_format: str | None = Field(
        None, description="Frames that the device is sent, of the binary kind; needed by a drive."
    )
    start: HexBytes = Field(
        "",
        description=(
            'Bytes to send once when the port is opened, as hexadecimal text such as "43 AA".'
        ),
    )
    request: HexBytes = Field(
        "",
        description=(
            "Bytes to send every cycle to a device that waits to be asked, as hexadecimal text."
        ),
    )


class SerialPart(FramedPart):
    """Devices on serial ports."""

    driver: Literal["serial"] = Field(description="Devices on serial ports.")
    folder: str = Field("/dev", description="Folder of the ports' devices; /dev on hardware.")
    ports: dict[str, SerialPortConfig] = Field(
        min_length=1,
        description=(
            "The serial ports, by a name of your choice that position, force, drive and switch "
            "refer to."
        ),
    )

    def path(self, port: str) -> str:
        """Return the path of a port's device."""
        device = self.ports[port].device
        return device if device.startswith("/") else f"{self.folder}/{device}"

    @model_validator(mode="after")
    def _sources(self) -> SerialPart:
        used = [signal.source for signal in self.signals.values()]
        used += [self.switch.source] if self.switch else []
        used += [self.drive.command, self.drive.answer] if self.drive else []
        for name in used:
            if name not in self.ports:
                raise ValueError(f"{name!r} is not one of the ports: {', '.join(self.ports)}")
        if self.drive and self.ports[self.drive.command].command_format is None:
            raise ValueError(f"ports.{self.drive.command} needs command_format for the drive")
        return self


class SerialConfig(SerialPart):
    """A whole axis on serial ports."""

    position: PositionSignal = Field(description="Where the measured position comes from.")
    force: ForceSignal = Field(description="Where the measured force comes from.")
    drive: FramedDriveConfig = Field(
        description="The drive: where commands go and answers come from."
    )


class SerialDeviceConfig(SerialPart):
    """An operator's device on serial ports: its position, and a drive that takes forces."""

    driver: Literal["serial_device"] = Field(description="An operator's device on serial ports.")  # type: ignore[assignment]  # distinguishes it from a whole axis
    position: PositionSignal = Field(description="Where the measured position comes from.")
    force: None = Field(None, description="Always null: an operator's device measures no force.")
    drive: ForceDriveConfig = Field(description="The drive, which takes forces.")


class MessageChecksum(Section):
    """A signal of 8 bits that holds a checksum over the frame's other bytes."""

    signal: str = Field(description="Signal of 8 bits that holds the checksum.")
    kind: ChecksumKind = Field(
        "crc8",
        description=(
            "Kind of checksum over the frame's other bytes, by the name that data sheets use."
        ),
    )


class MessageChecks(Section):
    """Fields of a message against loss and corruption."""

    counter: str | None = Field(
        None,
        description=(
            "Signal that counts up by one each frame; a frame that does not is counted as lost or "
            "repeated."
        ),
    )
    checksum: MessageChecksum | None = Field(
        None, description="Checksum of the message; a frame whose checksum is wrong is rejected."
    )


class RawCanPart(FramedPart):
    """Devices on a CAN bus whose messages a DBC file describes."""

    driver: Literal["raw_can"] = Field(
        description="Devices on a CAN bus whose messages a DBC file describes."
    )
    bus: BusConfig = Field(description="The CAN bus that the devices are on.")

    def arrival_deviation_s(self, period_s: float) -> float:
        """Return the standard deviation of an arrival's stamp [s]."""
        return stamp_deviation_s(self.bus, period_s)

    dbc: str = Field(
        min_length=1,
        description=(
            "File that describes the messages: a path, or a file of this package's dbc folder."
        ),
    )
    messages: dict[str, MessageChecks] = Field(
        {},
        description=(
            "Counters and checksums that messages carry, by the message's name in the DBC."
        ),
    )


class RawCanConfig(RawCanPart):
    """A whole axis on a CAN bus whose messages a DBC file describes."""

    position: PositionSignal = Field(description="Where the measured position comes from.")
    force: ForceSignal = Field(description="Where the measured force comes from.")
    drive: FramedDriveConfig = Field(
        description="The drive: where commands go and answers come from."
    )
