"""Sources of frames: a source gives one kind of frame, a port carries several sources."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from teleop_rt.axis import AxisError, AxisFault
from teleop_rt_drivers.device_clock import Stored as Clocks
from teleop_rt_drivers.device_clock import new_clocks
from teleop_rt_drivers.framed.stream import Watched
from teleop_rt_drivers.framed.taking import StoredValue, new_values
from teleop_rt_drivers.quantity import Scale

if TYPE_CHECKING:
    from teleop_rt_drivers.framed.written_frame import StoredAim

Values = Sequence[float]
Listener = Callable[[Values, int], None]


@dataclass(frozen=True, slots=True)
class FieldInfo:
    """A field of a frame: its value in `unit` is raw * factor + offset."""

    name: str
    unit: str
    factor: float = 1.0
    offset: float = 0.0


_MOST_VALUES = 4
"""Measured values out of one kind of frame: a rig has a position and a force."""


class Source:
    """One kind of frame with named fields; listeners hear the raw values of each good frame.

    Those measured values that kernels may take out of a frame are the first `value_count` of
    `values`, each with its device's clock in `clocks`; `others` hear of a frame in any case.
    """

    def __init__(self, name: str, fields: tuple[FieldInfo, ...]) -> None:
        self.name = name
        self.fields = fields
        self.others: list[Listener] = []
        self.values, self.clocks = new_values(_MOST_VALUES), new_clocks(_MOST_VALUES)
        self.value_count = 0
        self._listeners: list[Listener] = []

    def listen(self, listener: Listener) -> None:
        """Call `listener(raw values, arrival [ns])` for each good frame."""
        self._listeners.append(listener)
        self.others.append(listener)

    def listen_for_value(self, listener: Listener) -> tuple[StoredValue, Clocks]:
        """Return room (1,) for a measured value and its clock.

        The listener is called where a frame is not taken by a kernel, which does the same.
        """
        self._listeners.append(listener)
        at = self.value_count
        self.value_count = at + 1
        return self.values[at : at + 1], self.clocks[at : at + 1]

    def deliver(self, values: Values, now_ns: int) -> None:
        """Hand a good frame on."""
        for listener in self._listeners:
            listener(values, now_ns)

    def slot(self, field: str) -> int:
        """Return the place of a field; raises AxisError naming those that there are."""
        for index, info in enumerate(self.fields):
            if info.name == field:
                return index
        known = ", ".join(info.name for info in self.fields)
        raise AxisError(f"{self.name} has no field {field!r}; it has: {known}")

    def scale(
        self, field: str, unit: str, per_unit: float | None, sign: int, offset: float, key: str
    ) -> Scale:
        """Return the way from raw values to the rig's `unit`.

        Raises AxisError where the field has another unit and no scale says how they relate.
        """
        info = self.fields[self.slot(field)]
        if per_unit is None and info.unit != unit:
            hint = f" ({_HINTS[info.unit]})" if info.unit in _HINTS else ""
            raise AxisError(
                f"{self.name}: field {field} is in {info.unit!r}, the rig in {unit!r}: "
                f"write {key}{hint}"
            )
        factor = (1.0 if per_unit is None else per_unit) * info.factor
        return Scale(
            abs(factor),
            sign if factor > 0 else -sign,
            offset + sign * (per_unit or 1.0) * info.offset,
        )


_HINTS = {
    "kg": "9.80665 N per kg under standard gravity",
    "g": "9.80665e-3 N per g under standard gravity",
    "lb": "4.4482216 N per lb under standard gravity",
    "mm": "1.0e-3 m per mm",
    "um": "1.0e-6 m per um",
    "deg": "0.017453292519943295 rad per deg",
}


class FramedPort(Protocol):
    """A serial port or a CAN bus: never blocks and never raises but while it is opened."""

    @property
    def fault(self) -> AxisFault:
        """Its fault."""

    @property
    def sources(self) -> Mapping[str, Source]:
        """The frames that come, by name."""

    @property
    def commands(self) -> Mapping[str, Source]:
        """The frames that can be sent, by name."""

    @property
    def watched(self) -> Sequence[Watched]:
        """The open lines, whose arrivals can be kept; none of a bus."""

    def open(self) -> None:
        """Reset: drop waiting frames and clear the fault. Raises AxisError."""

    def drain(self, now_ns: int) -> None:
        """Decode all that has arrived, and deliver the good frames."""

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive, no longer than that."""

    def send(self, command: str, values: Values) -> None:
        """Send a frame of raw values; counter and checksum are filled in."""

    def target_sender(self, aim: StoredAim) -> Callable[[float], bool] | None:
        """Return a sender of a target [rig unit] in one step, None where a frame needs more.

        It returns False where the target is to be sent by `send`: nothing has been sent then.
        """

    def close(self) -> None:
        """Release the port."""
