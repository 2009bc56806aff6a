"""Budgets of strangers' packets: so many a second, in all or for each address."""

from __future__ import annotations

ADDRESSES = 64
"""Addresses whose budget is kept; with more, all begin again."""


class Budget:
    """So many a second, and no more than a second's at once."""

    def __init__(self, per_s: float, now_ns: int) -> None:
        self._per_s = self._left = per_s
        self._taken_ns = now_ns

    def take(self, now_ns: int) -> bool:
        """Take one, if there is one left."""
        self._left = min(self._left + (now_ns - self._taken_ns) * self._per_s / 1e9, self._per_s)
        self._taken_ns = now_ns
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Budgets:
    """A budget for each address or host; those of a bounded number of them are kept."""

    def __init__(self, per_s: float) -> None:
        self._per_s = per_s
        self._of: dict[object, Budget] = {}

    def __len__(self) -> int:
        """Return how many budgets are kept."""
        return len(self._of)

    def take(self, whose: object, now_ns: int) -> bool:
        """Take one of somebody's budget, if there is one left."""
        if len(self._of) >= ADDRESSES and whose not in self._of:
            self._of.clear()
        return self._of.setdefault(whose, Budget(self._per_s, now_ns)).take(now_ns)
