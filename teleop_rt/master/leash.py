"""The leash: a brake on a hand that runs ahead of a slave whose first touch is not yet known.

On a long link the slave may already press where the hand still moves freely. The brake is dry
friction with an elastic grip on the hand (Hayward and Armstrong 2000): it holds against a push
forward, follows a hand that goes back without pushing it, and slides at its limit, so it gives no
energy. Its limit rises from half the leash on, and is whole at its end. It falls slowly, also when
the slave begins to follow or the touch is known: a hand that has leant against the brake would be
flung forward where it ended at once, and the tool behind it. The fall begins at the present force,
however small: a force that ends within a period of the hand is a kick. The grip is damped as far as
the device can render it: a hand that taps on a spring alone rings, damped by little but its own.
Nothing bounds how fast the lead grows, as where states are lost on the link: the force rises by no
more than a step per tick, and the brake slides until it has risen, which gives no energy either.
"""

from __future__ import annotations

import math

Grip = tuple[float, float]
"""Stiffness and damping of a brake that holds: `WallLimiter.grip`."""
RELEASE_S = 1.0
"""In which the brake that a hand leans on is taken away: hands ring with 4 Hz and more."""


class Leash:
    """Holds back a hand by how far it leads; forces and lengths are the slave's, before scaling."""

    def __init__(
        self,
        length: float,
        force_max: float,
        grip: Grip,
        period_s: float,
        force_step: float = math.inf,
    ) -> None:
        self._length = length
        self._force_max, self._force_step = force_max, force_step
        self._stiffness, self._damping = grip
        self._release_share = period_s / RELEASE_S
        self.reset()

    def reset(self) -> None:
        """Let go."""
        self._anchor: float | None = None
        self._limit = self._spring = self._falls = self._force = 0.0
        self.slipped = False
        self.longest = self.largest = 0.0

    def update(self, hand: float, lead: float, velocity: float) -> float:
        """Return the force against a hand that leads the slave by `lead`, 0 once it may."""
        if self._limit == 0.0 and 2 * lead <= self._length:  # nothing to hold, as nearly always
            self.longest = max(self.longest, lead)
            self._force = 0.0
            return 0.0
        most = self._force + self._force_step
        self._force = self._held(hand, lead, velocity, most)
        self.largest = max(self.largest, self._force)
        return self._force

    def _held(self, hand: float, lead: float, velocity: float, most: float) -> float:
        """Return the force, which is not above `most`.

        It is never below 0, nor above the limit: the damping neither pushes nor holds more, and it
        ends as soon as the brake lets go, for a wall with a damping of its own may be felt by then.
        """
        self.longest = max(self.longest, lead)
        share = min(1.0, max(0.0, 2 * lead / self._length - 1))
        self._limit = self._limit_at(share * self._force_max)
        if self._limit <= 0.0:
            self._anchor, self._spring = None, 0.0
            return 0.0
        if self._anchor is None or hand < self._anchor:
            self._anchor = hand
        if share == 0.0:
            self._anchor = max(self._anchor, hand - self._spring / self._stiffness)
        spring, limit = self._stiffness * (hand - self._anchor), min(self._limit, most)
        if spring > limit:
            self._anchor = hand - limit / self._stiffness
            self.slipped = self.slipped or (share == 1.0 and limit == self._limit)
        self._spring = self._stiffness * (hand - self._anchor)
        damping = self._damping if share > 0.0 else 0.0
        return max(0.0, min(limit, self._spring + damping * velocity))

    def _limit_at(self, wanted: float) -> float:
        """Return the limit of a tick: a lower one is reached slowly, from the present force."""
        if wanted >= self._limit:
            self._falls = 0.0
            return wanted
        if self._falls == 0.0:
            self._limit = max(wanted, min(self._limit, self._spring))
            self._falls = self._limit * self._release_share
        return max(wanted, self._limit - self._falls)
