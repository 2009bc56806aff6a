"""The energy at the hand's port, as it is: by the force that acts and the motion that is measured.

Hannaford and Ryu (2002) sum f Δx; here f is the force that acted over Δx, the answer to an older
sample by the port's latency, and no dissipation is assumed. A credit that is kept for ever would
let a port make as much energy as it once took, so the budget is that of one contact, and in it the
port has never more to give than the wall stores now and the tank holds (Ryu, Preusche, Hannaford
and Hirzinger 2005 follow the energy of a reference in the same way).
"""

from __future__ import annotations

import math

CALM_S = 0.05
"""A port without force for so long is out of contact."""
GIVEN_BACK = 0.6
"""Of the energy taken, while bounded: 2 ms more than the device says make 0.4 of it at 8 Hz."""

RECOVERS_S = 0.02
"""How long a force that is withheld whole takes to return."""


class PassivityObserver:
    """Observes the energy that the hand gives to the port in a contact, and damps what is missing.

    A passive port keeps E >= -ε, with ε the tank's capacity plus its allowance since the contact
    began. Below that, damping is added, at most what is said to be still passive, until the deficit
    is paid; and a wall that stores more than E + ε gives back that share of its force. `made_J` is
    what the port made in the last tick beyond what its springs hold. While `bounded`, force is
    given back only as far as energy was taken: that ends a growing oscillation whatever made it
    grow. `latency_s` is from a sample to the force that answers it.
    """

    def __init__(
        self,
        latency_s: float,
        period_s: float,
        capacity_J: float,
        allowance_W: float,
        *,
        damps: bool = True,
    ) -> None:
        whole = int(latency_s / period_s + 1e-6)
        self._share = max(0.0, latency_s / period_s - whole)
        self._forces = [0.0] * (whole + 2)
        self._period_s = period_s
        self._damps = damps
        self._capacity_J = capacity_J
        self._allowance_W = allowance_W
        self.reset()

    def reset(self) -> None:
        """Reset the observer."""
        self.energy_J = self.lowest_J = self.injected_J = self.change_J = self.missing_J = 0.0
        self.made_J = self._stored_J = self._turned_J = self.surface_J = 0.0
        self.epsilon_J = self._capacity_J
        self.bounded = False
        self._position: float | None = None
        self._calm_s = math.inf
        self._taken_J = self._withheld = 0.0
        self._forces[:] = [0.0] * len(self._forces)

    def update(
        self,
        position: float,
        velocity: float,
        force: float,
        stored_J: float = math.inf,
        damping_max: float = math.inf,
        surface_J: float = 0.0,
    ) -> float:
        """Take in one tick of the hand's own position; return the force, damped if need be.

        `stored_J` is what the wall's springs hold here, at the hand, `surface_J` the work of a
        surface that moves by itself in this tick: it is the environment's own.
        """
        acted = self._share * self._forces[0] + (1 - self._share) * self._forces[1]
        self.change_J = 0.0 if self._position is None else acted * (position - self._position)
        self._position = position
        self.surface_J += surface_J
        self._count(acted, force, stored_J, self.change_J + surface_J)
        if not self.bounded:
            self._taken_J = stored_J  # when that begins, what is stored was taken
        made_J = stored_J - self._stored_J - self.change_J - surface_J
        self.made_J = 0.0 if math.isinf(stored_J) else made_J
        leaving, self._stored_J = stored_J < self._stored_J, stored_J
        self._turned_J = self._turned_J if leaving else stored_J
        force = self._paid(force, stored_J, leaving=leaving)
        if self._damps:
            force += self._damping(velocity, damping_max) * velocity
        self._forces.append(force)
        del self._forces[0]
        return force

    def _count(self, acted: float, force: float, stored_J: float, taken_J: float) -> None:
        """Book the energy of a tick; a new contact begins with nothing, and owes nothing."""
        calm = acted == 0.0 and force == 0.0
        if not calm and self._calm_s > CALM_S:
            self.energy_J = self._taken_J = 0.0
            self.epsilon_J = self._capacity_J
        self._calm_s = self._calm_s + self._period_s if calm else 0.0
        self.epsilon_J += self._allowance_W * self._period_s
        self.energy_J = min(self.energy_J + taken_J, stored_J + self._capacity_J)
        self._taken_J = min(max(self._taken_J, 0.0) + taken_J, stored_J)
        self.lowest_J = min(self.lowest_J, self.energy_J)
        self.missing_J = max(self.missing_J, -self.epsilon_J - self.energy_J)

    def _paid(self, force: float, stored_J: float, *, leaving: bool) -> float:
        """Return the force less what the energy taken in this contact does not pay for.

        That is what the hand gave and the tank, while bounded what the hand gave alone. A spring
        that has a share of its energy has the square root of it as its force: it begins deeper.
        While bounded a share is kept as well that grows without a step from where the hand turned,
        to 1 - GIVEN_BACK in all: a latency that is longer than the device says makes up to that.
        What is withheld is found on the way out, and on the way in only falls, over `RECOVERS_S`:
        a force that is whole again at each turn is a step there, and a hand at rest chatters.
        """
        if not 0.0 < stored_J < math.inf:
            self._withheld = 0.0
            return force
        taken_J = self._taken_J if self.bounded else self.energy_J + self.epsilon_J
        share = math.sqrt(min(1.0, max(0.0, taken_J) / stored_J))
        if self.bounded and leaving and self._turned_J > 0.0:
            share *= 1 - 2 * (1 - GIVEN_BACK) * (1 - min(1.0, stored_J / self._turned_J))
        size = abs(force)
        falls = self._withheld - size * self._period_s / RECOVERS_S
        missing = max((1 - share) * size, falls)
        self._withheld = missing if leaving else min(self._withheld, missing)
        return math.copysign(max(0.0, size - self._withheld), force)

    def _damping(self, velocity: float, damping_max: float) -> float:
        """Return the damping that pays the deficit within this tick, as far as it may."""
        deficit_J = -self.epsilon_J - self.energy_J
        power_per_damping = velocity * velocity * self._period_s
        if deficit_J <= 0 or power_per_damping <= 0:
            return 0.0
        damping = min(damping_max, deficit_J / power_per_damping)
        self.injected_J += damping * power_per_damping
        return damping
