"""The master's row of a tick, as it is recorded and shown."""

from __future__ import annotations

import math
from struct import Struct
from typing import TYPE_CHECKING

from teleop_rt.master.walls import NO_WALL
from teleop_rt.signals import MASTER, columns

if TYPE_CHECKING:
    from teleop_rt.master.master import Master

_write = Struct(f"={columns(MASTER)['trouble'] + 1}d").pack_into


def record(master: Master, now_ns: int) -> None:
    """Write the master's row of this tick, in the order of `signals.MASTER`."""
    slave, wall, adoption = master.slave, master.adoption.newest, master.adoption
    model, engagement, bound = master.intake.model, master.engagement, master.rendered_bound
    endpoint = master.endpoint
    statistics = endpoint.statistics
    _write(
        master.row,
        0,
        master.tick,
        now_ns,
        master.position,
        master.velocity,
        master.registration.offset,
        master.target,
        master.force,
        math.nan if wall is NO_WALL else wall.surface,
        adoption.weight,
        math.nan if slave is None else slave.force,
        master.intake.acknowledged,
        0 if model is None else model.model_sequence,
        engagement.state,
        master.silence_ns * 1e-6,
        statistics.received,
        statistics.lost,
        statistics.refused,
        master.screening.refusals,
        engagement.engagements,
        engagement.freezes,
        engagement.declutches,
        adoption.energy_J * master.energy_scale,
        master.observer.energy_J,
        bound.true_stiffness,
        bound.rendered_stiffness,
        bound.true_damping,
        bound.rendered_damping,
        master.fault.code,
        slave is not None and slave.inadequate,
        endpoint.trouble_code(now_ns),
    )
