"""Measurements of a trial's link: round trip and loss, with its own packets."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_rt.link.keys import KEY_BYTES, KeyFileError, PeerKeys, load_own_key, shared_key
from teleop_rt.link.messages import MotionMessage, StateMessage
from teleop_rt.link.transport import LinkError, UdpTransport
from teleop_rt.trial.sides import make_endpoint
from teleop_rt_drivers.findings import Finding

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt.config.trial import TrialConfig
    from teleop_rt.link.channel import Endpoint

SECONDS = 3.0
"""Length of the measurement, a side's default."""
LOSSY = 0.05
"""Share of lost packets from which the link is reported."""
_STATE = StateMessage(position=0.0, force=0.0, contact_id=0, in_contact=False, following=False)
_REST = MotionMessage(target=0.0, velocity=0.0, contact_id=0, engaged=False)


def examine_link(
    trial: TrialConfig, wait: Callable[[], None], seconds: float = SECONDS
) -> list[Finding]:
    """Return round trip and loss of the link to the slave; it is not asked to follow.

    Where the trial names no port of a slave, both ends are this program's, on this machine, with
    the trial's impairment between them. `wait` waits for the next packet's turn.
    """
    link = trial.link
    alone = link.slave_port == 0
    try:
        file = link.key_file
        keys = shared_key(bytes(KEY_BYTES)) if file is None else load_own_key(Path(file))
        if alone:
            return [_both_ends(trial, keys, wait, seconds)]
        transport = UdpTransport(link.bind_host, 0, (link.host, link.slave_port))
    except (KeyFileError, LinkError) as error:
        return [Finding("error", str(error), "link", "follow this message, then run doctor again")]
    with closing(_end("master", trial, transport, keys)) as master:
        _exchange(master, None, wait, seconds)
        return [_judged(master, f"{link.host}:{link.slave_port}")]


def _both_ends(
    trial: TrialConfig, keys: PeerKeys, wait: Callable[[], None], seconds: float
) -> Finding:
    here = "127.0.0.1"
    at_slave = UdpTransport(here, 0)
    with (
        closing(_end("slave", trial, at_slave, keys)) as slave,
        closing(
            _end("master", trial, UdpTransport(here, 0, (here, at_slave.port)), keys)
        ) as master,
    ):
        _exchange(master, slave, wait, seconds)
        return _judged(master, "this machine, through the trial's simulated link")


def _end(role: str, trial: TrialConfig, transport: UdpTransport, keys: PeerKeys) -> Endpoint:
    return make_endpoint(
        "slave" if role == "slave" else "master",
        trial,
        transport,
        keys,
        time.monotonic_ns,
    )


def _exchange(
    master: Endpoint, slave: Endpoint | None, wait: Callable[[], None], seconds: float
) -> None:
    end_ns = time.monotonic_ns() + round(1e9 * seconds)
    while time.monotonic_ns() < end_ns:
        if slave is not None:
            slave.poll()
            slave.send(_STATE)
        master.poll()
        master.send(_REST)
        wait()


def _judged(master: Endpoint, where: str) -> Finding:
    counted = master.statistics
    if counted.round_trip_ns < 0:
        step = "start the slave there, and check address, port, key and firewall"
        return Finding("error", master.trouble or "no answer came back", f"link to {where}", step)
    share = counted.lost / max(1, counted.lost + counted.received)
    what = (
        f"round trip {counted.round_trip_ns * 1e-6:.1f} ms, at least "
        f"{counted.round_trip_min_ns * 1e-6:.1f} ms; {100 * share:.1f} % of "
        f"{counted.lost + counted.received} packets lost"
    )
    if share > LOSSY:
        step = "use a cable, or another network; the model survives loss, the hand feels less news"
        return Finding("warning", what, f"link to {where}", step)
    return Finding("ok", what, f"link to {where}")
