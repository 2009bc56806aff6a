"""The leash: a brake on a hand that runs ahead of a slave whose first touch is not yet known.

On a long link the slave may already press where the hand still moves freely. The brake is dry
friction with an elastic grip on the hand (Hayward and Armstrong 2000): it holds against a push
forward, follows a hand that goes back without pushing it, and slides at its limit, so it gives no
energy. Its limit rises from half the leash on, and is whole at its end.
"""

from __future__ import annotations


class Leash:
    """Holds back a hand by how far it leads; forces and lengths are the slave's, before scaling."""

    def __init__(self, length: float, force_max: float, stiffness: float) -> None:
        self._length = length
        self._force_max = force_max
        self._stiffness = stiffness
        self.reset()

    def reset(self) -> None:
        """Let go."""
        self._anchor: float | None = None
        self.slipped = False
        self.longest = 0.0

    def release(self) -> None:
        """Hold nobody any more: the first touch is known."""
        self._anchor = None

    def update(self, hand: float, lead: float) -> float:
        """Return the force against a hand that leads the slave by `lead`."""
        self.longest = max(self.longest, lead)
        share = min(1.0, max(0.0, 2 * lead / self._length - 1))
        if share == 0.0:
            self._anchor = None
            return 0.0
        if self._anchor is None or hand < self._anchor:
            self._anchor = hand
        limit = share * self._force_max
        if self._stiffness * (hand - self._anchor) > limit:
            self._anchor = hand - limit / self._stiffness
            self.slipped = self.slipped or share == 1.0
        return self._stiffness * (hand - self._anchor)
