"""The checks of a fault row: the expected signs of a fault, and the problems found after it."""

from __future__ import annotations

import math
from collections.abc import Callable

import can

from teleop_rt.slave.faults import State
from teleop_rt_dev.faults.world import WATCHDOG_MS, FaultWorld
from teleop_rt_drivers.can_frames import Outgoing
from teleop_rt_drivers.simulated.synchronous_bus import as_sent

Check = Callable[[FaultWorld], bool]
PERIOD_S = 1e-3  # of the shipped rigs
BRAKED_MS = 45
"""Longest time under power after a stop against a body: its way to rest, and 20 ms more."""
STIFFNESS, TURN_S = 3600.0, 0.005
"""Of the trial's body [N/m]; time in which a tool that still moves at a stop has turned."""
NOTHING_N, LET_GO_N = 1.0, 20.0
"""Room for noise; force that a tool without power is below after 300 ms."""
STOPPED = {State.SAFE_STOP, State.FAULT}


def stopped(world: FaultWorld) -> bool:
    return world.state in STOPPED


def held(world: FaultWorld) -> bool:
    return world.state in {State.HOLD, State.ARMED} and world.slave.sample.missing >= 3


def goes_on_once_healed(world: FaultWorld) -> str:
    pipeline = world.slave._pipeline
    before = pipeline.theta.copy()
    world.until(lambda: True)
    if not (pipeline.theta == before).all():
        return "the estimators went on without samples"
    world.rig.heal("force sensor")
    back = world.until(lambda: world.slave.sample.valid, 20)
    return "" if back > 0 and not stopped(world) else f"not back: {world.state.name}"


def stays_off(world: FaultWorld) -> str:
    """Whoever asks, a drive that was stopped is not enabled again by itself."""
    if world.until(lambda: world.rig.drive.enabled, 1000) > 0:
        return "the drive was enabled again"
    return ""


def restart_is_disarmed(world: FaultWorld) -> str:
    """A daemon that is started again finds and configures the devices, and moves nothing."""
    if world.until(lambda: not world.rig.drive.powered, 300) < 0:
        return "the motor keeps its voltage"
    return disarmed_again(world, "a restart powered the drive")


def disarmed_again(world: FaultWorld, complaint: str) -> str:
    """Start another daemon, and return the complaint if the drive has power with it."""
    again = world.restarted()
    again.configure()
    for _ in range(300):
        world.tick()
        again.cycle()
        if world.rig.drive.powered:
            return complaint
    return "" if again.safety.state is State.DISARMED else again.safety.state.name


def power_returns(world: FaultWorld) -> str:
    bus = world.axis._axis._bus
    bus.send = world.kept.sending
    world.rig.drive.boot()
    world.rig.heal("drive")
    before = world.rig.plant.position
    for message in world.kept.held_frames:
        bus.send(message)
    world.until(lambda: False, 300)
    if world.rig.drive.powered:
        return "a frame from before the stop powered the drive"
    if abs(world.rig.plant.position - before) > 0.002 and not world.in_contact:
        return "the tool moved"
    return "" if not world.slave.arm() else "it armed without a reset"


def nothing_waited(world: FaultWorld) -> str:
    """Devices acknowledge again: frames that had waited for them were purged, and nothing moves."""
    devices = world.axis._axis._bus._other
    arrived: list[Outgoing] = []
    deliver = devices.deliver

    def noted(frame: can.Message | Outgoing) -> None:
        arrived.append(as_sent(frame))
        deliver(frame)

    devices.deliver = noted
    world.rig.heal("drive")
    if any(can_id == 0x230 and data[0] == 0x0F for can_id, data in arrived):
        return "a command from before the stop reached the drive"
    return stays_off(world)


def rejected_and_going_on(world: FaultWorld) -> str:
    world.until(lambda: True)
    world.rig.heal("encoder")
    if world.until(lambda: world.slave.sample.valid, 20) < 0:
        return "no valid sample any more"
    return "" if not stopped(world) else f"stopped: {world.fault}"


def rejected(world: FaultWorld) -> bool:
    return bool(world.slave.sample.rejected > world.kept.rejected_before)


def held_for_a_stall(world: FaultWorld) -> bool:
    return world.state in {State.HOLD, State.ARMED} and world.slave.safety.late.holds > 0


def goes_on_without_a_step(world: FaultWorld) -> str:
    """It follows again a tick later, from rest and within its own limits."""
    most = world.trial.rig.limits.acceleration_max * PERIOD_S * (1 + 1e-6)
    before, velocity = world.kept.stood_at, 0.0
    for _ in range(60):
        command = world.slave.limiter.position
        asked, before = (command - before) / PERIOD_S, command
        if abs(asked - velocity) > most:
            return f"a step of {abs(asked - velocity):.3g} m/s"
        velocity = asked
        world.tick()
        if world.state is not State.RUN:
            return f"did not go on: {world.state.name}, {world.fault}"
    return ""


def in_hold(world: FaultWorld) -> bool:
    return world.state is State.HOLD


def goes_back_to_the_surface(world: FaultWorld) -> str:
    """Hold to 500 ms of silence, then go back at the safe speed, and at once."""
    surface, retreat = world.slave.contact.surface, world.trial.slave.retreat_speed
    before, fastest = world.slave.limiter.position, 0.0

    def step() -> bool:
        nonlocal before, fastest
        now = world.slave.limiter.position
        fastest, before = max(fastest, abs(now - before) * 1e3), now
        return False

    world.until(step, 20)  # it has braked
    held = world.slave.limiter.position
    world.until(step, 365)  # to 500 ms of silence, less the link's possible delay
    if abs(world.slave.limiter.position - held) > 1e-6:
        return "it did not hold"
    depth = held - surface if math.isfinite(surface) else 0.0
    world.until(step, 50 + round(max(depth, 0.0) / retreat * 1e3))
    if fastest > retreat * 1.2:
        return f"retreated at {fastest:.3f} m/s"
    deeper = world.slave.limiter.position - surface
    return "" if not math.isfinite(surface) or deeper < 1e-4 else f"{1e3 * deeper:.2f} mm too deep"


def never_beyond_the_limits(world: FaultWorld) -> str:
    world.until(lambda: False, 600)
    limits, period = world.kept.limits, 1e-3
    steps = [b - a for a, b in zip(world.kept.commands, world.kept.commands[1:], strict=False)]
    if not all(limits.position_min <= c <= limits.position_max for c in world.kept.commands):
        return "a command left the range"
    if max(map(abs, steps), default=0.0) > limits.velocity_max * period * (1 + 1e-9):
        return "a command was too fast"
    cap = world.trial.slave.force_cap
    return "" if world.peak_force < cap else f"{world.peak_force:.0f} N, cap {cap:.0f} N"


def limited(world: FaultWorld) -> bool:
    return world.slave.commands_limited > 0


def none_accepted(world: FaultWorld) -> str:
    world.until(lambda: False, 300)
    slave, master = world.world.slave_endpoint, world.world.master_endpoint
    received = slave.statistics.received - world.kept.received_before
    genuine = master.statistics.sent - world.kept.genuine_before
    late = 40  # sent before the attack, still under way
    if received > genuine + late:
        return f"{received} accepted of {genuine} genuine"
    return "" if world.kept.hostile > 500 and received > 200 else "no attack took place"


def counted_hostile(world: FaultWorld) -> bool:
    return sum(world.world.slave_endpoint.statistics.rejected.values()) > 0


def hung(world: FaultWorld) -> bool:
    """Whether systemd's watchdog has fired: the loop alone feeds it."""
    return world.not_fed_ms >= WATCHDOG_MS


def number_again(world: FaultWorld) -> str:
    del world.rig.plant.measured_force
    if world.until(lambda: world.slave.sample.valid, 20) < 0:
        return "no valid sample any more"
    finite = math.isfinite(world.slave.sample.force)
    return "" if finite and not stopped(world) else f"taken: {world.slave.sample.force}"


def late_now_and_then(world: FaultWorld) -> bool:
    """Stalls of 4 ms, none of which holds, with 10 ticks in time between them."""
    if world.ticks % 14 == 0:
        world.jump(4)
    return stopped(world)


def stopped_while_jammed(world: FaultWorld) -> bool:
    """Keep the tool where it jammed: nothing that the drive does moves it."""
    world.rig.plant.place(world.kept.jammed_at, 0.0)
    return stopped(world)


def stopped_for_force(world: FaultWorld) -> bool:
    """Note the force at the stop: an earlier force is the shove's."""
    if not stopped(world):
        return False
    plant = world.rig.plant
    turning_N = STIFFNESS * abs(plant.velocity) * TURN_S
    world.kept.most_force = plant.force + turning_N + NOTHING_N
    world.peak_force = 0.0
    return True


def lets_go_of_the_force(world: FaultWorld) -> str:
    """A stop for the force adds none but that of the tool's own motion, and then lets go."""
    world.until(lambda: not world.rig.drive.powered, BRAKED_MS)
    if world.rig.drive.powered:
        return f"still under power {BRAKED_MS} ms after the stop"
    world.until(lambda: False, 300)
    if world.peak_force > world.kept.most_force:
        return f"{world.peak_force:.0f} N after the stop, bound {world.kept.most_force:.0f} N"
    return "" if world.rig.plant.force < LET_GO_N else f"{world.rig.plant.force:.0f} N are left"


def named_by_comparison(world: FaultWorld) -> str:
    expected = {"following_error", "force_mismatch"}
    return "" if world.fault in expected else f"stopped for {world.fault}"
