"""What the operator feels in the modes without a model: baselines on the same trial.

All work in the slave's coordinates and forces, before the scaling of the hand. `moved` is the
hand's motion since the last tick, over which the force returned by that tick was held.
"""

from __future__ import annotations

from typing import Protocol

from teleop_rt.config import CouplingConfig, Mode
from teleop_rt.link.messages import State


class Coupling(Protocol):
    """The master's end of a coupling; `energy_J` is what the hand has put into it so far."""

    energy_J: float

    def reset(self) -> None:
        """Begin anew, without force."""

    def update(self, x: float, velocity: float, slave: State, dt_s: float) -> float:
        """Return the force on the hand at x, with the newest news of the slave."""


class DirectReflection:
    """The slave's measured force, one way old, times a gain."""

    def __init__(self, config: CouplingConfig) -> None:
        self._gain = config.force_gain
        self.reset()

    def reset(self) -> None:
        """Nothing is kept but the energy, which nobody asks for."""
        self.energy_J = 0.0

    def update(self, x: float, velocity: float, slave: State, dt_s: float) -> float:  # noqa: ARG002 - the coupling's signature
        """Return the share of the slave's force."""
        return self._gain * slave.force


class PassiveReflection:
    """Time-domain passivity of a two-port with delay (Ryu, Artigas and Preusche 2010).

    The hand takes no more energy out of the channel than the environment is known to have put
    in at the other end; beyond that the force is damped, f = f_s + α v (impedance controller):
    down to none at all, and for what was given too much already by at most the damping that a
    sampled device renders. The slave guards the other direction. Each end lends a reserve, in
    sum what the tank of a rendered model may spend.
    """

    def __init__(self, config: CouplingConfig) -> None:
        self._gain = config.force_gain
        self._damping_max = config.control_damping_max
        self._reserve_J, self._reserve_W = config.reserve_mJ * 1e-3, config.reserve_mW * 1e-3
        self.reset()

    def reset(self) -> None:
        """Count energies anew, from the first news on."""
        self.energy_J = 0.0
        self._taken_J = -self._reserve_J
        self._known_before_J: float | None = None
        self._x: float | None = None
        self._force = 0.0

    def update(self, x: float, velocity: float, slave: State, dt_s: float) -> float:
        """Return the reflected force, damped where it would give energy that is not there."""
        if self._known_before_J is None:
            self._known_before_J = slave.energy_J
        if self._x is not None:
            given_J = self._force * (x - self._x)
            self.energy_J += max(0.0, given_J)
            self._taken_J += max(0.0, -given_J) - self._reserve_W * dt_s
        self._x = x
        force = self._gain * slave.force
        available_J = slave.energy_J - self._known_before_J - self._taken_J
        lacking_J = -force * velocity * dt_s - available_J
        power_per_damping = velocity * velocity * dt_s
        if lacking_J > 0 and power_per_damping > 0:
            most = self._damping_max + abs(force / velocity)
            force += min(most, lacking_J / power_per_damping) * velocity
        self._force = force
        return force


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
        """Nothing is kept but the energy, which nobody asks for."""
        self.energy_J = 0.0

    def update(self, x: float, velocity: float, slave: State, dt_s: float) -> float:  # noqa: ARG002 - the coupling's signature
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
