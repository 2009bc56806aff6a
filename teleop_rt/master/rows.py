"""The master's row of a tick, as it is recorded and shown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt.master.walls import NO_WALL
from teleop_rt.signals import MASTER, columns

if TYPE_CHECKING:
    from teleop_rt.master.master import Master

_COLUMN = columns(MASTER)


def record(master: Master, now_ns: int) -> None:
    """Write the master's row of this tick."""
    row, slave = master.row, master.slave
    wall = master.adoption.newest
    row[_COLUMN["tick"]] = master.tick
    row[_COLUMN["stamp_ns"]] = now_ns
    row[_COLUMN["position"]] = master.position
    row[_COLUMN["velocity"]] = master.velocity
    row[_COLUMN["offset"]] = master.registration.offset
    row[_COLUMN["target"]] = master.target
    row[_COLUMN["rendered_force"]] = master.force
    row[_COLUMN["surface"]] = math.nan if wall is NO_WALL else wall.surface
    row[_COLUMN["blend"]] = master.adoption.weight
    row[_COLUMN["reflected_force"]] = math.nan if slave is None else slave.force
    row[_COLUMN["contact_id"]] = master.intake.acknowledged
    row[_COLUMN["model_sequence"]] = (
        0 if master.intake.model is None else master.intake.model.model_sequence
    )
    row[_COLUMN["refused_models"]] = master.screening.refusals
    _record_link(master, now_ns)
    bound = master.rendered_bound
    row[_COLUMN["adoption_energy"]] = master.adoption.energy_J * master.energy_scale
    row[_COLUMN["port_energy"]] = master.observer.energy_J
    row[_COLUMN["true_stiffness"]] = bound.true_stiffness
    row[_COLUMN["rendered_stiffness"]] = bound.rendered_stiffness
    row[_COLUMN["true_damping"]] = bound.true_damping
    row[_COLUMN["rendered_damping"]] = bound.rendered_damping
    row[_COLUMN["handle_fault"]] = master.fault.code
    row[_COLUMN["inadequate"]] = slave is not None and slave.inadequate


def _record_link(master: Master, now_ns: int) -> None:
    row, engagement, statistics = master.row, master.engagement, master.endpoint.statistics
    row[_COLUMN["state"]] = engagement.state
    row[_COLUMN["engagements"]] = engagement.engagements
    row[_COLUMN["freezes"]] = engagement.freezes
    row[_COLUMN["declutches"]] = engagement.declutches
    row[_COLUMN["silence_ms"]] = master.silence_ns * 1e-6
    row[_COLUMN["packets_received"]] = statistics.received
    row[_COLUMN["packets_lost"]] = statistics.lost
    row[_COLUMN["packets_rejected"]] = statistics.refused
    row[_COLUMN["trouble"]] = master.endpoint.trouble_code(now_ns)
