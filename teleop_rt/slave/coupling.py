"""How the slave follows the master in the modes without a model: the baselines' other end."""

from __future__ import annotations

from teleop_rt.config.master import CouplingConfig, Mode
from teleop_rt.kernels.jit import kernel
from teleop_rt.slave.record import Tick

MODEL, DIRECT, PASSIVE, TOOL = range(4)
_MODES: dict[Mode, int] = {
    "model-mediated": MODEL,
    "direct": DIRECT,
    "tdpa": PASSIVE,
    "four-channel": TOOL,
}


def set_coupling(t: Tick, mode: Mode, config: CouplingConfig) -> None:
    """Write the settings of a mode's end at the slave into the record of a tick."""
    t.mode = _MODES[mode]
    t.coupling_force_gain, t.drift_speed = config.force_gain, config.drift_speed
    t.reserve_J, t.reserve_W = config.reserve_mJ * 1e-3, config.reserve_mW * 1e-3
    t.tool_mass, t.tool_damping = config.slave_mass, config.slave_damping
    t.tool_stiffness, t.tool_gain = config.stiffness, 1 + config.local_gain


@kernel
def couple(t: Tick) -> None:
    """Begin to follow from a position at rest, without a jump; energy counts from here on."""
    t.spent_J = -t.reserve_J
    t.known_before_J = t.lead_energy_J
    t.heard = t.lead
    t.coupled_position = t.position
    t.deviation = 0.0


@kernel
def coupled(t: Tick) -> float:
    """Return the position to follow; with direct following that is the master's."""
    if t.mode == PASSIVE:
        return passive(t)
    if t.mode == TOOL:
        return by_tool(t)
    return t.lead


@kernel
def affordable(step: float, force: float, available_J: float) -> float:
    """Return the part of a step against `force` that the energy pays for."""
    if force * step <= available_J:
        return step
    return max(0.0, available_J) / force


@kernel
def passive(t: Tick) -> float:
    """Return the position that the energy received pays for.

    The slave's end of the two-port with delay (Ryu, Artigas and Preusche 2010). The motion of the
    master is followed as far as the energy that the hand is known to have put in pays for it
    (admittance controller). The motion that was not followed is drift; it is taken back at
    `drift_speed` wherever the energy suffices (Chawda, Ryu and O'Malley 2014).

    Energy is that of the measured motion: the force lags behind a commanded one, and the two
    together would be credited with energy that no environment gave. A commanded motion that has
    not happened yet is owed as well. `energy_J` is the environment's input so far.
    """
    moved = t.lead - t.heard
    t.heard = t.lead
    force = t.force * t.coupling_force_gain
    work_J = force * (t.position - t.coupled_position)
    t.coupled_position = t.position
    t.spent_J += max(0.0, work_J) - t.reserve_W * t.period_s
    t.energy_J += max(0.0, -work_J)
    owed_J = max(0.0, force * (t.command - t.position))
    available_J = t.lead_energy_J - t.known_before_J - t.spent_J - owed_J
    step = affordable(moved, force, available_J)
    available_J -= max(0.0, force * step)
    drift = t.lead - (t.command + step)
    reach = t.drift_speed * t.period_s
    step += affordable(min(max(drift, -reach), reach), force, available_J)
    return t.command + step


@kernel
def by_tool(t: Tick) -> float:
    """Return the virtual mass's next position.

    The slave of Lawrence's transparency-optimised four channels (1993), as an admittance. A virtual
    mass M follows the master with C1 = Zs + Cs, C3 = 1 + C5 and the local force feedback C5. In the
    deviation u = v_s - v_m the master's acceleration, which C1 asks for, falls out:
    M u' = K (x_m - x_s) - B u + (1 + C5)(f_hand - g f_env), with the share g of the force that the
    hand is to feel: else the tool would yield to the rest of it.
    """
    moved = t.lead - t.heard
    t.heard = t.lead
    push = t.tool_stiffness * (t.lead - t.command)
    push += t.tool_gain * (t.lead_force - t.coupling_force_gain * t.force)
    t.deviation += push / t.tool_mass * t.period_s
    t.deviation /= 1 + t.tool_damping / t.tool_mass * t.period_s
    return t.command + moved + t.deviation * t.period_s
