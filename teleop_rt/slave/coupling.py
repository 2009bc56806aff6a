"""How the slave follows the master in the modes without a model: the baselines' other end."""

from __future__ import annotations

from typing import Protocol

from teleop_rt.config_master import CouplingConfig, Mode
from teleop_rt.link.messages import Motion


class Coupling(Protocol):
    """The slave's end; `energy_J` is what the environment has put into the coupling so far."""

    energy_J: float

    def start(self, position: float, motion: Motion) -> None:
        """Begin to follow from a position at rest, without a jump."""

    def update(
        self, motion: Motion, command: float, position: float, force: float, dt_s: float
    ) -> float:
        """Return the position to follow; `command` is what was commanded last, `position` is."""


class DirectFollowing:
    """The master's position."""

    def __init__(self) -> None:
        self.energy_J = 0.0

    def start(self, position: float, motion: Motion) -> None:
        """Nothing is kept."""

    def update(
        self,
        motion: Motion,
        command: float,  # noqa: ARG002 - the coupling's signature
        position: float,  # noqa: ARG002 - as above
        force: float,  # noqa: ARG002 - as above
        dt_s: float,  # noqa: ARG002 - as above
    ) -> float:
        """Return the master's target."""
        return motion.target


class PassiveFollowing:
    """The slave's end of the two-port with delay (Ryu, Artigas and Preusche 2010).

    The motion of the master is followed as far as the energy that the hand is known to have put
    in pays for it (admittance controller). What was not followed is drift; it is taken back at
    `drift_speed` wherever the energy suffices (Chawda, Ryu and O'Malley 2014).

    Energy is that of the measured motion: the force lags behind a commanded one, and the two
    together would be credited with energy that no environment gave. What is commanded and not
    moved yet is owed as well.
    """

    def __init__(self, config: CouplingConfig) -> None:
        self._force_gain = config.force_gain
        self._drift_speed = config.drift_speed
        self._reserve_J, self._reserve_W = config.reserve_mJ * 1e-3, config.reserve_mW * 1e-3
        self.energy_J = 0.0
        self._spent_J = self._known_before_J = self._heard = self._position = 0.0

    def start(self, position: float, motion: Motion) -> None:
        """Count the hand's energy from here on."""
        self._spent_J = -self._reserve_J
        self._known_before_J = motion.energy_J
        self._heard = motion.target
        self._position = position

    def update(
        self, motion: Motion, command: float, position: float, force: float, dt_s: float
    ) -> float:
        """Return the position that the energy received pays for."""
        moved, self._heard = motion.target - self._heard, motion.target
        force *= self._force_gain
        work_J = force * (position - self._position)
        self._position = position
        self._spent_J += max(0.0, work_J) - self._reserve_W * dt_s
        self.energy_J += max(0.0, -work_J)
        owed_J = max(0.0, force * (command - position))
        available_J = motion.energy_J - self._known_before_J - self._spent_J - owed_J
        step = _affordable(moved, force, available_J)
        available_J -= max(0.0, force * step)
        drift = motion.target - (command + step)
        reach = self._drift_speed * dt_s
        step += _affordable(min(max(drift, -reach), reach), force, available_J)
        return command + step


def _affordable(step: float, force: float, available_J: float) -> float:
    """Return the part of a step against `force` that the energy pays for."""
    if force * step <= available_J:
        return step
    return max(0.0, available_J) / force


class VirtualTool:
    """The slave of Lawrence's transparency-optimised four channels (1993), as an admittance.

    A virtual mass M follows the master with C1 = Zs + Cs, C3 = 1 + C5 and the local force
    feedback C5. In the deviation u = v_s - v_m the master's acceleration, which C1 asks for, falls
    out: M u' = K (x_m - x_s) - B u + (1 + C5)(f_hand - g f_env), with the share g of the force
    that the hand is to feel: else the tool would yield to what is left of it.
    """

    def __init__(self, config: CouplingConfig) -> None:
        self._mass, self._damping = config.slave_mass, config.slave_damping
        self._stiffness, self._gain = config.stiffness, 1 + config.local_gain
        self._share = config.force_gain
        self.energy_J = 0.0
        self._deviation = self._heard = 0.0

    def start(self, position: float, motion: Motion) -> None:  # noqa: ARG002 - the coupling's signature
        """Follow from rest."""
        self._deviation, self._heard = 0.0, motion.target

    def update(
        self,
        motion: Motion,
        command: float,
        position: float,  # noqa: ARG002 - the coupling's signature
        force: float,
        dt_s: float,
    ) -> float:
        """Return the virtual mass's next position."""
        moved, self._heard = motion.target - self._heard, motion.target
        push = self._stiffness * (motion.target - command)
        push += self._gain * (motion.force - self._share * force)
        self._deviation += push / self._mass * dt_s
        self._deviation /= 1 + self._damping / self._mass * dt_s
        return command + moved + self._deviation * dt_s


def make_coupling(mode: Mode, config: CouplingConfig) -> Coupling | None:
    """Return the slave's end of a mode; None where the master renders a model."""
    match mode:
        case "model-mediated":
            return None
        case "direct":
            return DirectFollowing()
        case "tdpa":
            return PassiveFollowing(config)
        case "four-channel":
            return VirtualTool(config)
