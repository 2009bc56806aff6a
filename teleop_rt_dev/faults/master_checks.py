"""The checks of a fault row at the master: forces felt, models refused, applied, rendered."""

from __future__ import annotations

import math

from teleop_rt.link.messages import Kind
from teleop_rt.slave.faults import State
from teleop_rt_dev.faults.checks import Check
from teleop_rt_dev.faults.world import FaultWorld


def master_is(name: str) -> Check:
    return lambda world: world.master.engagement.state.name == name


def slew(world: FaultWorld) -> str:
    """Report where new walls stepped the force; a change by the hand's own motion is no step."""
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


def applied_in_order(world: FaultWorld) -> str:
    """Watch the applied models over a second: never older than before, and felt without a step."""
    problem = []
    first: dict[tuple[str, str], tuple[int, int]] = {}
    newest: dict[tuple[str, str], tuple[int, int]] = {}

    def note() -> bool:
        for side, kind in (("slave", Kind.MOTION), ("master", Kind.STATE), ("master", Kind.MODEL)):
            key = side, kind.name
            sequence = getattr(world.world, f"{side}_endpoint").newest(kind)
            if sequence < newest.get(key, sequence):
                problem.append(f"{key}: {sequence} after {newest[key]}")
            newest[key] = sequence
            first.setdefault(key, sequence)
        return False

    world.until(note, 1000)
    if too_steep := slew(world):
        problem.append(too_steep)
    if still := [key for key in first if newest[key] == first[key]]:
        problem.append(f"nothing new of {still} was applied")
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
