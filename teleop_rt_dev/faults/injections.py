"""The injections of the fault table: changes of a world, at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import can

from teleop_rt.link.messages import ModelMessage
from teleop_rt_dev.faults.world import FaultWorld
from teleop_rt_drivers.simulated.motion import SURFACE

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.rig import DeviceName

PERIOD_S = 1e-3  # of the shipped rigs


def mute(device: DeviceName) -> Callable[[FaultWorld], None]:
    return lambda world: world.rig.inject("mute", device)


def mute_for_six_cycles(world: FaultWorld) -> None:
    world.rig.inject("mute", "force sensor")


def deliver(world: FaultWorld, message: can.Message) -> None:
    """Put a frame on the bus that the daemon hears as anybody's."""
    world.axis._axis._bus.deliver(message)


def frame(cob_id: int, data: bytes = b"", *, error: bool = False) -> can.Message:
    return can.Message(arbitration_id=cob_id, is_extended_id=False, is_error_frame=error, data=data)


def error_passive(world: FaultWorld) -> None:
    deliver(world, frame(0x004, bytes((0, 0x10, 0, 0, 0, 0, 0, 0)), error=True))


def freeze_daemon(world: FaultWorld) -> None:
    world.frozen = True


def power_cut(world: FaultWorld) -> None:
    """The e-stop takes the drive's power: nobody acknowledges, frames wait in the controller."""
    bus = world.axis._axis._bus
    world.kept.held_frames = []
    world.kept.sending = bus.send
    bus.send = lambda message, timeout=None: world.kept.held_frames.append(message)
    world.rig.inject("mute", "drive")
    world.rig.drive.boot()


def corrupt_for_two_cycles(world: FaultWorld) -> None:
    world.kept.rejected_before = world.slave.sample.rejected
    world.rig.inject("corrupt", "encoder")


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


def unplugged(device: DeviceName) -> Callable[[FaultWorld], None]:
    return lambda world: world.rig.inject("unplug", device)


def silence(side: str) -> Callable[[FaultWorld], None]:
    """Nothing that this side sends arrives any more."""

    def cut(world: FaultWorld) -> None:
        endpoint = getattr(world.world, f"{side}_endpoint")
        endpoint.transport.send = lambda packet, to=None: None

    return cut


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


def nothing(world: FaultWorld) -> None:
    """The network or the wall of the trial is the fault."""


def hostile_packets(world: FaultWorld) -> None:
    """Each genuine packet to the slave is followed by itself, by a flipped bit and by noise."""
    transport = world.world.master_endpoint.transport
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


def not_a_number(world: FaultWorld) -> None:
    """The force sensor sends whole frames, checksum and all, whose force is not a number."""
    world.kept.rejected_before = world.slave.sample.rejected
    setattr(world.rig.plant, "measured_force", lambda: math.nan)


def jam(world: FaultWorld) -> None:
    world.kept.jammed_at = world.rig.plant.position


def shove(world: FaultWorld) -> None:
    """Somebody shoves the body 32 mm into the tool, whose drive stands against it."""
    world.rig.plant._constants[SURFACE] -= 0.032
