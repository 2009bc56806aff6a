"""A key that must be held: the kernel's own events of a keyboard, a pedal or a hand switch on USB.

Linux writes a `struct input_event` for each press and release (linux/input.h): a time of two longs,
type, code and value. A terminal reports no release, so it cannot be an enabling switch.
"""

from __future__ import annotations

import os
from struct import Struct

from teleop_rt.axis import AxisError

_EVENT = Struct("@llHHi")
_TYPE_KEY, _RELEASED = 0x01, 0
"""Type and value of an event: EV_KEY, and a key that goes up (linux/input-event-codes.h)."""
_MOST_EVENTS = 64
"""That are read at once: a keyboard makes a few for each key."""


class HeldKey:
    """Whether a key is held now, by an input device's events; a device that is gone holds none."""

    def __init__(self, path: str, code: int) -> None:
        """Open the device. Raises AxisError where it cannot be read."""
        self._code = code
        self.held = False
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise AxisError(
                f"the enabling key's device {path} cannot be read: {error.strerror}; correct"
                " device.enabling_key, and let this user read it (group input)"
            ) from error

    def update(self) -> bool:
        """Read the new events; return whether the key is held. Never raises."""
        try:
            events = os.read(self._file, _MOST_EVENTS * _EVENT.size)
        except BlockingIOError:
            return self.held
        except OSError:
            self.held = False
            return False
        if not events:
            self.held = False
        for start in range(0, len(events) - _EVENT.size + 1, _EVENT.size):
            _, _, kind, code, value = _EVENT.unpack_from(events, start)
            if kind == _TYPE_KEY and code == self._code:
                self.held = value != _RELEASED
        return self.held

    def close(self) -> None:
        """Release the device."""
        os.close(self._file)
