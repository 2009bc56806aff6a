"""The ends of the device's travel: the hand is held back in front of them, and leads nobody.

Out of contact only. A brake, that of the leash, grows over the last of the travel, and the
slave does not follow the hand there: the offset takes that motion up, so that it follows a hand
that turns back at once, with that much travel gained (a clutch that opens by itself). In contact
the wall is where it is, and the travel ends with the fault `handle_end_of_travel`.
"""

from __future__ import annotations

import math

from teleop_rt.master.leash import Grip, Leash

MARGIN_SHARE = 0.05
"""Of the travel, at each end: 20 mm of the 400 mm of the shipped handles."""


class TravelEnds:
    """Both ends of a travel, as positions of the scaled hand; forces are the slave's.

    An ideal device's are infinite, and nothing is near them.
    """

    def __init__(
        self, ends: tuple[float, float], force_max: float, grip: Grip, period_s: float
    ) -> None:
        self._low, self._high = ends
        travel = self._high - self._low
        self.margin = MARGIN_SHARE * travel if math.isfinite(travel) else 0.0
        self._brakes = tuple(Leash(2 * self.margin, force_max, grip, period_s) for _ in range(2))
        self.reset()

    def reset(self) -> None:
        """Let go."""
        self._hand: float | None = None
        self.withheld = 0.0
        for brake in self._brakes:
            brake.reset()

    def beyond(self, hand: float) -> float:
        """Return how far a hand is within the margin of an end, < 0 at the lower one."""
        return max(0.0, hand - self._high + self.margin) + min(0.0, hand - self._low - self.margin)

    def withhold(self, hand: float, *, touches: bool) -> float:
        """Return the hand's motion towards an end near it since the last call."""
        before, self._hand = self._hand, hand
        beyond = self.beyond(hand)
        if before is None or beyond == 0.0 or touches:
            return 0.0
        moved = hand - before
        if moved * beyond <= 0.0:
            return 0.0
        withheld = max(0.0, min(moved, beyond)) + min(0.0, max(moved, beyond))
        self.withheld += abs(withheld)
        return withheld

    def brake(self, hand: float, velocity: float, *, touches: bool) -> float:
        """Return the force against a hand that goes on towards an end near it."""
        beyond = 0.0 if touches else self.beyond(hand)
        low, high = self._brakes
        held = high.update(hand, self.margin + beyond, velocity)
        return held - low.update(-hand, self.margin - beyond, -velocity)
