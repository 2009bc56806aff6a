"""Rows of the fault table for drives with protocols of their makers, alike for all of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from teleop_rt_dev.faults.checks import (
    disarmed_again,
    lets_go_of_the_force,
    restart_is_disarmed,
    stays_off,
    stopped,
    stopped_for_force,
)
from teleop_rt_dev.faults.injections import freeze_daemon, shove
from teleop_rt_dev.faults.rows import MOVING, ON_HARDWARE, Row
from teleop_rt_dev.faults.world import FaultWorld

ON_CAN = ("odrive", "damiao", "robstride", "moteus", "vesc")
ON_LINES = ("dynamixel", "feetech")
WITH_FLOATS = ("odrive", "moteus")
"""Drives that send their position as a float, without a checksum."""
ENABLE_300_MS = "rig.supervision.drive_enable_ms=300"
AT_1_KHZ = ("rig.rate_hz=1000",)
"""The world's tick is a millisecond; bytes of a simulated line take no time."""


def harmed(fault: str) -> Callable[[FaultWorld], Any]:
    return lambda world: world.rig.inject(fault, "drive")


def named_in_words(world: FaultWorld) -> str:
    """The device and its report are with the fault."""
    return "" if world.slave.stopped.said else "nobody says which device it was"


def willing_too_late(world: FaultWorld) -> str:
    """A drive that would take power now is not given any before somebody arms again."""
    world.rig.heal("drive")
    return stays_off(world)


def restart_takes_its_power(world: FaultWorld) -> str:
    """A watchdog that holds the axis leaves the motor its voltage; a restarted daemon takes it."""
    return disarmed_again(world, "after a restart the drive has power")


def common_rows(kind: str, own: dict[str, Any]) -> tuple[Row, ...]:
    """Return the rows of every drive; a heartbeat of an ODrive comes every 10 ms."""
    return (
        Row(f"{kind} silent", harmed("mute"), stopped, 25, fault="samples_lost",
            then=named_in_words, **own),
        Row(f"{kind} answers under another id", harmed("wrong_id"), stopped, 25,
            fault="samples_lost", then=named_in_words, **own),
        Row(f"{kind} sends half a frame", harmed("wrong_length"), stopped, 25,
            fault="samples_lost", then=named_in_words, **own),
        Row(f"{kind} too hot", harmed("over_temperature"), stopped, 15, fault="drive_fault",
            phases=MOVING, then=lambda w: named_in_words(w) or stays_off(w), **own),
        Row(f"{kind} stops for the force of a shove", shove, stopped_for_force, 4,
            fault="force_limit", stops=False, phases=("contact",), then=lets_go_of_the_force,
            **own),
        Row(f"{kind} refuses power", harmed("refuse_enable"), stopped, 310, phases=("arming",),
            before_arming=True, then=willing_too_late,
            **own | {"overrides": (*own["overrides"], ENABLE_300_MS)}),
        Row(f"{kind} repeats its last answer", harmed("freeze"), stopped, 400,
            phases=("approach", "contact"), **own),
    )  # fmt: skip


def swapped(kind: str, own: dict[str, Any]) -> tuple[Row, ...]:
    """Return the row of a position whose bytes change places, of a drive that sends counts.

    A float differs by its lowest bits then, 0.8 % at most: nothing in the frame shows that.
    """
    if kind in WITH_FLOATS:
        return ()
    return (Row(f"{kind} sends swapped bytes", harmed("swapped_bytes"), stopped, 25,
                phases=MOVING, **own),)  # fmt: skip


def rows_on_can(kind: str) -> tuple[Row, ...]:
    """Return the rows of a drive on a CAN bus."""
    own: dict[str, Any] = {"rig": kind, "overrides": ON_HARDWARE}
    return (
        *common_rows(kind, own),
        *swapped(kind, own),
        Row(f"{kind}: bus-off", harmed("bus_off"), stopped, 2, fault="bus_off", then=stays_off,
            **own),
        Row(f"{kind}: daemon killed or frozen", freeze_daemon, lambda w: w.stopped, 70,
            stops=False, phases=MOVING, then=restart_is_disarmed, **own),
    )  # fmt: skip


def stands_at_its_goal(world: FaultWorld) -> str:
    """Without a watchdog nobody takes the servo's power: it goes to its last goal and holds."""
    world.until(lambda: False, 300)
    if not world.rig.drive.powered:
        return "who took its power?"
    return "" if abs(world.rig.plant.velocity) < 1e-3 else "it moves"


def rows_on_a_line(kind: str) -> tuple[Row, ...]:
    """Return the rows of a servo on a serial line; a Feetech watches nobody."""
    own: dict[str, Any] = {"rig": kind, "overrides": (*ON_HARDWARE, *AT_1_KHZ)}
    watches = kind == "dynamixel"
    afterwards = stays_off if watches else stands_at_its_goal
    pulled = Row(f"{kind}: cable pulled", harmed("unplug"), stopped, 2, fault="unplugged",
                 stops=watches, then=afterwards, **own)  # fmt: skip
    frozen = Row(f"{kind}: daemon killed or frozen", freeze_daemon, lambda w: w.stopped, 80,
                 stops=False, phases=MOVING, then=restart_takes_its_power, **own)  # fmt: skip
    return (*common_rows(kind, own), *swapped(kind, own), pulled, *((frozen,) if watches else ()))


LETS_GO = Row("vesc lets go and does not say so", harmed("refuse_enable"), stopped, 400,
              phases=("approach", "contact"), rig="vesc", overrides=ON_HARDWARE)  # fmt: skip
"""It reports neither power nor faults: the lag of the axis is detected."""
PROFILE_RIGS = ("canopen", "serial", "raw_can", "mixed")
ON_PROFILES = tuple(
    row
    for kind in PROFILE_RIGS
    for row in (
        Row(f"{kind} rig: drive refuses power", harmed("refuse_enable"), stopped, 310,
            phases=("arming",), before_arming=True, then=willing_too_late, rig=kind,
            fault="drive_silent", overrides=(*ON_HARDWARE, ENABLE_300_MS)),
        Row(f"{kind} rig: drive too hot", harmed("over_temperature"), stopped, 15, rig=kind,
            phases=MOVING, then=stays_off, overrides=ON_HARDWARE),
        Row(f"{kind} rig stops for the force of a shove", shove, stopped_for_force, 4, rig=kind,
            fault="force_limit", stops=False, phases=("contact",), then=lets_go_of_the_force,
            overrides=ON_HARDWARE),
    )
)  # fmt: skip
"""The same of drives with a fieldbus profile, or with the frames of a serial line or a DBC."""
ACTUATOR_ROWS = (
    *ON_PROFILES,
    *(row for kind in ON_CAN for row in rows_on_can(kind)),
    *(row for kind in ON_LINES for row in rows_on_a_line(kind)),
    LETS_GO,
)
