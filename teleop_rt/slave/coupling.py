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


def set_coupling(tick: Tick, mode: Mode, config: CouplingConfig) -> None:
    """Write the settings of a mode's end at the slave into the record of a tick."""
    tick.mode = _MODES[mode]
    tick.coupling_force_gain, tick.drift_speed = config.force_gain, config.drift_speed
    tick.reserve_J, tick.reserve_W = config.reserve_mJ * 1e-3, config.reserve_mW * 1e-3
    tick.tool_mass, tick.tool_damping = config.slave_mass, config.slave_damping
    tick.tool_stiffness, tick.tool_gain = config.stiffness, 1 + config.local_gain


@kernel
def couple(tick: Tick) -> None:
    """Begin to follow from a position at rest, without a jump; energy counts from here on."""
    tick.spent_J = -tick.reserve_J
    tick.known_before_J = tick.lead_energy_J
    tick.heard = tick.lead
    tick.coupled_position = tick.position
    tick.deviation = 0.0


@kernel
def coupled(tick: Tick) -> float:
    """Return the position to follow; with direct following that is the master's."""
    if tick.mode == PASSIVE:
        return passive(tick)
    if tick.mode == TOOL:
        return by_tool(tick)
    return tick.lead


@kernel
def affordable(step: float, force: float, available_J: float) -> float:
    """Return the part of a step against `force` that the energy pays for."""
    if force * step <= available_J:
        return step
    return max(0.0, available_J) / force


@kernel
def passive(tick: Tick) -> float:
    """Return the position that the energy received pays for.

    The slave's end of the two-port with delay (Ryu, Artigas and Preusche 2010). The motion of the
    master is followed as far as the energy that the hand is known to have put in pays for it
    (admittance controller). The motion that was not followed is drift; it is taken back at
    `drift_speed` wherever the energy suffices (Chawda, Ryu and O'Malley 2014).

    Energy is that of the measured motion: the force lags behind a commanded one, and the two
    together would be credited with energy that no environment gave. A commanded motion that has
    not happened yet is owed as well. `energy_J` is the environment's input so far.
    """
    moved = tick.lead - tick.heard
    tick.heard = tick.lead
    force = tick.force * tick.coupling_force_gain
    work_J = force * (tick.position - tick.coupled_position)
    tick.coupled_position = tick.position
    tick.spent_J += max(0.0, work_J) - tick.reserve_W * tick.period_s
    tick.energy_J += max(0.0, -work_J)
    owed_J = max(0.0, force * (tick.command - tick.position))
    available_J = tick.lead_energy_J - tick.known_before_J - tick.spent_J - owed_J
    step = affordable(moved, force, available_J)
    available_J -= max(0.0, force * step)
    drift = tick.lead - (tick.command + step)
    reach = tick.drift_speed * tick.period_s
    step += affordable(min(max(drift, -reach), reach), force, available_J)
    return tick.command + step


@kernel
def by_tool(tick: Tick) -> float:
    """Return the virtual mass's next position.

    The slave of Lawrence's transparency-optimised four channels (1993), as an admittance. A virtual
    mass M follows the master with C1 = Zs + Cs, C3 = 1 + C5 and the local force feedback C5. In the
    deviation u = v_s - v_m the master's acceleration, which C1 asks for, falls out:
    M u' = K (x_m - x_s) - B u + (1 + C5)(f_hand - g f_env), with the share g of the force that the
    hand is to feel: else the tool would yield to the rest of it.
    """
    moved = tick.lead - tick.heard
    tick.heard = tick.lead
    push = tick.tool_stiffness * (tick.lead - tick.command)
    push += tick.tool_gain * (tick.lead_force - tick.coupling_force_gain * tick.force)
    tick.deviation += push / tick.tool_mass * tick.period_s
    tick.deviation /= 1 + tick.tool_damping / tick.tool_mass * tick.period_s
    return tick.command + moved + tick.deviation * tick.period_s
