"""The checks of a fault row at the master: what is felt, refused, applied and rendered."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from teleop_rt.link.messages import Kind
from teleop_rt.slave.faults import State
from teleop_rt_dev.faults.checks import Check
from teleop_rt_dev.faults.world import FaultWorld


def master_is(name: str) -> Check:
    return lambda world: world.master.engagement.state.name == name


def slew(world: FaultWorld) -> str:
    """Say where new walls stepped the force; what the hand's own motion does is no step."""
    step, most = world.master.adoption.largest_step, world.trial.master.force_step
    return f"a force step of {step:.2f} N" if step > most * (1 + 1e-9) else ""


def declutches_and_fades(world: FaultWorld) -> str:
    after = world.until(lambda: master_is("DECLUTCHED")(world), 1600)
    if not 1400 <= after <= 1600:
        return f"declutched {after} ms after the freeze"
    world.until(lambda: False, 210)
    if abs(world.master.row[6]) > 0:
        return "a force is left after the fade"
    if problem := slew(world):
        return problem
    return "" if world.state is not State.RUN else "the slave follows on"


def refused_models(world: FaultWorld) -> bool:
    refused = sum(world.master.screening.refused.values()) + world.master.screening.clamped
    at_the_door = world.world.master_endpoint.statistics.rejected
    return refused + sum(at_the_door.values()) > 0


def renders_sanely(world: FaultWorld) -> str:
    world.until(lambda: False, 600)
    if problem := slew(world):
        return problem
    bound = world.master.rendered_bound
    return "" if math.isfinite(bound.rendered_stiffness) else "not finite"


def both(first: Callable[[], None], then: Callable[..., None], *values: Any) -> None:
    first()
    then(*values)


def applied_in_order(world: FaultWorld) -> str:
    """Watch what is applied over a second: strictly newer, and felt without a step."""
    problem = []
    newest: dict[tuple[str, str], tuple[int, int]] = {}

    def note(side: str, endpoint: Any, kind: Kind) -> None:
        sequence, key = endpoint.newest(kind), (side, kind.name)
        if sequence <= newest.get(key, (0, 0)):
            problem.append(f"{key}: {sequence} after {newest[key]}")
        newest[key] = sequence

    for side in ("slave", "master"):
        endpoint = getattr(world.world, f"{side}_endpoint")
        for name, kind in (("motion", Kind.MOTION), ("state", Kind.STATE), ("model", Kind.MODEL)):
            keep, noted = getattr(endpoint, f"hold_{name}"), partial(note, side, endpoint, kind)
            setattr(endpoint, f"hold_{name}", partial(both, noted, keep))
    world.until(lambda: False, 1000)
    if too_steep := slew(world):
        problem.append(too_steep)
    if len(newest) != 3:
        problem.append(f"only {sorted(newest)} was applied")
    return "; ".join(problem[:3])


def reduced(world: FaultWorld) -> bool:
    bound = world.master.rendered_bound
    return bound.rendered_stiffness < bound.true_stiffness


def within_the_passive_bound(world: FaultWorld) -> str:
    world.until(lambda: False, 300)
    bound, config = world.master.rendered_bound, world.trial.master
    assert config.device_damping is not None
    most = 2 * config.device_damping * config.rate_hz
    rendered = bound.rendered_stiffness
    return "" if rendered <= most * (1 + 1e-6) else f"rendered {rendered!r} N/m, bound {most} N/m"
