"""Round trip over loopback UDP, sealed and unsealed.

Both ends are in this process. Unsealed is the same message packed, sent and unpacked without
session, cipher and replay window; sealed goes through `Endpoint`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import get_args

from teleop_rt.link.channel import Endpoint, Role
from teleop_rt.link.codec import decode, encode
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import Kind, MotionMessage, StateMessage
from teleop_rt.link.transport import UdpTransport
from teleop_rt_dev.bench.measure import Row, interleave, ratios, row

ROUNDS = 2000  # there and back per time taken, so that the clock's own cost vanishes
MOTION = MotionMessage(0.0137, 0.04, 3, engaged=True, wall=True, surface=0.0136)
STATE = StateMessage(0.0137, 1.5, 3, in_contact=True)


def transports() -> tuple[UdpTransport, UdpTransport]:
    """Two sockets on loopback that know each other."""
    slave = UdpTransport()
    master = UdpTransport(peer=("127.0.0.1", slave.port))
    slave.peer = ("127.0.0.1", master.port)
    return master, slave


def wait(transport: UdpTransport) -> bytes:
    while (packet := transport.receive()) is None:
        pass
    return packet


def unsealed() -> Callable[[], None]:
    master, slave = transports()

    def round_trip() -> None:
        master.send(encode(MOTION))
        decode(Kind.MOTION, wait(slave))
        slave.send(encode(STATE))
        decode(Kind.STATE, wait(master))

    return round_trip


def sealed() -> Callable[[], None]:
    ends = transports()
    keys = shared_key(bytes(range(32)))
    master, slave = (
        Endpoint(role, transport, keys, time.monotonic_ns, rate_hz=1000)
        for role, transport in zip(get_args(Role), ends, strict=True)
    )
    while not master.connected or slave.motion is None:
        master.poll()
        master.send(MOTION)
        slave.poll()

    def round_trip() -> None:
        master.send(MOTION)
        slave.poll()
        while not slave.fresh_motion:
            slave.poll()
        slave.send(STATE)
        master.poll()
        while not master.fresh_state:
            master.poll()

    return round_trip


def mean_us(round_trip: Callable[[], None]) -> float:
    started_ns = time.perf_counter_ns()
    for _ in range(ROUNDS):
        round_trip()
    return (time.perf_counter_ns() - started_ns) * 1e-3 / ROUNDS


def run(rounds: int) -> list[Row]:
    plain, secure = unsealed(), sealed()
    times = interleave(rounds, (lambda: mean_us(plain), lambda: mean_us(secure)))
    return [
        row("unsealed round trip", "us", [one[0] for one in times]),
        row("sealed round trip", "us", [one[1] for one in times]),
        row("sealed over unsealed", "ratio", ratios(times, 1, 0), "<= 3"),
    ]
