"""CAN messages from a DBC file, compiled once: cantools reads the file, the loop never calls it."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt.extras import install_command
from teleop_rt_drivers.bounded_file import read_description
from teleop_rt_drivers.framed.binary import FrameCounter
from teleop_rt_drivers.framed.checksum import checksum
from teleop_rt_drivers.framed.source import FieldInfo, Source

if TYPE_CHECKING:
    from cantools.database.can import Message
    from cantools.database.can.signal import Signal as DbcSignal

    from teleop_rt_drivers.framed.config import MessageChecks
    from teleop_rt_drivers.framed.source import Values

EXTENDED = 1 << 31  # bit of an id in a DBC file: of 29 bits, not 11
_FLOATS = {16: "e", 32: "f", 64: "d"}


def load_dbc(name: str) -> dict[str, Message]:
    """Read a DBC, a path or a file of this package's dbc folder. Raises AxisError."""
    try:
        from cantools.database import load_string  # noqa: PLC0415 - an optional dependency
        from cantools.database.errors import Error  # noqa: PLC0415 - an optional dependency
    except ImportError as error:
        raise AxisError(f"raw CAN needs cantools: `{install_command('dbc')}`") from error
    path = Path(name)
    if not path.is_file():
        path = Path(str(resources.files("teleop_rt_drivers") / "dbc" / name))
    if not path.is_file():
        raise AxisError(
            f"DBC {name!r} is neither a file nor one of this package's dbc folder: check the path"
        )
    try:
        text = read_description(path, f"DBC {name!r}").decode("cp1252", "replace")
        database = load_string(text, database_format="dbc")
    except (Error, ValueError, KeyError, UnicodeDecodeError) as error:
        raise AxisError(
            f"{path}{_place(path, error)}: is no DBC: {error}: correct it, or name another file"
        ) from error
    return {message.name: message for message in database.messages}  # type: ignore[union-attr]


def _place(path: Path, error: Exception) -> str:
    """Return ":line" if the error contains it or names a signal and its message."""
    said = str(error)
    if found := re.search(r"at line (\d+)", said):
        return f":{found.group(1)}"
    found = re.search(r"signals? (\w+).* in message (\w+)", said)
    if found is None:
        return ""
    inside = False
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        if words := re.match(r"\s*BO_ +\d+ +(\w+)", line):
            inside = words.group(1) == found.group(2)
        elif inside and re.match(rf"\s*SG_ +{found.group(1)}\b", line):
            return f":{number}"
    return ""


@dataclass(frozen=True, slots=True)
class BitField:
    """Position of a signal's bits in the frame, read as one big- or little-endian number."""

    little: bool
    shift: int
    mask: int
    sign_bit: int
    bits: int
    floating: str

    @classmethod
    def of(cls, signal: DbcSignal, length: int) -> BitField:
        """Return the place of a signal in a frame of `length` bytes."""
        little = signal.byte_order == "little_endian"
        if little:
            shift = signal.start
        else:
            first = 8 * (signal.start // 8) + 7 - signal.start % 8
            shift = 8 * length - first - signal.length
        floating = _FLOATS[signal.length] if signal.is_float else ""
        sign_bit = 1 << signal.length - 1 if signal.is_signed and not floating else 0
        return cls(little, shift, (1 << signal.length) - 1, sign_bit, signal.length, floating)

    def read(self, little: int, big: int) -> float:
        """Return the raw value in a frame that was read as a number of either order."""
        raw = ((little if self.little else big) >> self.shift) & self.mask
        if self.floating:
            value: float = struct.unpack(f">{self.floating}", raw.to_bytes(self.bits // 8, "big"))[
                0
            ]
            return value
        return raw - ((raw & self.sign_bit) << 1)

    def bits_of(self, value: float) -> int:
        """Return the bits of a raw value, rounded and kept within the signal's range."""
        if self.floating:
            packed = struct.pack(f">{self.floating}", value)
            return int.from_bytes(packed, "big") << self.shift
        low, high = (-self.sign_bit, self.sign_bit - 1) if self.sign_bit else (0, self.mask)
        return (round(min(max(value, low), high)) & self.mask) << self.shift


class DbcMessage:
    """One message of the DBC: bytes to raw values and back, with counter and checksum."""

    def __init__(
        self, message: Message, checks: MessageChecks | None, counters: dict[str, int]
    ) -> None:
        self.key = message.frame_id | (EXTENDED if message.is_extended_frame else 0)
        self._length = message.length
        self._counters = counters
        if message.is_multiplexed():
            raise AxisError(
                f"message {message.name} is multiplexed, which is not supported"
                ": name one that is not"
            )
        signals = {signal.name: signal for signal in message.signals}
        self.source = Source(
            message.name,
            tuple(
                FieldInfo(name, signal.unit or "1", float(signal.scale), float(signal.offset))
                for name, signal in signals.items()
            ),
        )
        self._fields = [BitField.of(signal, message.length) for signal in message.signals]
        self._counter: FrameCounter | None = None
        self._counter_slot = self._count = 0
        self._counter_modulo = 1
        self._checksum_byte = -1
        if checks is not None:
            self._add_checks(checks, signals)

    def _add_checks(self, checks: MessageChecks, signals: dict[str, DbcSignal]) -> None:
        """Compile counter and checksum. Raises AxisError naming a signal that cannot be one."""
        if checks.counter is not None:
            self._counter_slot = self.source.slot(checks.counter)
            self._counter_modulo = 1 << signals[checks.counter].length
            self._counter = FrameCounter(self._counter_slot, self._counter_modulo, self._counters)
        if checks.checksum is not None:
            name = checks.checksum.signal
            place = self._fields[self.source.slot(name)]
            self._function, size = checksum(checks.checksum.kind)
            if place.bits != 8 or place.shift % 8 or size != 1:
                raise AxisError(
                    f"{self.source.name}.{name}: a checksum must be one whole byte: correct the DBC"
                )
            byte = place.shift // 8
            self._checksum_byte = byte if place.little else self._length - 1 - byte

    def reset(self) -> None:
        """Begin with whatever count comes."""
        if self._counter is not None:
            self._counter.reset()

    def receive(self, data: bytes, now_ns: int) -> None:
        """Check and decode a frame's bytes, and deliver the raw values."""
        if len(data) != self._length:
            self._counters["wrong_length"] += 1
            return
        at = self._checksum_byte
        if at >= 0 and self._function(data[:at] + data[at + 1 :]) != data[at]:
            self._counters["bad_checksum"] += 1
            return
        little, big = int.from_bytes(data, "little"), int.from_bytes(data, "big")
        values = [field.read(little, big) for field in self._fields]
        self._counters["frames"] += 1
        if self._counter is None or self._counter.accept(values):
            self.source.deliver(values, now_ns)

    def pack(self, values: Values) -> bytes:
        """Return the bytes of raw values; counter and checksum are filled in."""
        little = big = 0
        for slot, (value, field) in enumerate(zip(values, self._fields, strict=True)):
            raw = value
            if self._counter is not None and slot == self._counter_slot:
                raw = self._count
                self._count = (self._count + 1) % self._counter_modulo
            if field.little:
                little |= field.bits_of(raw)
            else:
                big |= field.bits_of(raw)
        length = self._length
        word = little | int.from_bytes(big.to_bytes(length, "big"), "little")
        data = bytearray(word.to_bytes(length, "little"))
        if (at := self._checksum_byte) >= 0:
            data[at] = self._function(bytes(data[:at] + data[at + 1 :]))
        return bytes(data)
