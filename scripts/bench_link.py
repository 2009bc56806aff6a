"""Round trip over loopback UDP, sealed and unsealed: python scripts/bench_link.py [--json].

Both ends are in this process. Unsealed is the same message packed, sent and unpacked without
session, cipher and replay window; sealed goes through `Endpoint`. Prints a table; exit code 1
where a bar does not hold.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

from teleop_rt.link.channel import Endpoint
from teleop_rt.link.messages import Kind, Motion, State, decode, encode
from teleop_rt.link.transport import UdpTransport

ROUNDS, BATCHES = 2000, 15
BAR = 3.0
MOTION = Motion(0.0137, 0.04, 3, engaged=True, wall=True, surface=0.0136)
STATE = State(0.0137, 1.5, 3, in_contact=True)


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
    key = bytes(range(32))
    master, slave = (
        Endpoint(role, transport, key, time.monotonic_ns, rate_hz=1000)
        for role, transport in zip(("master", "slave"), ends, strict=True)
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


def row(name: str, unit: str, values: list[float], bar: float | None) -> dict[str, Any]:
    median = statistics.median(values)
    holds = None if bar is None else median <= bar
    return {
        "name": name,
        "unit": unit,
        "median": round(median, 3),
        "min": round(min(values), 3),
        "max": round(max(values), 3),
        "bar": bar,
        "holds": holds,
    }


def mean_us(round_trip: Callable[[], None]) -> float:
    started_ns = time.perf_counter_ns()
    for _ in range(ROUNDS):
        round_trip()
    return (time.perf_counter_ns() - started_ns) * 1e-3 / ROUNDS


def measure() -> list[dict[str, Any]]:
    """Alternate between the two, so that whatever else runs here disturbs both."""
    plain, secure = unsealed(), sealed()
    mean_us(plain)
    mean_us(secure)
    pairs = [(mean_us(plain), mean_us(secure)) for _ in range(BATCHES)]
    return [
        row("unsealed round trip", "us", [p for p, _ in pairs], None),
        row("sealed round trip", "us", [s for _, s in pairs], None),
        row("sealed over unsealed", "1", [s / p for p, s in pairs], BAR),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    rows = measure()
    if arguments.json:
        machine = f"{platform.machine()} {platform.system()} Python {platform.python_version()}"
        print(json.dumps({"bench": "link", "machine": machine, "rows": rows}))
    else:
        for told in rows:
            verdict = {None: "", True: "ok", False: "MISSED"}[told["holds"]]
            spread = f"[{told['min']}, {told['max']}]"
            print(f"{told['name']:22} {told['median']:8} {told['unit']:3} {spread} {verdict}")
    sys.exit(any(told["holds"] is False for told in rows))


if __name__ == "__main__":
    main()
