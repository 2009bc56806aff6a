"""The energy at the hand's port, as it is: by the force that acts and the motion that is measured.

Hannaford and Ryu (2002) sum f Δx; here f is the force that acted over Δx, the answer to an older
sample by the port's latency, and no dissipation is assumed. A credit that is kept for ever would
let a port make as much energy as it once took, so the budget is that of one contact, and in it the
port has never more to give than the wall stores now and the tank holds (Ryu, Preusche, Hannaford
and Hirzinger 2005 follow the energy of a reference in the same way).
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import bound, kernel

CALM_S = 0.05
"""A port without force for so long is out of contact."""
GIVEN_BACK = 0.6
"""Of the energy taken, while bounded: 2 ms more than the device says make 0.4 of it at 8 Hz."""

RECOVERS_S = 0.02
"""How long a force that is withheld whole takes to return at a turn of the hand."""
RETURNS_S = 0.5
"""How long it takes once energy is not bounded any more: a wall that came nearer meanwhile is not
felt before, and within 20 ms it is a kick; as the longest blend of `adoption`.
"""

ROUNDING = 1e-9
"""Of the stored energy: a smaller fall within a tick is rounding, not a hand that leaves."""

StoredEnergy = NDArray[np.record]
Forces = NDArray[np.float64]


class PortEnergy:
    """The observer's record, which kernels read and write: settings, sums, the last tick."""

    share: float
    period_s: float
    capacity_J: float
    allowance_W: float
    damps: float
    energy_J: float
    lowest_J: float
    injected_J: float
    missing_J: float
    surface_J: float
    made_J: float
    epsilon_J: float
    stored_J: float
    turned_J: float
    taken_J: float
    withheld: float
    calm_s: float
    position: float
    begun: float


_FIELDS = tuple(PortEnergy.__annotations__)
_TYPE = np.dtype((np.record, np.dtype([(name, np.float64) for name in _FIELDS])))


@kernel
def count(port: PortEnergy, acted: float, force: float, stored_J: float, taken_J: float) -> None:
    """Book the energy of a tick; a new contact begins with nothing, and owes nothing."""
    calm = acted == 0.0 and force == 0.0
    if not calm and port.calm_s > CALM_S:
        port.energy_J = port.taken_J = 0.0
        port.epsilon_J = port.capacity_J
    port.calm_s = port.calm_s + port.period_s if calm else 0.0
    port.epsilon_J += port.allowance_W * port.period_s
    port.energy_J = min(port.energy_J + taken_J, stored_J + port.capacity_J)
    port.taken_J = min(max(port.taken_J, 0.0) + taken_J, stored_J)
    port.lowest_J = min(port.lowest_J, port.energy_J)
    port.missing_J = max(port.missing_J, -port.epsilon_J - port.energy_J)


@kernel
def turn(port: PortEnergy, stored_J: float, stepped_J: float) -> bool:
    """Take in the energy stored now; return whether the hand leaves the wall.

    The energy at which the hand turned changes in proportion where the master steps the wall: a
    step alone is no way back. Beyond rounding, for a hand at rest must not seem to leave.
    """
    before_J, was_J, port.stored_J = stored_J - stepped_J, port.stored_J, stored_J
    if before_J >= was_J * (1 - ROUNDING):
        port.turned_J = stored_J
        return False
    if stepped_J != 0.0 and before_J > 0.0:
        port.turned_J *= stored_J / before_J
    return True


@kernel
def paid(
    port: PortEnergy, force: float, stored_J: float, stepped_J: float, leaving: bool, bounded: bool
) -> float:
    """Return the force without the part that the energy taken in this contact does not cover.

    That is the energy of hand and tank, while bounded the hand's alone. A spring
    that has a share of its energy has the square root of it as its force: it begins deeper.
    While bounded a share is kept as well that grows without a step from where the hand turned,
    to 1 - GIVEN_BACK in all: a latency that is longer than the device says makes up to that.
    The withheld part is computed on the way out, and only falls on the way in, over `RECOVERS_S`:
    a force that is whole again at each turn is a step there, and a hand at rest chatters. Where the
    master steps a wall nearer while bounded, the force that no hand paid is withheld as it comes:
    withheld at the next turn alone, it falls there within a tick. The force withheld by a bounding
    returns over `RETURNS_S` after its end.
    """
    if not 0.0 < stored_J < math.inf:
        port.withheld = 0.0
        return force
    taken_J = port.taken_J if bounded else port.energy_J + port.epsilon_J
    share = math.sqrt(min(1.0, max(0.0, taken_J) / stored_J))
    if bounded and leaving and port.turned_J > 0.0:
        share *= 1 - 2 * (1 - GIVEN_BACK) * (1 - min(1.0, stored_J / port.turned_J))
    size = abs(force)
    falls = port.withheld - size * port.period_s / (RECOVERS_S if bounded else RETURNS_S)
    missing = max((1 - share) * size, falls)
    if not leaving:
        given = min(1.0, max(0.0, stepped_J) / stored_J) if bounded else 0.0
        missing = min(missing, port.withheld + size * (1 - math.sqrt(1 - given)))
    port.withheld = missing
    return math.copysign(max(0.0, size - port.withheld), force)


@kernel
def damping_of(port: PortEnergy, velocity: float, damping_max: float) -> float:
    """Return the damping that pays the deficit within this tick, as far as it may."""
    deficit_J = -port.epsilon_J - port.energy_J
    power_per_damping = velocity * velocity * port.period_s
    if deficit_J <= 0 or power_per_damping <= 0:
        return 0.0
    damping = min(damping_max, deficit_J / power_per_damping)
    port.injected_J += damping * power_per_damping
    return damping


@kernel
def observe(
    ports: StoredEnergy,
    forces: Forces,
    position: float,
    velocity: float,
    force: float,
    stored_J: float,
    damping_max: float,
    surface_J: float,
    stepped_J: float,
    bounded: bool,
) -> float:
    """Take in one tick; return the force, damped if need be: see `PassivityObserver.update`."""
    port: Any = ports[0]
    acted = port.share * forces[0] + (1 - port.share) * forces[1]
    change_J = acted * (position - port.position) if port.begun > 0.0 else 0.0
    port.begun, port.position = 1.0, position
    port.surface_J += surface_J
    count(port, acted, force, stored_J, change_J + surface_J)
    if not bounded:
        port.taken_J = stored_J  # when that begins, all stored energy was taken
    port.made_J = 0.0
    if not math.isinf(stored_J):  # of an unknown wall; without the compiler inf - inf is a warning
        port.made_J = stored_J - port.stored_J - change_J - surface_J
    leaving = turn(port, stored_J, stepped_J)
    force = paid(port, force, stored_J, stepped_J, leaving, bounded)
    if port.damps > 0.0:
        force += damping_of(port, velocity, damping_max) * velocity
    for at in range(len(forces) - 1):
        forces[at] = forces[at + 1]
    forces[-1] = force
    return force


def _number(name: str) -> Any:
    """Return a property that reads a field of an observer's record."""
    at = _FIELDS.index(name)
    return property(lambda observer: observer.numbers[at])


class PassivityObserver:
    """Observes the energy that the hand gives to the port in a contact, and damps a deficit.

    A passive port keeps E >= -ε, with ε the tank's capacity plus its allowance since the contact
    began. Below that, damping is added, at most as much as stays passive, until the deficit
    is paid; and a wall that stores more than E + ε gives back that share of its force. `made_J` is
    the energy that the port made in the last tick beyond its springs'. While `bounded`, force is
    given back only as far as energy was taken: that ends a growing oscillation whatever made it
    grow. `latency_s` is from a sample to the force that answers it. `numbers` is the record.
    """

    energy_J, lowest_J = _number("energy_J"), _number("lowest_J")
    injected_J, missing_J = _number("injected_J"), _number("missing_J")
    surface_J, made_J, epsilon_J = _number("surface_J"), _number("made_J"), _number("epsilon_J")

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
        stored: StoredEnergy = np.zeros(1, _TYPE)
        self._energy = energy = cast("PortEnergy", stored[0])
        energy.share = max(0.0, latency_s / period_s - whole)
        energy.period_s, energy.damps = period_s, float(damps)
        energy.capacity_J, energy.allowance_W = capacity_J, allowance_W
        self.numbers = stored.view(np.uint8).data.cast("d")
        self._forces = np.zeros(whole + 2)
        self.bounded, example = False, (0.0,) * 7
        self._observe = bound(observe, (stored, self._forces), *example, self.bounded)
        self.reset()

    def reset(self) -> None:
        """Reset the observer."""
        for at in range(_FIELDS.index("energy_J"), len(_FIELDS)):
            self.numbers[at] = 0.0
        self._energy.epsilon_J, self._energy.calm_s = self._energy.capacity_J, math.inf
        self._forces[:] = 0.0
        self.bounded = False

    def update(
        self,
        position: float,
        velocity: float,
        force: float,
        stored_J: float = math.inf,
        damping_max: float = math.inf,
        surface_J: float = 0.0,
        stepped_J: float = 0.0,
    ) -> float:
        """Take in one tick of the hand's own position; return the force, damped if need be.

        `stored_J` is the energy of the wall's springs at the hand, `surface_J` the work of a
        surface that moves by itself in this tick: it is the environment's own. `stepped_J` is the
        part of the change of `stored_J` by which the master changed the wall around the hand.
        """
        work = (stored_J, damping_max, surface_J, stepped_J, self.bounded)
        return self._observe(position, velocity, force, *work)
