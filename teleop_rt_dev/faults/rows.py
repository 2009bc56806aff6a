"""The rows of the fault table: how each is injected, what must happen, and within how long."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import can

from teleop_rt.link.messages import Kind, ModelMessage
from teleop_rt.slave.faults import State
from teleop_rt_dev.faults.disk import alarmed, fill_the_disk, goes_on_and_loses_nothing
from teleop_rt_dev.faults.world import WATCHDOG_MS, FaultWorld, Phase
from teleop_rt_drivers.can_frames import Outgoing
from teleop_rt_drivers.simulated.motion import POSITION, VELOCITY
from teleop_rt_drivers.simulated.synchronous_bus import as_sent

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.rig import DeviceName

Check = Callable[[FaultWorld], bool]
PERIOD_S = 1e-3
STOPPED = {State.SAFE_STOP, State.FAULT}
MOVING: tuple[Phase, ...] = ("approach", "contact", "release")


@dataclass(frozen=True)
class Row:
    """One fault: `detected` must hold within `bound_ms`; `then` says what is wrong after it."""

    name: str
    inject: Callable[[FaultWorld], Any]
    detected: Check
    bound_ms: int
    stops: bool = True
    fault: str | None = None
    rig: str = "canopen"
    phases: tuple[Phase, ...] = ("arming", "approach", "contact", "release")
    overrides: tuple[str, ...] = ()
    then: Callable[[FaultWorld], str] = lambda world: ""


def stopped(world: FaultWorld) -> bool:
    return world.state in STOPPED


def held(world: FaultWorld) -> bool:
    return world.state in {State.HOLD, State.ARMED} and world.slave.sample.missing >= 3


def mute(device: DeviceName) -> Callable[[FaultWorld], None]:
    return lambda world: world.rig.inject("mute", device)


def mute_for_six_cycles(world: FaultWorld) -> None:
    world.rig.inject("mute", "force sensor")


def goes_on_once_healed(world: FaultWorld) -> str:
    pipeline = world.slave._pipeline
    before = pipeline.theta.copy()
    world.until(lambda: True)
    if not (pipeline.theta == before).all():
        return "the estimators went on without samples"
    world.rig.heal("force sensor")
    back = world.until(lambda: world.slave.sample.valid, 20)
    return "" if back > 0 and not stopped(world) else f"not back: {world.state.name}"


def deliver(world: FaultWorld, message: can.Message) -> None:
    """Put a frame on the bus that the daemon hears as anybody's."""
    world.axis._axis._bus.deliver(message)


def frame(cob_id: int, data: bytes = b"", *, error: bool = False) -> can.Message:
    return can.Message(arbitration_id=cob_id, is_extended_id=False, is_error_frame=error, data=data)


def error_passive(world: FaultWorld) -> None:
    deliver(world, frame(0x004, bytes((0, 0x10, 0, 0, 0, 0, 0, 0)), error=True))


def stays_off(world: FaultWorld) -> str:
    """Whoever asks, a drive that was stopped is not enabled again by itself."""
    if world.until(lambda: world.rig.drive.enabled, 1000) > 0:
        return "the drive was enabled again"
    return ""


def freeze_daemon(world: FaultWorld) -> None:
    world.frozen = True


def restart_is_disarmed(world: FaultWorld) -> str:
    """A daemon that is started again finds and configures the devices, and moves nothing."""
    if world.until(lambda: not world.rig.drive.powered, 300) < 0:
        return "the motor keeps its voltage"
    again = world.restarted()
    again.configure()
    for _ in range(300):
        world.tick()
        again.cycle()
        if world.rig.drive.powered:
            return "a restart powered the drive"
    return "" if again.safety.state is State.DISARMED else again.safety.state.name


def power_cut(world: FaultWorld) -> None:
    """The e-stop takes the drive's power: nobody acknowledges, frames wait in the controller."""
    bus = world.axis._axis._bus
    world.kept.held_frames = []
    world.kept.sending = bus.send
    bus.send = lambda message, timeout=None: world.kept.held_frames.append(message)
    world.rig.inject("mute", "drive")
    world.rig.drive.boot()


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
    """Devices acknowledge again: what had waited for them was purged, and nothing moves."""
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


def corrupt_for_two_cycles(world: FaultWorld) -> None:
    world.kept.rejected_before = world.slave.sample.rejected
    world.rig.inject("corrupt", "encoder")


def rejected_and_going_on(world: FaultWorld) -> str:
    world.until(lambda: True)
    world.rig.heal("encoder")
    if world.until(lambda: world.slave.sample.valid, 20) < 0:
        return "no valid sample any more"
    return "" if not stopped(world) else f"stopped: {world.fault}"


def rejected(world: FaultWorld) -> bool:
    return bool(world.slave.sample.rejected > world.kept.rejected_before)


def impossible(world: FaultWorld, data: bytes) -> None:
    world.kept.rejected_before = world.slave.sample.rejected
    world.rig.inject("mute", "encoder")
    deliver(world, frame(0x290, data))


def stalled(milliseconds: int) -> Callable[[FaultWorld], None]:
    """The loop stands still for so long; detection counts from its end."""

    def stall(world: FaultWorld) -> None:
        world.jump(milliseconds)
        world.ticks = 0
        world.kept.stood_at = world.slave.limiter.position

    return stall


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


def unplugged(device: DeviceName) -> Callable[[FaultWorld], None]:
    return lambda world: world.rig.inject("unplug", device)


def silence(side: str) -> Callable[[FaultWorld], None]:
    """Nothing that this side sends arrives any more."""

    def cut(world: FaultWorld) -> None:
        endpoint = getattr(world.world, f"{side}_endpoint")
        endpoint._transport.send = lambda packet, to=None: None

    return cut


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
    world.until(step, 365)  # to 500 ms of silence, less what the link may have been behind
    if abs(world.slave.limiter.position - held) > 1e-6:
        return "it did not hold"
    depth = held - surface if math.isfinite(surface) else 0.0
    world.until(step, 50 + round(max(depth, 0.0) / retreat * 1e3))
    if fastest > retreat * 1.2:
        return f"retreated at {fastest:.3f} m/s"
    deeper = world.slave.limiter.position - surface
    return "" if not math.isfinite(surface) or deeper < 1e-4 else f"{1e3 * deeper:.2f} mm too deep"


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


def ask_for_the_moon(world: FaultWorld) -> None:
    """The master's targets are as wild as they can be sent; each command is held to the limits."""
    limits = world.trial.rig.limits
    write, world.kept.commands = world.axis._axis.write, [world.slave.limiter.position]

    def noted(position: float) -> None:
        world.kept.commands.append(position)
        write(position)

    world.axis._axis.write = noted
    send = world.world.master_endpoint.send
    targets = iter(range(10**9))

    def wild(motion: Any) -> None:
        sign = -1 if next(targets) // 40 % 2 else 1
        send(motion._replace(target=sign * 1e6, engaged=True))

    setattr(world.world.master_endpoint, "send", wild)
    world.kept.limits = limits


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


def wild_models(world: FaultWorld) -> None:
    """Every second model is wild: as NaN and negative it is refused, as x 100 screened."""
    send = world.world.slave_endpoint.send
    count = iter(range(10**9))

    def wild(message: Any) -> None:
        if isinstance(message, ModelMessage):
            factor = (-1.0, 100.0, math.inf)[next(count) % 3]
            try:
                send(message._replace(k=message.k * factor, b=message.b * factor))
            except ValueError:
                return
        else:
            send(message)

    setattr(world.world.slave_endpoint, "send", wild)


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


def nothing(world: FaultWorld) -> None:
    """The network or the wall of the trial is the fault."""


def applied_in_order(world: FaultWorld) -> str:
    """Watch what is applied over a second: strictly newer, and felt without a step."""
    problem = []
    newest: dict[tuple[str, str], tuple[int, int]] = {}
    for side in ("slave", "master"):
        endpoint = getattr(world.world, f"{side}_endpoint")
        store = endpoint._store

        def noted(
            kind: int,
            *body: Any,
            side: str = side,
            endpoint: Any = endpoint,
            store: Any = store,
        ) -> None:
            sequence, key = endpoint.newest(kind), (side, Kind(kind).name)
            if sequence <= newest.get(key, (0, 0)):
                problem.append(f"{key}: {sequence} after {newest[key]}")
            newest[key] = sequence
            store(kind, *body)

        endpoint._store = noted
    world.until(lambda: False, 1000)
    if too_steep := slew(world):
        problem.append(too_steep)
    if len(newest) != 3:
        problem.append(f"only {sorted(newest)} was applied")
    return "; ".join(problem[:3])


def hostile_packets(world: FaultWorld) -> None:
    """Each genuine packet to the slave is followed by itself, by a flipped bit and by noise."""
    transport = world.world.master_endpoint._transport
    send, world.kept.hostile = transport.send, 0

    def attacked(packet: bytes, to: Any = None) -> None:
        send(packet, to)
        flipped = bytearray(packet)
        flipped[world.kept.hostile % len(packet)] ^= 1 << world.kept.hostile % 8
        for bad in (packet, bytes(flipped), packet[:40] + bytes(reversed(packet[40:]))):
            world.kept.hostile += 1
            send(bad, to)

    setattr(transport, "send", attacked)
    world.kept.received_before = world.world.slave_endpoint.statistics.received
    world.kept.genuine_before = world.world.master_endpoint.statistics.sent


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


def hung(world: FaultWorld) -> bool:
    """Whether systemd's watchdog has fired: the loop alone feeds it."""
    return world.not_fed_ms >= WATCHDOG_MS


def not_a_number(world: FaultWorld) -> None:
    """The force sensor sends whole frames, checksum and all, whose force is not a number."""
    world.kept.rejected_before = world.slave.sample.rejected
    setattr(world.rig.plant, "measured_force", lambda: math.nan)


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


def jam(world: FaultWorld) -> None:
    world.kept.jammed_at = float(world.rig.plant._state[POSITION])


def stopped_while_jammed(world: FaultWorld) -> bool:
    """Keep the tool where it jammed: nothing that the drive does moves it."""
    world.rig.plant._state[POSITION] = world.kept.jammed_at
    world.rig.plant._state[VELOCITY] = 0.0
    return stopped(world)


def named_by_comparison(world: FaultWorld) -> str:
    expected = {"following_error", "force_mismatch"}
    return "" if world.fault in expected else f"stopped for {world.fault}"


ON_HARDWARE = ("rig.realtime.late={hold_ms: 5, stop_ms: 20, stop_share: 0.2}",)
PRESSES_ON = ("operator.mean_m=0.02", "operator.amplitude_m=0.012")
"""On to 115 N: a stuck sensor does harm to whoever leads on by what is felt."""
BAD_NETWORK = (
    "link.round_trip_ms=400", "link.jitter_ms=100", "link.loss=0.3", "link.duplicate=0.05",
    "link.reorder=0.05",
)  # fmt: skip

ROWS = (
    Row("3 cycles without a valid sample", mute_for_six_cycles, held, 5, stops=False,
        then=goes_on_once_healed),
    Row("20 cycles without a valid sample", mute("force sensor"), stopped, 25,
        fault="samples_lost", overrides=ON_HARDWARE),
    Row("encoder dies", mute("encoder"), stopped, 80, fault="samples_lost", overrides=ON_HARDWARE),
    Row("drive dies", mute("drive"), stopped, 30, fault="drive_silent", phases=MOVING),
    Row("drive's status never comes", lambda w: w.rig.inject("mute_pdo", "drive"), stopped, 30,
        fault="drive_silent", phases=MOVING, then=stays_off),
    Row("tool jams", jam, stopped_while_jammed, 300, phases=MOVING, then=named_by_comparison),
    Row("force sensor sticks", lambda w: w.rig.inject("freeze", "force sensor"), stopped, 1500,
        fault="force_mismatch", phases=("contact",), then=stays_off, overrides=PRESSES_ON),
    Row("daemon killed or frozen", freeze_daemon, lambda w: w.stopped, 70, stops=False,
        phases=MOVING, then=restart_is_disarmed),
    Row("bus-off", lambda w: w.rig.inject("bus_off"), stopped, 2, fault="bus_off",
        then=stays_off),
    Row("error-passive", error_passive, stopped, 2, fault="error_passive", then=stays_off),
    Row("e-stop, then power returns", power_cut, stopped, 80, phases=MOVING, then=power_returns),
    Row("nobody acknowledges, then they do", lambda w: w.rig.inject("no_acknowledge", "drive"),
        stopped, 25, fault="not_acknowledged", then=nothing_waited),
    Row("malformed frames", corrupt_for_two_cycles, rejected, 3, stops=False,
        then=rejected_and_going_on),
    Row("impossible jump", lambda w: impossible(w, (10**7).to_bytes(4, "little") + bytes(4)),
        rejected, 3, stops=False, then=rejected_and_going_on),
    Row("wrong length", lambda w: impossible(w, bytes(6)), rejected, 3, stops=False,
        then=rejected_and_going_on),
    Row("emergency", lambda w: w.rig.inject("emergency", "drive"), stopped, 2, fault="emergency",
        then=stays_off),
    Row("duplicate node", lambda w: w.rig.inject("duplicate", "encoder"), stopped, 10,
        fault="duplicate_node"),
    Row("foreign SYNC", lambda w: deliver(w, frame(0x080)), stopped, 2, fault="foreign_master"),
    Row("foreign NMT", lambda w: deliver(w, frame(0x000, b"\x80\x00")), stopped, 2,
        fault="foreign_master"),
    Row("cable of the force sensor pulled", unplugged("force sensor"), stopped, 25, rig="serial",
        fault="unplugged", then=stays_off),
    Row("cable of the drive pulled", unplugged("drive"), stopped, 25, rig="serial",
        fault="unplugged"),
    Row("loop stalls for 3 ms", stalled(3), lambda w: w.state is not State.HOLD, 1, stops=False,
        overrides=ON_HARDWARE, phases=MOVING, then=goes_on_without_a_step),
    Row("loop stalls for 15 ms", stalled(15), held_for_a_stall, 1, stops=False,
        overrides=ON_HARDWARE, phases=MOVING, then=goes_on_without_a_step),
    Row("loop stalls for 30 ms", stalled(30), stopped, 1, fault="late_ticks",
        overrides=ON_HARDWARE),
    Row("a fifth of a second is late", nothing, late_now_and_then, 510, fault="late_ticks",
        overrides=ON_HARDWARE, phases=MOVING),
    Row("not a number", not_a_number, rejected, 3, stops=False, rig="serial", then=number_again),
    Row("hung loop: watchdog", freeze_daemon, hung, WATCHDOG_MS, stops=False, phases=MOVING,
        then=restart_is_disarmed),
    Row("disk full", fill_the_disk, alarmed, 51, stops=False, then=goes_on_and_loses_nothing),
    Row("bad network", nothing, lambda w: True, 1, stops=False, overrides=BAD_NETWORK,
        phases=("contact",), then=applied_in_order),
    Row("no model for 500 ms, then 2 s", silence("slave"), master_is("FROZEN"), 530, stops=False,
        phases=MOVING, then=declutches_and_fades),
    Row("no motion for 100 ms, then 500 ms", silence("master"), in_hold, 115, stops=False,
        phases=MOVING, then=goes_back_to_the_surface),
    Row("replayed, flipped and foreign packets", hostile_packets, counted_hostile, 25, stops=False,
        phases=MOVING, then=none_accepted),
    Row("wild parameters", wild_models, refused_models, 150, stops=False, phases=("contact",),
        then=renders_sanely),
    Row("a wall too stiff to render", nothing, reduced, 1500, stops=False, phases=("contact",),
        overrides=("plant.environment.stiffness_N_per_m=30000", "slave.force_cap_N=60"),
        then=within_the_passive_bound),
    Row("a command beyond the limits", ask_for_the_moon, limited, 30, stops=False, phases=MOVING,
        then=never_beyond_the_limits),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """The outcome of one case."""

    detected_ms: int
    state: str
    fault: str
    peak_force_N: float
    problem: str


def play(row: Row, phase: Phase, seed: int, session: Path) -> Outcome:
    """Lead a world to the phase, inject, and see what comes of it; ticks are milliseconds."""
    world = FaultWorld(session, row.rig, seed, *row.overrides)
    try:
        return _played(world.lead_to(phase), row)
    finally:
        world.close()


def _played(world: FaultWorld, row: Row) -> Outcome:
    row.inject(world)
    took = world.until(lambda: row.detected(world), row.bound_ms + 200)
    problems = []
    if not 0 < took <= row.bound_ms:
        problems.append(f"detected after {took} ms" if took > 0 else "never detected")
    if row.fault is not None and world.fault != row.fault:
        problems.append(f"named {world.fault}")
    if row.stops:
        world.until(lambda: False, 300)
        if world.axis.last != "stop":
            problems.append(f"the last command was {world.axis.last}")
        if world.rig.drive.enabled or world.state not in STOPPED:
            problems.append(f"not stopped: {world.state.name}")
    if problem := row.then(world):
        problems.append(problem)
    return Outcome(took, world.state.name, world.fault, world.peak_force, "; ".join(problems))
