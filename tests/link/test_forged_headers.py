"""An attacker on the wire sees a session's number, and may write every field of a header."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import product

import pytest

from teleop_rt.link.messages import MotionMessage, StateMessage
from teleop_rt_dev.link.pair import Pair

FIELDS = {"session": 4, "sequence": 12, "stamp": 20, "echo": 28, "held": 36}
EDGES = (
    0,
    1,
    1023,
    1024,
    2**31,
    2**60,
    2**62,
    2**63 - 1,
    2**63,
    2**64 - 1024,
    2**64 - 2,
    2**64 - 1,
)


def forged(genuine: bytes) -> Iterator[bytes]:
    """Yield the packet with one or two fields of its header at the edges of their range."""
    for first, second in product(FIELDS.values(), repeat=2):
        for one, other in product(EDGES, repeat=2):
            packet = bytearray(genuine)
            struct.pack_into("<Q", packet, first, one)
            struct.pack_into("<Q", packet, second, other)
            yield bytes(packet)


@pytest.mark.parametrize("after_ticks", [3, 100, 3000])
def test_no_forged_header_is_accepted_or_raises_in_the_loop(after_ticks: int) -> None:
    pair = Pair(seed=1)
    pair.run(after_ticks)
    pair.master.send(MotionMessage(9.0, 0.0, 0, engaged=True))
    pair.slave.send(StateMessage(9.0, 0.0, 0, in_contact=False))
    for end, tap, sender in (
        (pair.slave, pair.slave_tap, pair.master_tap),
        (pair.master, pair.master_tap, pair.slave_tap),
    ):
        while tap.inner.receive() is not None:
            pass
        genuine, received = sender.sent[-1], end.statistics.received
        packets = [packet for packet in forged(genuine) if packet != genuine]
        refused = sum(end.statistics.rejected.values())
        tap.injected.extend(packets)
        while tap.injected:
            end.poll()
        assert end.statistics.received == received
        assert sum(end.statistics.rejected.values()) - refused == len(packets)
        tap.injected.append(genuine)
        end.poll()
        assert end.statistics.received == received + 1
