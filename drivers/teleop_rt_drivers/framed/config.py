"""The `axis` sections of framed devices: serial ports by format, a CAN bus by DBC."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config_rig import AxisConfig
from teleop_rt.config_supervision import LONGEST_WATCH_MS, UnsafeWord
from teleop_rt.section import Force, Position, Quantity, Section
from teleop_rt_drivers.bus import BusConfig
from teleop_rt_drivers.framed.checksum import ChecksumKind
from teleop_rt_drivers.framed.format import HexBytes
from teleop_rt_drivers.quantity import DriveZero

Sign = Literal[1, -1]


class StatusConfig(Section):
    """A field that tells whether the frame can be believed."""

    field: str = Field(description="Field of the frame that holds the status.")
    good: int = Field(
        0,
        description=(
            "Value of a good frame; a measured value that comes with any other is rejected."
        ),
    )


class ClockConfig(Section):
    """A field in which the device tells its own time."""

    field: str = Field(
        description="Field of the frame in which the device tells its own time, as a count."
    )
    tick_s: float = Field(
        gt=0, le=1, description="Duration of one count: 1e-6 for a stamp in microseconds."
    )
    bits: int = Field(32, ge=8, le=64, description="Bits after which the count wraps around.")


class SignalConfig(Section):
    """A measured value: which field of which source (a serial port, a CAN message)."""

    source: str = Field(
        description=(
            "Where the value comes from: a port's name (serial) or a message's name (CAN)."
        )
    )
    field: str = Field(
        description="Field of the frame, or signal of the message, that holds the value."
    )
    sign: Sign = Field(
        1,
        description=(
            "1 where the device's numbers rise towards the environment (or when the tool presses),"
            " else -1."
        ),
    )
    status: StatusConfig | None = Field(
        None,
        description=(
            "Field that says whether the frame is good; null trusts every frame that passes its "
            "checks."
        ),
    )
    clock: ClockConfig | None = Field(
        None,
        description=(
            "Field with the device's own time; a count that stands still is a frozen device. Null "
            "stamps on arrival."
        ),
    )
    timeout_ms: int = Field(
        60, ge=2, le=60_000, description="Silence after which the device counts as lost."
    )


class PositionSignal(SignalConfig):
    """The position."""

    scale: Annotated[float | None, Quantity("{x}_per_unit"), Field(gt=0)] = Field(
        None,
        description=(
            "Rig units of position per unit of the field; needed where the field's unit is not the"
            " rig's."
        ),
    )
    offset: Position = Field(0.0, description="Position at the field's 0.")


class ForceSignal(SignalConfig):
    """The force."""

    scale: Annotated[float | None, Quantity("{f}_per_unit"), Field(gt=0)] = Field(
        None,
        description=(
            "Rig units of force per unit of the field; needed where the field's unit is not the "
            "rig's."
        ),
    )
    offset: Force = Field(0.0, description="Force at the field's 0.")


class SwitchSignal(Section):
    """A home switch: bits of a whole number in some frame."""

    source: str = Field(
        description=(
            "Where the switch comes from: a port's name (serial) or a message's name (CAN)."
        )
    )
    field: str = Field(description="Field that holds the bits of the switch, a whole number.")
    mask: int = Field(
        1, ge=1, description="Bits of the switch; it is closed where any of them is set."
    )
    inverted: bool = Field(
        default=False, description="Whether set bits mean an open switch instead."
    )


class ControlWords(Section):
    """What to write into the drive's control field."""

    off: int = Field(0, description="Value that takes power away from the drive.")
    follow: int = Field(1, description="Value that makes the drive follow its target.")
    stop: int = Field(2, description="Value that makes the drive come to rest under power.")


class DriveStates(Section):
    """What the drive's state field says."""

    following: int = Field(
        1, description="Value by which the drive says that it follows its target."
    )
    stopping: int = Field(2, description="Value by which the drive says that it comes to rest.")
    fault: int = Field(3, description="Value by which the drive reports a fault.")


class FramedDriveConfig(Section):
    """A drive that takes positions: two frames, and which field is what."""

    command: str = Field(
        description="Where commands go: a port's name (serial) or a message's name (CAN)."
    )
    target: str = Field("target", description="Field of the command that takes the target.")
    control: str = Field(
        "control", description="Field of the command that takes the control value."
    )
    answer: str = Field(
        description="Where answers come from: a port's name (serial) or a message's name (CAN)."
    )
    actual: str = Field("actual", description="Field of the answer with the actual value.")
    state: str = Field("state", description="Field of the answer with the drive's state.")
    scale: Annotated[float | None, Quantity("{x}_per_unit"), Field(gt=0)] = Field(
        None,
        description=(
            "Rig units of position per unit of target and actual; needed where their unit is not "
            "the rig's."
        ),
    )
    sign: Sign = Field(
        1, description="1 where the drive's numbers rise towards the environment, else -1."
    )
    offset: Position = Field(0.0, description="Position at the drive's 0.")
    zero: DriveZero = Field(
        "encoder",
        description=(
            "Where the drive counts from: as the encoder does (encoder), or from anywhere "
            "(unknown), then it is aligned with the encoder when power comes on."
        ),
    )
    controls: ControlWords = Field(ControlWords(), description="Values of the control field.")
    states: DriveStates = Field(DriveStates(), description="Values of the state field.")
    timeout_ms: int = Field(
        60,
        ge=2,
        le=60_000,
        description="Silence of the drive's answers after which it counts as lost.",
    )
    watchdog_ms: int | None = Field(
        None,
        ge=1,
        le=60_000,
        description=(
            "Silence of commands after which the drive stops by itself, as its manual says; "
            "null where that is not known."
        ),
    )


class ForceDriveConfig(FramedDriveConfig):
    """A drive that takes forces: target and actual are forces, 0 until it is told to follow."""

    scale: Annotated[float | None, Quantity("{f}_per_unit"), Field(gt=0)] = Field(
        None,
        description=(
            "Rig units of force per unit of target and actual; needed where their unit is not the "
            "rig's."
        ),
    )
    offset: Force = Field(0.0, description="Force at the drive's 0.")
    zero: Literal["encoder"] = Field(
        "encoder", description="Always encoder: a force has no place that could be unknown."
    )


class FramedPart(AxisConfig):
    """What serial and raw CAN have in common."""

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

    @model_validator(mode="after")
    def _some(self) -> FramedPart:
        if not self.signals and self.drive is None:
            raise ValueError("name at least one of position, force and drive")
        return self

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return the safeguards that the drive lacks: none of these protocols carries a force."""
        lacks: dict[UnsafeWord, str] = {}
        drive = self.drive
        if drive is None or isinstance(drive, ForceDriveConfig):
            return lacks
        if drive.watchdog_ms is None or drive.watchdog_ms > LONGEST_WATCH_MS:
            lacks["watchdog"] = (
                f"drive.watchdog_ms is null or above {LONGEST_WATCH_MS}: so long the drive goes on"
                " without the daemon"
            )
        lacks["force_comparison"] = (
            "the drive measures no force of its own: nothing is compared with the force sensor"
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
                raise ValueError(f"{name!r} is none of the ports: {', '.join(self.ports)}")
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

    driver: Literal["serial_device"] = Field(description="An operator's device on serial ports.")  # type: ignore[assignment]  # tells it from a whole axis
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
    """What a message carries against loss and corruption."""

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
