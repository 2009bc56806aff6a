"""Felt force in the modes without a model: baselines on the same trial.

All work in the slave's coordinates and forces, before the scaling of the hand. `moved` is the
hand's motion since the last tick, over which the force returned by that tick was held.
"""

from __future__ import annotations

import math
from typing import Protocol

from teleop_rt.config.master import CouplingConfig, Mode
from teleop_rt.link.messages import StateMessage


class Coupling(Protocol):
    """The master's end of a coupling; `energy_J` is the hand's input so far."""

    energy_J: float

    def reset(self) -> None:
        """Reset, without force."""

    def update(self, x: float, velocity: float, slave: StateMessage, dt_s: float) -> float:
        """Return the force on the hand at x, with the newest news of the slave."""


class DirectReflection:
    """The slave's measured force, one way old, times a gain."""

    def __init__(self, config: CouplingConfig) -> None:
        self._gain = config.force_gain
        self.reset()

    def reset(self) -> None:
        """No state but the energy, which needs no reset."""
        self.energy_J = 0.0

    def update(self, x: float, velocity: float, slave: StateMessage, dt_s: float) -> float:  # noqa: ARG002 - the coupling's signature
        """Return the share of the slave's force."""
        return self._gain * slave.force


class PassiveReflection:
    """Time-domain passivity of a two-port with delay (Ryu, Artigas and Preusche 2010).

    The hand takes no more energy out of the channel than the environment is known to have put
    in at the other end; beyond that the force is damped (impedance controller). The slave guards
    the other direction. Each end lends a reserve, in sum as much as a rendered model's tank may
    spend.

    The textbook's f = f_s + α v leaves a force whole as long as the hand does not yield: a light
    hand is thrown back within the tick, which gives energy before the next one can damp, and
    the force chatters between all and nothing. So a tick may give no more than is available even
    where the force turns the hand round: with F along the force and u the velocity against it,
    F (F T / b - u) T <= E, where b = 2 m / T is the most damping that a hand of mass m is given
    by a sampled device. Without energy that is F = b u: a damper.
    """

    def __init__(self, config: CouplingConfig) -> None:
        self._gain = config.force_gain
        self._damping_max = config.control_damping_max
        self._reserve_J, self._reserve_W = config.reserve_mJ * 1e-3, config.reserve_mW * 1e-3
        self.reset()

    def reset(self) -> None:
        """Reset the energies, which count from the first news on."""
        self.energy_J = 0.0
        self._taken_J = -self._reserve_J
        self._known_before_J: float | None = None
        self._x: float | None = None
        self._force = 0.0

    def update(self, x: float, velocity: float, slave: StateMessage, dt_s: float) -> float:
        """Return the reflected force, damped where it would give energy that is not there."""
        if self._known_before_J is None:
            self._known_before_J = slave.energy_J
        if self._x is not None:
            given_J = self._force * (x - self._x)
            self.energy_J += max(0.0, given_J)
            self._taken_J += max(0.0, -given_J) - self._reserve_W * dt_s
        self._x = x
        available_J = slave.energy_J - self._known_before_J - self._taken_J
        wanted = self._gain * slave.force
        against = math.copysign(velocity, wanted * velocity)
        most = self._affordable_force(against, available_J, dt_s)
        self._force = math.copysign(1.0, wanted) * min(abs(wanted), most)
        return self._force

    def _affordable_force(self, against: float, available_J: float, dt_s: float) -> float:
        """Return the largest force for a velocity against it; negative where a debt is damped."""
        b = self._damping_max
        if available_J >= 0:
            return 0.5 * b * (against + math.sqrt(against**2 + 4 * available_J / (b * dt_s)))
        if against >= 0:
            return b * against
        return -min(b * -against, available_J / (against * dt_s))


class TransparentReflection:
    """The master of Lawrence's transparency-optimised four channels (1993).

    With local force feedback C6 (Hashtrudi-Zaad and Salcudean 2001), C2 = 1 + C6, C4 = -Cm and
    the device's own dynamics counted to the hand, the hand feels
    f = g f_s + (K (x_m - x_s) + B (v_m - v_s)) / (1 + C6), all of the slave one way old; g is 1
    for full transparency, and less where that is not stable even without delay.
    """

    def __init__(self, config: CouplingConfig) -> None:
        self._gain = config.force_gain
        share = 1 / (1 + config.local_gain)
        self._stiffness, self._damping = share * config.stiffness, share * config.damping
        self.reset()

    def reset(self) -> None:
        """No state but the energy, which needs no reset."""
        self.energy_J = 0.0

    def update(self, x: float, velocity: float, slave: StateMessage, dt_s: float) -> float:  # noqa: ARG002 - the coupling's signature
        """Return the slave's force and the pull towards where it is."""
        pull = self._stiffness * (x - slave.position)
        pull += self._damping * (velocity - slave.velocity)
        return self._gain * slave.force + pull


def make_coupling(mode: Mode, config: CouplingConfig) -> Coupling | None:
    """Return the master's end of a mode; None where a model is rendered."""
    match mode:
        case "model-mediated":
            return None
        case "direct":
            return DirectReflection(config)
        case "tdpa":
            return PassiveReflection(config)
        case "four-channel":
            return TransparentReflection(config)
