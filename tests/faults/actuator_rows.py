"""Rows of the fault table for drives with protocols of their makers, alike for all of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fault_rows import (
    MOVING,
    ON_HARDWARE,
    Row,
    freeze_daemon,
    restart_is_disarmed,
    stays_off,
    stopped,
)
from fault_world import FaultWorld

DRIVES = ("odrive", "damiao", "robstride", "moteus")


def harmed(fault: str) -> Callable[[FaultWorld], Any]:
    return lambda world: world.rig.inject(fault, "drive")


def named_in_words(world: FaultWorld) -> str:
    """The device and what it said are with the fault."""
    return "" if world.slave.stopped.said else "nobody says which device it was"


def rows_of(kind: str) -> tuple[Row, ...]:
    """Return the rows of one drive; a heartbeat of an ODrive comes every 10 ms."""
    own: dict[str, Any] = {"rig": kind, "overrides": ON_HARDWARE}
    return (
        Row(f"{kind} silent", harmed("mute"), stopped, 25, fault="samples_lost",
            then=named_in_words, **own),
        Row(f"{kind} answers under another id", harmed("wrong_id"), stopped, 25,
            fault="samples_lost", then=named_in_words, **own),
        Row(f"{kind} too hot", harmed("over_temperature"), stopped, 15, fault="drive_fault",
            phases=MOVING, then=lambda w: named_in_words(w) or stays_off(w), **own),
        Row(f"{kind}: bus-off", harmed("bus_off"), stopped, 2, fault="bus_off", then=stays_off,
            **own),
        Row(f"{kind}: daemon killed or frozen", freeze_daemon, lambda w: w.stopped, 70,
            stops=False, phases=MOVING, then=restart_is_disarmed, **own),
        Row(f"{kind} repeats its last answer", harmed("freeze"), stopped, 400,
            phases=("approach", "contact"), **own),
    )  # fmt: skip


ACTUATOR_ROWS = tuple(row for kind in DRIVES for row in rows_of(kind))
