"""The clock of a recording that is played back: its place, pace, hold and loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

SLOWEST, FASTEST = 0.1, 10.0  # a page asks for no other pace


class Playback:
    """Where a recording is [s since its beginning], by a clock that may be held, moved and paced.

    It begins to run when it is first asked for its place.
    """

    def __init__(self, now_s: Callable[[], float], speed: float = 1.0) -> None:
        self._now_s = now_s
        self.speed = speed
        self.loops = False
        self.playing = True
        self._base_s = 0.0
        self._since_s: float | None = None

    @property
    def place_s(self) -> float:
        """The place that has been reached."""
        now_s = self._now_s()
        if self._since_s is None:
            self._since_s = now_s
        gone_s = (now_s - self._since_s) * self.speed if self.playing else 0.0
        return self._base_s + gone_s

    def move(self, place_s: float) -> None:
        """Continue from another place."""
        self._base_s, self._since_s = max(0.0, place_s), self._now_s()

    def change(self, asked: Mapping[str, Any]) -> float | None:
        """Take a request of a page: `play`, `speed`, `loop`; return the place of `seek`, if asked.

        Any other request, or a value out of range, changes nothing.
        """
        self.move(self.place_s)
        self.playing = asked["play"] if isinstance(asked.get("play"), bool) else self.playing
        self.loops = asked["loop"] if isinstance(asked.get("loop"), bool) else self.loops
        if (speed := _number(asked.get("speed"))) is not None and SLOWEST <= speed <= FASTEST:
            self.speed = speed
        return _number(asked.get("seek"))


def _number(value: Any) -> float | None:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        number = float(value)
    except OverflowError:  # JSON's whole numbers have no largest one
        return None
    return number if math.isfinite(number) else None
