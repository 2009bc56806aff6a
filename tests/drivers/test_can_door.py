"""Frames that kernels receive themselves are the frames that python-can would have brought."""

from __future__ import annotations

import errno
import random
import socket

import can
import pytest
from can.interfaces.socketcan import socketcan
from rig_bench import MS, START_NS, canopen_rig

from teleop_rt.axis import AxisFault, Sample, SampleFields
from teleop_rt_drivers.bus import BusConfig, open_bus
from teleop_rt_drivers.can_door import FRAMES_PER_PACKET, LOOK_EVERY, PACKETS_AT_ONCE
from teleop_rt_drivers.can_frames import one_by_one, packed, plain_message
from teleop_rt_drivers.canopen.axis import CanopenAxis
from teleop_rt_drivers.canopen.config import CanopenConfig
from teleop_rt_drivers.simulated.synchronous_bus import synchronous_pair
from teleop_rt_drivers.socketcan_bus import DirectSocketcanBus
from teleop_rt_drivers.unix_bus import UnixBus

NUMBERS = [name for name in SampleFields.__annotations__ if not name.startswith("has_")]
SAMPLE = [*NUMBERS, "stale", "complaint"]
ENCODER, FORCE, DRIVE = 0x290, 0x1A0, 0x1B0
PLAIN = ((ENCODER, 8), (FORCE, 5), (DRIVE, 8))
"""Their answers and how long they are."""
IDS = (ENCODER, FORCE, DRIVE, 0x710, 0x720, 0x730, 0x090, 0x000, 0x080, 0x123, 0x1ABCDEF0)


def random_frame(rng: random.Random) -> can.Message:
    """A frame for somebody or nobody, now and then of a wrong length, kind or content."""
    can_id = rng.choice(IDS) if rng.random() < 0.3 else rng.choice(IDS[:3])
    kind = rng.random()
    data = bytes(8) if rng.random() < 0.5 else rng.randbytes(rng.randint(0, 8))
    return can.Message(
        arbitration_id=can_id, is_extended_id=can_id > 0x7FF, data=b"" if kind < 0.05 else data,
        is_remote_frame=kind < 0.05, is_error_frame=0.05 <= kind < 0.1,
    )  # fmt: skip


@pytest.fixture
def wire(monkeypatch):
    """The other end of a socket that python-can takes for a raw socket of SocketCAN."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    monkeypatch.setattr(socketcan, "create_socket", lambda: ours)
    monkeypatch.setattr(socketcan, "bind_socket", lambda *_: None)
    theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    theirs.settimeout(5.0)
    with theirs:
        yield theirs


def as_struct(message: can.Message) -> bytes:
    """The 16 bytes of `struct can_frame`."""
    return packed(message, 0)[:16]


class Daemon:
    """An axis that hears the frames of a test, and the samples that it makes of them."""

    def __init__(self, bus: can.BusABC) -> None:
        rig = canopen_rig()
        assert isinstance(rig.axis, CanopenConfig)
        self.bus, self.now_ns = bus, START_NS
        self.axis = CanopenAxis(rig.axis, rig, bus, lambda: self.now_ns)
        self.axis.listen()

    def heard(self) -> tuple[object, ...]:
        """One cycle: its sample, and all counters."""
        sample = Sample()
        self.axis.read_into(sample)
        self.now_ns += MS
        return *(getattr(sample, name) for name in SAMPLE), *self.axis.counters.values()


def said_by_library(cycles: list[list[can.Message]]) -> list[tuple[object, ...]]:
    """The cycles of an axis to which each of these frames comes as python-can's message."""
    ours, _ = synchronous_pair()
    daemon = Daemon(ours)
    found = []
    for frames in cycles:
        for message in frames:
            ours.deliver(message)
        found.append(daemon.heard())
    return found


def conversation(seed: int) -> list[list[can.Message]]:
    rng = random.Random(seed)  # noqa: S311
    plain = [plain_message(one, bytes(size)) for one, size in PLAIN]
    several = lambda: [random_frame(rng) for _ in range(rng.randint(0, 6))]  # noqa: E731
    return [plain if rng.random() < 0.8 else several() for _ in range(200)]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("at_once", [False, True])
def test_between_processes_a_cycle_is_what_the_library_s_frames_make_of_it(tmp_path, seed, at_once):
    cycles = conversation(seed)
    with UnixBus(str(tmp_path)) as ours, UnixBus(str(tmp_path)) as theirs:
        daemon, found = Daemon(ours), []
        for frames in cycles:
            if at_once:
                theirs.send_frames([(_flagged(one), bytes(one.data)) for one in frames])
            else:
                for one in frames:
                    theirs.send(one)
            found.append(daemon.heard())
    assert found == said_by_library(cycles)
    assert {True, False} == {one[SAMPLE.index("valid")] for one in found}


def _flagged(message: can.Message) -> int:
    return int.from_bytes(as_struct(message)[:4], "little")


@pytest.mark.parametrize("seed", range(3))
def test_on_socketcan_a_cycle_is_what_the_library_s_frames_make_of_it(wire, seed):
    cycles = conversation(seed)
    with open_bus(BusConfig(interface="socketcan", channel="can0")) as bus:
        assert isinstance(bus, DirectSocketcanBus)
        daemon, found = Daemon(bus), []
        for frames in cycles:
            for one in frames:
                wire.send(as_struct(one))
            found.append(daemon.heard())
    assert found == said_by_library(cycles)


def test_on_socketcan_the_library_s_own_way_brings_the_same_frames(wire):
    with open_bus(BusConfig(interface="socketcan", channel="can0")) as bus:
        assert isinstance(bus, DirectSocketcanBus)
        rng = random.Random(1)  # noqa: S311
        sent = [random_frame(rng) for _ in range(40)]
        taken = []
        for taking in (bus.waiting_frames, lambda most: one_by_one(bus, most)):
            for one in sent:
                wire.send(as_struct(one))
            taken.append([(can_id, bytes(data)) for can_id, data, _ in taking(256)])
        assert taken[0] == taken[1]
        assert [can_id for can_id, _ in taken[0]] == [_flagged(one) for one in sent]


@pytest.mark.parametrize("frames", [15, 16, 17, 300])
def test_many_frames_at_once_are_all_taken(wire, frames):
    with open_bus(BusConfig(interface="socketcan", channel="can0")) as bus:
        daemon = Daemon(bus)
        for _ in range(frames):
            wire.send(as_struct(plain_message(0x123, b"")))
        daemon.heard()
        daemon.heard()
        assert daemon.axis.counters["unexpected_id"] == frames
        assert daemon.axis.counters["flood"] == (frames > 256)


def test_what_is_sent_on_socketcan_are_its_structs(wire):
    with open_bus(BusConfig(interface="socketcan", channel="can0")) as bus:
        daemon = Daemon(bus)
        daemon.heard()
        sync, heartbeat = wire.recv(100), wire.recv(100)
        assert sync == b"\x80\0\0\0" + bytes(12)
        assert heartbeat[:5] == b"\x7f\x07\0\0\x01"
        assert heartbeat[8] == 5
        assert {len(sync), len(heartbeat)} == {16}


def test_a_queue_that_nobody_empties_is_a_bus_where_nothing_acknowledges(wire):
    with open_bus(BusConfig(interface="socketcan", channel="can0")) as bus:
        assert isinstance(bus, DirectSocketcanBus)
        with pytest.raises(can.CanOperationError) as refused:
            bus.send_frames([(0x080, b"")] * 100_000)
        assert refused.value.error_code in {errno.EAGAIN, errno.ENOBUFS}
        daemon = Daemon(bus)
        while daemon.axis.counters["send_failed"] < 3:
            daemon.heard()
        assert daemon.heard()[SAMPLE.index("fault")] is AxisFault.NOT_ACKNOWLEDGED


def test_an_interface_that_breaks_is_counted_and_raises_nothing(wire):
    with open_bus(BusConfig(interface="socketcan", channel="can0")) as bus:
        assert isinstance(bus, DirectSocketcanBus)
        daemon = Daemon(bus)
        daemon.heard()
        descriptor, bus.door.door.descriptor = bus.door.door.descriptor, 9999
        daemon.heard()
        bus.door.door.descriptor = descriptor
        assert daemon.axis.counters["unreadable"] == 1
        wire.send(as_struct(plain_message(0x123, b"")))
        daemon.heard()
        assert daemon.axis.counters["unexpected_id"] == 1


@pytest.mark.parametrize("length", [1, 23, 25, 48 + 1, 8 * 24, 9 * 24])
def test_a_packet_that_is_no_frames_is_unreadable(tmp_path, length):
    with UnixBus(str(tmp_path)) as ours, UnixBus(str(tmp_path)) as theirs:
        daemon = Daemon(ours)
        daemon.heard()
        theirs._peers[0].send(bytes(length))
        theirs.send(plain_message(0x123, b""))
        daemon.heard()
        assert daemon.axis.counters["unreadable"] == 1
        assert daemon.axis.counters["unexpected_id"] == 1


def test_frames_sent_at_once_fill_packets_and_come_in_their_order(tmp_path):
    with UnixBus(str(tmp_path)) as ours, UnixBus(str(tmp_path)) as theirs:
        assert ours.recv(0) is None
        count = PACKETS_AT_ONCE * FRAMES_PER_PACKET + 3
        sent = [(can_id, can_id.to_bytes(2, "little")) for can_id in range(count)]
        taken = []
        for taking in (lambda: ours.waiting_frames(256), lambda: one_by_one(ours, 256)):
            theirs.send_frames(sent)
            taken.append([(can_id, bytes(data)) for can_id, data, _ in taking()])
        assert taken == [sent, sent]


def test_what_is_usual_passes_no_python(wire, tmp_path, monkeypatch):
    def refuse(*_):
        raise AssertionError("not by this way")

    plain = [plain_message(one, bytes(size)) for one, size in PLAIN]
    with (
        open_bus(BusConfig(interface="socketcan", channel="can0")) as socketcan_bus,
        UnixBus(str(tmp_path)) as ours,
        UnixBus(str(tmp_path)) as theirs,
    ):
        for bus, say in (
            (socketcan_bus, lambda one: wire.send(as_struct(one))),
            (ours, theirs.send),
        ):
            daemon = Daemon(bus)
            daemon.heard()
            for name in ("waiting_frames", "keep", "recv"):
                monkeypatch.setattr(bus, name, refuse)
            for one in plain:
                say(one)
            assert daemon.heard()[SAMPLE.index("valid")] is True


def usual_cycle(daemon: Daemon, bus: UnixBus) -> None:
    """One cycle, in which the devices on this bus answer as they nearly always do."""
    for can_id, size in PLAIN:
        bus.send(plain_message(can_id, bytes(size)))
    assert daemon.heard()[SAMPLE.index("valid")] is True


def test_a_program_is_met_in_time_though_no_python_asks_the_bus_meanwhile(tmp_path, monkeypatch):
    with UnixBus(str(tmp_path)) as ours, UnixBus(str(tmp_path)) as theirs:
        daemon = Daemon(ours)
        daemon.heard()
        with monkeypatch.context() as alone:
            for name in ("lend", "is_plain", "waiting_frames"):
                alone.setattr(ours, name, lambda *_: pytest.fail("the door is lent"))
            for _ in range(3 * LOOK_EVERY):
                usual_cycle(daemon, theirs)
        with UnixBus(str(tmp_path)) as third:
            third.send(plain_message(0x123, b""))
            for _ in range(LOOK_EVERY):
                usual_cycle(daemon, theirs)
            assert daemon.axis.counters["unexpected_id"] == 1


def test_frames_that_another_reader_left_come_before_those_of_the_next_cycle(tmp_path):
    with UnixBus(str(tmp_path)) as ours, UnixBus(str(tmp_path)) as theirs:
        daemon = Daemon(ours)
        daemon.heard()
        usual_cycle(daemon, theirs)
        at_once = [(0x123, b""), (DRIVE, bytes(7)), (DRIVE, bytes(7))]  # wrong lengths are counted
        theirs.send_frames(at_once)
        assert ours.recv(0).arbitration_id == 0x123
        usual_cycle(daemon, theirs)
        assert daemon.axis.counters["wrong_length"] == 2
        usual_cycle(daemon, theirs)


def test_a_filter_that_is_set_later_holds_by_the_door_too(tmp_path):
    with UnixBus(str(tmp_path)) as ours, UnixBus(str(tmp_path)) as theirs:
        daemon = Daemon(ours)
        daemon.heard()
        usual_cycle(daemon, theirs)
        ours.set_filters([{"can_id": 0x123, "can_mask": 0x7FF}])
        for can_id in (DRIVE, 0x123):
            theirs.send(plain_message(can_id, b""))
        daemon.heard()
        counters = daemon.axis.counters
        assert (counters["wrong_length"], counters["unexpected_id"]) == (0, 1)


def test_a_bus_that_is_left_brings_nothing_and_raises_nothing(tmp_path):
    with UnixBus(str(tmp_path)) as ours, UnixBus(str(tmp_path)) as theirs:
        daemon = Daemon(ours)
        daemon.heard()
        usual_cycle(daemon, theirs)
        ours.shutdown()
        assert daemon.heard()[SAMPLE.index("valid")] is False


def test_a_program_that_leaves_and_another_that_comes_are_no_broken_bus(tmp_path):
    with UnixBus(str(tmp_path)) as ours:
        with UnixBus(str(tmp_path)) as theirs:
            daemon = Daemon(ours)
            daemon.heard()
            usual_cycle(daemon, theirs)
        for _ in range(3):  # nobody is there
            daemon.heard()
        with UnixBus(str(tmp_path)) as again:
            for _ in range(2 * LOOK_EVERY):
                again.send(plain_message(0x123, b""))
                daemon.heard()
        assert daemon.axis.counters["unexpected_id"] == 2 * LOOK_EVERY
        assert daemon.axis.counters["unreadable"] == 0
