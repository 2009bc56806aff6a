"""Attack the link of real processes from between them, and read the slave's reaction.

    scripts/campaign attack [--seconds S] [--seed N] [--json]

Simulated rig, slave and master run at 200 Hz over loopback; a process between them that holds no
key sees every packet. First a stranger with ports of its own replays and forges handshakes; then
the one between repeats, reflects, changes and mixes packets while the master leads, goes on after
the master was killed, and releases the withheld packets of the dead master.
Exits with 1 where the slave obeyed anything of it, or was stopped by it.
"""

from __future__ import annotations

import argparse
import json
import secrets
import tempfile
import time
from operator import truediv
from pathlib import Path
from typing import Any

from teleop_rt.realtime.ring import RingReader
from teleop_rt.slave.faults import State
from teleop_rt_dev.faults.real import COLUMN, Sides
from teleop_rt_dev.link.stranger import Stranger
from teleop_rt_dev.link.wire_attacker import WireAttacker

RATE = "rig.rate_hz=200"
PER_PUMP, PAUSE_S = 4, 0.001
HELD_S = 0.3
"""Silence after which a slave that holds after 100 ms must hold."""
DRIFT_M = 1e-4
"""By so much a held axis may yield to a wall; the operator leads by centimetres."""


AFTERWARDS = (
    ("the same after the master was killed", False),
    ("withheld packets of the dead master, one by one", True),
)


class AttackedTrial:
    """A trial whose link an attacker holds."""

    def __init__(self, folder: Path, seed: int) -> None:
        port = 20000 + secrets.randbelow(20000)
        self.wire = WireAttacker(port, seed)
        self.stranger = Stranger(port, seed)
        own = {"master": [f"link.slave_port={self.wire.port}"]}
        self.sides = Sides(folder, [f"link.slave_port={port}", RATE], own)

    @property
    def withheld(self) -> int:
        """How many packets of the master it holds back."""
        return len(self.wire.to_slave.withheld)

    def row(self) -> dict[str, float]:
        """Return the last values that the slave recorded."""
        ring: RingReader = self.sides.ring("slave", "slave")
        newest = ring.newest()
        return {} if newest is None else {name: float(newest[COLUMN[name]]) for name in COLUMN}

    def go_on(
        self, seconds: float, attacks: int = 0, *, asks: int = 0, let_go: bool = False
    ) -> list[dict[str, float]]:
        """Let genuine traffic through, and attacks; return the slave's rows meanwhile."""
        rows = []
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            self.wire.pump()
            if attacks:
                self.wire.attack(attacks)
            if asks:
                self.stranger.attack(self.wire.to_slave.seen, asks)
            if let_go:
                self.wire.let_go()
            rows.append(self.row())
            time.sleep(PAUSE_S)
        return rows


def asked_by_a_stranger(world: AttackedTrial, seconds: float) -> dict[str, Any]:
    """Return a row: it holds where the master leads on and no port gets more than it sent."""
    first, passed = world.row(), world.wire.to_slave.passed
    rows = world.go_on(seconds, asks=PER_PUMP)
    last, stranger = rows[-1], world.stranger
    taken = last["packets_received"] - first["packets_received"]
    genuine = world.wire.to_slave.passed - passed
    gain = max(map(truediv, stranger.bytes_back, stranger.bytes_out))
    return {
        "attack": f"handshakes of a stranger, bytes back {gain:.2f} of those sent",
        "packets": stranger.sent,
        "refused": last["packets_rejected"] - first["packets_rejected"],
        "accepted": max(0.0, taken - genuine),
        "state": State(int(last["state"])).name,
        "holds": last["state"] == State.RUN and taken <= genuine and gain <= 1,
    }


def attacked_while_led(world: AttackedTrial, seconds: float) -> dict[str, Any]:
    """Return a row: it holds where the master leads on and no packet of the attacker is taken."""
    first, passed, sent = world.row(), world.wire.to_slave.passed, world.wire.sent
    last = world.go_on(seconds, PER_PUMP)[-1]
    taken = last["packets_received"] - first["packets_received"]
    genuine = world.wire.to_slave.passed - passed
    return {
        "attack": "repeated, reflected, changed, mixed while the master leads",
        "packets": world.wire.sent - sent,
        "refused": last["packets_rejected"] - first["packets_rejected"],
        "accepted": max(0.0, taken - genuine),
        "state": State(int(last["state"])).name,
        "holds": last["state"] == State.RUN and taken <= genuine,
    }


def attacked_without_master(
    world: AttackedTrial, seconds: float, name: str, *, let_go: bool
) -> dict[str, Any]:
    """Return a row: it holds where the slave follows nothing after the master was killed."""
    first, sent, withheld = world.row(), world.wire.sent, world.withheld
    rows = world.go_on(seconds, 0 if let_go else PER_PUMP, let_go=let_go)
    inwards = max(row["command"] for row in rows) - first["command"]
    followed = rows[-1]["followings"] - first["followings"]
    stays = all(row["state"] != State.RUN for row in rows)
    return {
        "attack": name,
        "packets": (world.wire.sent - sent) + (withheld - world.withheld),
        "refused": rows[-1]["packets_rejected"] - first["packets_rejected"],
        "accepted": followed,
        "state": State(int(rows[-1]["state"])).name,
        "holds": followed == 0 and inwards < DRIFT_M and stays,
    }


def attacked(folder: Path, seconds: float, seed: int) -> list[dict[str, Any]]:
    """Play the four attacks; return a row of each."""
    world = AttackedTrial(folder, seed)
    try:
        while world.row().get("state") != State.RUN:
            world.go_on(0.1)
        world.go_on(1.0)
        found = [asked_by_a_stranger(world, seconds), attacked_while_led(world, seconds)]
        world.wire.to_slave.open = False
        world.go_on(seconds)
        world.sides.processes["master"].kill()
        world.go_on(HELD_S)
        for name, let_go in AFTERWARDS:
            found.append(attacked_without_master(world, seconds, name, let_go=let_go))
        return found
    finally:
        world.sides.close()
        world.wire.close()
        world.stranger.close()


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign attack", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        found = attacked(Path(folder), options.seconds, options.seed)
    for one in found:
        if options.json:
            print(json.dumps(one))
        else:
            verdict = "holds" if one["holds"] else "FAILS"
            outcome = f"{one['packets']} packets, {one['accepted']:.0f} obeyed, {one['state']}"
            print(f"{one['attack']:60} {outcome}, {verdict}")
    return 0 if all(one["holds"] for one in found) else 1
