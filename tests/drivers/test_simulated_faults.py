from __future__ import annotations

import pytest
from rig_bench import Bench

from teleop_rt_drivers.simulated.faults import FaultyWire

PDO, HEARTBEAT = 0x290, 0x710


def sent(fault: str | None, frames: list[tuple[int, bytes]], node: int = 0x10):
    """The frames that reach the bus while the node has the fault."""
    out = []
    wire = FaultyWire(lambda *frame: out.append(frame), seed=1)
    wire.send(PDO, b"before")
    out.clear()
    if fault is not None:
        wire.inject(fault, node)
    for cob_id, data in frames:
        wire.send(cob_id, data)
    return out


FRAMES = [(PDO, b"one"), (HEARTBEAT, b"\x05"), (PDO, b"two")]


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (None, FRAMES),
        ("mute", []),
        ("freeze", [(PDO, b"before"), (HEARTBEAT, b"\x05"), (PDO, b"before")]),
        ("wrong_length", [(PDO, b"on"), (HEARTBEAT, b"\x05"), (PDO, b"tw")]),
        ("duplicate", [(PDO, b"one"), (PDO, b"one"), (HEARTBEAT, b"\x05"), *[(PDO, b"two")] * 2]),
        ("delay", [(HEARTBEAT, b"\x05"), (PDO, b"one")]),
    ],
)
def test_each_fault_spoils_the_bytes_as_it_says(fault, expected):
    assert sent(fault, FRAMES) == expected


def test_corrupt_changes_the_bytes_and_not_their_number():
    out = sent("corrupt", FRAMES)
    assert [(cob, len(data)) for cob, data in out] == [(cob, len(data)) for cob, data in FRAMES]
    assert out[0][1] != b"one"
    assert out[1] == FRAMES[1]
    assert out == sent("corrupt", FRAMES)


def test_a_fault_is_its_nodes_alone():
    assert sent("mute", FRAMES, node=0x20) == FRAMES


def test_after_bus_off_nothing_passes_either_way():
    bench = Bench().armed()
    bench.simulated.inject("bus_off")
    bench.cycles(50)
    assert bench.axis.counters["error_frame"] == 1
    assert bench.sample.missing == 49
    bench.silence(50)
    assert not bench.simulated.drive.powered


def test_an_unknown_fault_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="unknown fault 'explode'; one of: mute, freeze"):
        Bench().simulated.inject("explode")
