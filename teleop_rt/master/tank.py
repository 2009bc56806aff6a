"""The tank of energy from which a rendered wall pays for its changes (Franken et al. 2011)."""

from __future__ import annotations


class Tank:
    """Energy that the rendered wall may spend, in joules; it starts full."""

    def __init__(self, capacity_J: float, allowance_W: float) -> None:
        self._capacity_J = capacity_J
        self._allowance_W = allowance_W
        self.level_J = capacity_J

    def reset(self) -> None:
        """Fill the tank."""
        self.level_J = self._capacity_J

    def fill(self, dissipated_J: float, dt_s: float) -> None:
        """Take in the energy that the hand dissipated, and the allowance of a hand at rest."""
        gained = max(0.0, dissipated_J) + self._allowance_W * dt_s
        self.level_J = min(self._capacity_J, self.level_J + gained)

    def spend(self, energy_J: float) -> None:
        """Pay for an adoption; a negative energy is gained."""
        self.level_J = min(self._capacity_J, self.level_J - energy_J)
