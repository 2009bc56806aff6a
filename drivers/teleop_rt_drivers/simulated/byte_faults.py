"""Faults of one device by name, at the level of the bytes of its frames."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from collections.abc import Callable

ByteFault = Literal["mute", "freeze", "wrong_length", "corrupt", "duplicate", "delay", "garbage"]
BYTE_FAULTS: tuple[str, ...] = get_args(ByteFault)


class FaultyFrames:
    """Faults of a device's outgoing frames.

    `mute` swallows them; `freeze` repeats the last good one; `wrong_length` cuts the last byte;
    `corrupt` flips bits; `duplicate` sends twice; `delay` holds each back until the next;
    `garbage` puts random bytes before each.
    """

    def __init__(self, transmit: Callable[[bytes], None], seed: int) -> None:
        self.fault = ""
        self._transmit = transmit
        self._random = random.Random(seed)  # noqa: S311 - a reproducible disturbance
        self._last = b""
        self._held = b""

    def heal(self) -> None:
        """End the fault."""
        self.fault = ""
        self._held = b""

    def note(self, frame: bytes) -> None:
        """Take a good frame for the last one: it was sent by a kernel."""
        self._last = frame

    def send(self, frame: bytes) -> None:
        """Send a frame, as the fault changes it."""
        if not self.fault:
            self._last = frame
            self._transmit(frame)
            return
        for spoilt in self._spoilt(frame):
            self._transmit(spoilt)

    def _spoilt(self, frame: bytes) -> list[bytes]:
        simple = {
            "mute": [],
            "freeze": [self._last or frame],
            "wrong_length": [frame[:-1]],
            "duplicate": [frame, frame],
        }
        if self.fault in simple:
            return simple[self.fault]
        if self.fault == "delay":
            held, self._held = self._held, frame
            return [held] if held else []
        if self.fault == "garbage":
            return [self._random.randbytes(self._random.randrange(1, 8)), frame]
        place = self._random.randrange(len(frame))
        flipped = frame[place] ^ self._random.randint(1, 255)
        return [frame[:place] + bytes((flipped,)) + frame[place + 1 :]]
