"""Faults by name, injected between the devices and the bus, at the level of bytes."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Any, Literal, get_args

from teleop_rt_drivers.can_frames import ERROR
from teleop_rt_drivers.simulated.synchronous_bus import SynchronousBus

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

LastingFault = Literal[
    "mute", "freeze", "wrong_length", "corrupt", "duplicate", "delay", "mute_pdo"
]
SingleFault = Literal["reset", "emergency", "device_error", "bus_off", "no_acknowledge", "unplug"]
LASTING: tuple[str, ...] = get_args(LastingFault)
SINGLE: tuple[str, ...] = get_args(SingleFault)
DRIVE_FAULTS = ("refuse_enable", "over_temperature")
PDO_IDS = range(0x180, 0x580)
BUS_OFF_CLASS = 0x040  # of an error frame, as in linux/can/error.h


def break_bus(fault: str, bus: can.BusABC) -> bool:
    """Cut a bus off from the daemon; false where the fault or the bus is another."""
    if not isinstance(bus, SynchronousBus):
        return False
    if fault == "no_acknowledge":
        bus.lose_other()
    elif fault == "unplug":
        bus.unplug_other()
    return fault in ("no_acknowledge", "unplug")


def break_drive(fault: str, drive: Any) -> bool:
    """Let a drive refuse power, or fail for being too hot; false where the fault is another."""
    if fault == "over_temperature":
        drive.overheat()
    elif fault == "refuse_enable":
        drive.refuses = True
    else:
        return False
    return True


def mend_bus(bus: can.BusABC) -> None:
    """Acknowledge the daemon's frames again."""
    if isinstance(bus, SynchronousBus):
        bus.find_other()


class FaultyWire:
    """Faults of each node's outgoing frames.

    `mute` swallows all of them, `mute_pdo` its PDOs alone; `freeze` repeats the bytes of the last
    good PDO; `wrong_length` cuts a PDO's last byte; `corrupt` flips bits in it; `duplicate` sends
    it twice; `delay` holds it back until the node's next one. `bus_off` is the whole bus's, and so
    are, in lock-step, `no_acknowledge` (nobody is there: the daemon's frames queue up) and
    `unplug`.
    """

    def __init__(self, transmit: Callable[[int, bytes], None], seed: int) -> None:
        self._transmit = transmit
        self._random = random.Random(seed)  # noqa: S311 - a reproducible disturbance
        self._active: dict[int, str] = {}
        self._last: dict[int, bytes] = {}
        self._held: dict[int, bytes] = {}
        self.off = False

    def inject(self, fault: LastingFault, node_id: int) -> None:
        """Let the node suffer from `fault` until `heal`."""
        self._active[node_id] = fault

    def heal(self, node_id: int) -> None:
        """End the node's lasting fault."""
        self._active.pop(node_id, None)
        self._held = {cob: data for cob, data in self._held.items() if cob & 0x7F != node_id}

    def bus_off(self) -> None:
        """Take the daemon's controller off the bus, as reported by its own error frame."""
        self._transmit(ERROR | BUS_OFF_CLASS, bytes(8))
        self.off = True

    @property
    def plain(self) -> bool:
        """Return whether nodes' frames are sent as they are."""
        return not self.off and not self._active

    def note(self, cob_id: int, data: bytes) -> None:
        """Note a node's frame that was sent without this wire, while it was plain."""
        self._last[cob_id] = data

    def send(self, cob_id: int, data: bytes) -> None:
        """Send a node's frame, as the fault changes it."""
        if self.off:
            return
        fault = self._active.get(cob_id & 0x7F) if self._active else None
        if fault is None or (cob_id not in PDO_IDS and fault != "mute"):
            self._last[cob_id] = data
            self._transmit(cob_id, data)
        elif fault not in ("mute", "mute_pdo"):
            self._spoil(fault, cob_id, data)

    def _spoil(self, fault: str, cob_id: int, data: bytes) -> None:
        """Send a PDO with its fault."""
        if fault == "delay":
            held = self._held.get(cob_id)
            self._held[cob_id] = data
            if held is None:
                return
            data = held
        elif fault == "duplicate":
            self._transmit(cob_id, data)
        elif fault == "freeze":
            data = self._last.setdefault(cob_id, data)
        elif fault == "wrong_length":
            data = data[:-1]
        elif fault == "corrupt":
            data = bytes(byte ^ self._random.getrandbits(8) for byte in data)
        self._transmit(cob_id, data)
