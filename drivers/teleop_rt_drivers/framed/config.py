"""The `axis` sections of framed devices: serial ports by format, a CAN bus by DBC."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config_rig import AxisConfig
from teleop_rt.section import Force, Position, Quantity, Section
from teleop_rt_drivers.bus import BusConfig
from teleop_rt_drivers.framed.checksum import ChecksumKind
from teleop_rt_drivers.framed.format import HexBytes
from teleop_rt_drivers.quantity import DriveZero

Sign = Literal[1, -1]


class StatusConfig(Section):
    """A field that tells whether the frame can be believed."""

    field: str
    good: int = Field(0, description="the value of a good frame; any other rejects it")


class ClockConfig(Section):
    """A field in which the device tells its own time."""

    field: str
    tick_s: float = Field(gt=0, le=1)
    bits: int = Field(32, ge=8, le=64)


class SignalConfig(Section):
    """A measured value: which field of which source (a serial port, a CAN message)."""

    source: str
    field: str
    sign: Sign = 1
    status: StatusConfig | None = None
    clock: ClockConfig | None = None
    timeout_ms: int = Field(60, ge=2, le=60_000, description="silence that means a lost device")


class PositionSignal(SignalConfig):
    """The position."""

    scale: Annotated[float | None, Quantity("{x}_per_unit"), Field(gt=0)] = None
    offset: Position = 0.0


class ForceSignal(SignalConfig):
    """The force."""

    scale: Annotated[float | None, Quantity("{f}_per_unit"), Field(gt=0)] = None
    offset: Force = 0.0


class SwitchSignal(Section):
    """A home switch: bits of a whole number in some frame."""

    source: str
    field: str
    mask: int = Field(1, ge=1, description="closed where any of these bits is set")
    inverted: bool = False


class ControlWords(Section):
    """What to write into the drive's control field."""

    off: int = 0
    follow: int = 1
    stop: int = 2


class DriveStates(Section):
    """What the drive's state field says."""

    following: int = 1
    stopping: int = 2
    fault: int = 3


class FramedDriveConfig(Section):
    """A drive that takes positions: two frames, and which field is what."""

    command: str = Field(description="source (serial port, CAN message) of the commands")
    target: str = "target"
    control: str = "control"
    answer: str = Field(description="source of the answers")
    actual: str = "actual"
    state: str = "state"
    scale: Annotated[float | None, Quantity("{x}_per_unit"), Field(gt=0)] = None
    sign: Sign = 1
    offset: Position = 0.0
    zero: DriveZero = "encoder"
    controls: ControlWords = ControlWords()
    states: DriveStates = DriveStates()
    timeout_ms: int = Field(60, ge=2, le=60_000)


class ForceDriveConfig(FramedDriveConfig):
    """A drive that takes forces: target and actual are forces, 0 until it is told to follow."""

    scale: Annotated[float | None, Quantity("{f}_per_unit"), Field(gt=0)] = None
    offset: Force = 0.0
    zero: Literal["encoder"] = "encoder"


class FramedPart(AxisConfig):
    """What serial and raw CAN have in common."""

    position: PositionSignal | None = None
    force: ForceSignal | None = None
    drive: FramedDriveConfig | None = None
    switch: SwitchSignal | None = None
    answer_timeout_ms: int = Field(1000, ge=1, le=60_000)

    @property
    def signals(self) -> dict[str, SignalConfig]:
        """Return position and force, those that there are."""
        named: dict[str, SignalConfig | None] = {"position": self.position, "force": self.force}
        return {name: signal for name, signal in named.items() if signal is not None}

    @model_validator(mode="after")
    def _some(self) -> FramedPart:
        if not self.signals and self.drive is None:
            raise ValueError("name at least one of position, force and drive")
        return self


class SerialPortConfig(Section):
    """One serial port."""

    device: str = Field(min_length=1, description="ttyUSB0; below `folder`, or a whole path")
    baud: int = Field(ge=300, le=4_000_000)
    format: str = Field(description="what it sends: a path, or one of this package's formats")
    command_format: str | None = Field(None, description="what it is sent")
    start: HexBytes = Field("", description="sent once when the port is opened")
    request: HexBytes = Field("", description="sent every cycle, for devices that wait to be asked")


class SerialPart(FramedPart):
    """Devices on serial ports."""

    driver: Literal["serial"]
    folder: str = "/dev"
    ports: dict[str, SerialPortConfig] = Field(min_length=1)

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
                raise ValueError(f"{name!r} is none of the ports: {', '.join(self.ports)}")
        if self.drive and self.ports[self.drive.command].command_format is None:
            raise ValueError(f"ports.{self.drive.command} needs command_format for the drive")
        return self


class SerialConfig(SerialPart):
    """A whole axis on serial ports."""

    position: PositionSignal
    force: ForceSignal
    drive: FramedDriveConfig


class SerialDeviceConfig(SerialPart):
    """An operator's device on serial ports: its position, and a drive that takes forces."""

    driver: Literal["serial_device"]  # type: ignore[assignment]  # tells it from a whole axis
    position: PositionSignal
    force: None = None
    drive: ForceDriveConfig


class MessageChecksum(Section):
    """A signal of 8 bits that holds a checksum over the frame's other bytes."""

    signal: str
    kind: ChecksumKind = "crc8"


class MessageChecks(Section):
    """What a message carries against loss and corruption."""

    counter: str | None = None
    checksum: MessageChecksum | None = None


class RawCanPart(FramedPart):
    """Devices on a CAN bus whose messages a DBC file describes."""

    driver: Literal["raw_can"]
    bus: BusConfig
    dbc: str = Field(min_length=1, description="a path, or a file of this package's dbc folder")
    messages: dict[str, MessageChecks] = Field(
        {}, description="counter and checksum of messages, by name"
    )


class RawCanConfig(RawCanPart):
    """A whole axis on a CAN bus whose messages a DBC file describes."""

    position: PositionSignal
    force: ForceSignal
    drive: FramedDriveConfig
