"""The intended motion of the delay study: find the wall, press and move, hold still."""

from __future__ import annotations

import math
from collections.abc import Sequence

FELT_FORCE_N = 0.5
"""Force at which the hand notices the wall."""
STRIDE_M, STRIDE_S = 0.006, 0.3
"""A stride in free air, and the time that it takes."""
PRESS_M, PRESS_S = 0.020, 0.6
"""The way into the wall after it was noticed, and the time that it takes."""
TONES = ((0.5, 0.004), (1.3, 0.003), (1.9, 0.003))
"""Frequencies [Hz] and amplitudes [m] of the motion in contact. Shifted by up to the longest round
trip it differs from itself, so that its lag is unique; no common period below 10 s."""
APPROACH_STRIDES = 12
"""72 mm: further than any wall of the study."""


class MoveAndWait:
    """Strides forward and waits for the news of each (Ferrell 1965) until the wall is felt.

    Then the intention goes deeper by PRESS_M, moves by TONES for `move_s` and stays. It waits one
    round trip after each stride, so that the hand is never more than a stride ahead of the force
    that it feels, at any delay. A wall that is not felt within APPROACH_STRIDES strides never is.
    `positions` begin with engagement, when the time begins to run.
    """

    def __init__(self, round_trip_s: float, move_s: float) -> None:
        self._stride_period_s = STRIDE_S + round_trip_s
        self._move_s = move_s
        self.positions: list[float] = []
        self.reset()

    def reset(self) -> None:
        """Go back to the start."""
        self.felt_s: float | None = None
        self._origin = 0.0
        self.positions.clear()

    @property
    def gave_up_s(self) -> float:
        """Time at which the search for a wall ends."""
        return APPROACH_STRIDES * self._stride_period_s

    @property
    def still_s(self) -> float | None:
        """From when on the intention is constant; None before the wall is felt."""
        return None if self.felt_s is None else self.felt_s + PRESS_S + self._move_s

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        """Return intended position and velocity."""
        if self.felt_s is None and felt_force > FELT_FORCE_N:
            self.felt_s, self._origin = t_s, self._approach(t_s)
        position = self._approach(t_s) if self.felt_s is None else self._press(t_s - self.felt_s)
        if t_s <= 0.0:
            self.positions.clear()
        before = self.positions[-1] if self.positions else position
        self.positions.append(position)
        return position, (position - before) * 1e3

    def _approach(self, t_s: float) -> float:
        strides, since_s = divmod(min(t_s, self.gave_up_s), self._stride_period_s)
        return STRIDE_M * (strides + _smooth(since_s / STRIDE_S))

    def _press(self, since_s: float) -> float:
        position = self._origin + PRESS_M * _smooth(since_s / PRESS_S)
        moving_s = since_s - PRESS_S
        fade = _smooth(min(moving_s, self._move_s - moving_s) / 0.5)
        tones = sum(a * math.sin(2 * math.pi * hz * moving_s) for hz, a in TONES)
        return position + fade * tones


class ReplayedIntention:
    """The intention of a run, tick by tick, once more."""

    def __init__(self, positions: Sequence[float]) -> None:
        self._positions = positions
        self.reset()

    def reset(self) -> None:
        """Go back to the start."""
        self._tick = 0

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:  # noqa: ARG002 - played, not felt
        """Return the next intended position and velocity."""
        position = self._positions[self._tick]
        before = self._positions[max(0, self._tick - 1)]
        self._tick += 1
        return position, (position - before) * 1e3


def _smooth(u: float) -> float:
    """Return 0 to 1 along 3u² - 2u³."""
    u = min(max(u, 0.0), 1.0)
    return u * u * (3 - 2 * u)
