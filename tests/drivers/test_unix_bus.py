"""The bus between processes of one machine: who comes, who goes, and who does not listen."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import can
import pytest

from teleop_rt_drivers import bus_folder, can_frames, unix_bus
from teleop_rt_drivers.bus_folder import folder_of
from teleop_rt_drivers.can_frames import REMOTE, UNREADABLE, CanFrame, one_by_one, plain_message
from teleop_rt_drivers.unix_bus import UnixBus

ROOT = Path(__file__).parents[2]
JOINING = """
import sys, time
from teleop_rt_drivers import bus_folder, can_frames, unix_bus
from teleop_rt_drivers.can_frames import UNREADABLE, CanFrame, one_by_one
from teleop_rt_drivers.bus_folder import folder_of
from teleop_rt_drivers.unix_bus import UnixBus
bus = UnixBus(sys.argv[1])
print("joined", flush=True)
time.sleep(60)
"""


@pytest.fixture
def channel(tmp_path):
    return str(tmp_path / "bus")


class Clocks:
    """The machine's clocks as a bus reads them: time passes on both, and the wall's can be set."""

    def __init__(self) -> None:
        self._now_ns, self._wall_ns = 10**12, 1_700_000_000 * 10**9

    def monotonic_ns(self) -> int:
        return self._now_ns

    def monotonic(self) -> float:
        return self._now_ns * 1e-9

    def time_ns(self) -> int:
        return self._wall_ns

    def pass_ns(self, duration_ns: int) -> None:
        self._now_ns += duration_ns
        self._wall_ns += duration_ns

    def set_ns(self, change_ns: int) -> None:
        self._wall_ns += change_ns


@pytest.fixture
def clocks(monkeypatch):
    made = Clocks()
    monkeypatch.setattr(unix_bus, "time", made)
    monkeypatch.setattr(can_frames, "time", made)
    return made


def frame(cob_id: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=cob_id, is_extended_id=False, data=data)


def ids(bus: UnixBus) -> list[int]:
    found = []
    while (message := bus.recv(0)) is not None:
        found.append(message.arbitration_id)
    return found


@pytest.mark.parametrize(
    "sent",
    [
        frame(0x181, b"12345678"),
        frame(0x000),
        can.Message(arbitration_id=0x1ABCDEF0, is_extended_id=True, data=b"abc"),
        can.Message(arbitration_id=0x701, is_extended_id=False, is_remote_frame=True, dlc=1),
        can.Message(arbitration_id=0x40, is_extended_id=False, is_error_frame=True, data=bytes(8)),
    ],
)
def test_a_frame_arrives_as_it_was_sent_with_the_time_of_sending(channel, sent, clocks):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs:
        assert ours.recv(0) is None
        sent_s = clocks.time_ns() * 1e-9
        ours.send(sent)
        clocks.pass_ns(2_000_000)
        heard = theirs.recv(1.0)
        assert heard is not None
        assert heard.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)
        assert heard.timestamp == pytest.approx(sent_s, abs=1e-6)
        assert ours.recv(0) is None


@pytest.mark.parametrize(
    ("can_id", "data"), [(0x181, b"12345678"), (0x080, b""), (REMOTE | 0x701, b"")]
)
def test_a_single_frame_is_heard_as_one_of_several_and_as_the_library_s_own(channel, can_id, data):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs:
        ours.send_frame(can_id, data)
        ours.send_frames([(can_id, data), (can_id, data)])
        ours.send(plain_message(can_id, data))
        single, *others = [(one, bytes(held)) for one, held, _ in theirs.waiting_frames(64)]
        assert single[0] == can_id
        assert others == [single] * 3


def test_who_comes_later_hears_and_is_heard_and_who_leaves_is_not_missed(channel):
    with UnixBus(channel) as first, UnixBus(channel) as second:
        first.send(frame(1))
        third = UnixBus(channel)
        assert ids(first) == []
        assert ids(second) == [1]
        for bus, cob_id in ((first, 2), (second, 3), (third, 4)):
            bus.send(frame(cob_id))
        assert ids(first) == [3, 4]
        assert ids(second) == [2, 4]
        assert ids(third) == [2, 3]
        third.send(frame(5))
        third.shutdown()
        first.send(frame(6))
        assert ids(second) == [5, 6]
        assert ids(first) == [5]
        assert first.lost == second.lost == 0


def test_frames_of_several_programs_are_heard_in_the_order_in_which_they_were_sent(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs, UnixBus(channel) as listening:
        assert ids(ours) == ids(theirs) == []
        for cob_id in range(0, 100, 2):
            theirs.send(frame(cob_id))
            ours.send(frame(cob_id + 1))
        assert ids(listening) == list(range(100))


@pytest.mark.parametrize("set_s", [3600, -3600])
def test_a_wall_clock_that_is_set_makes_no_frame_older_and_changes_no_order(channel, clocks, set_s):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs, UnixBus(channel) as listening:
        assert ids(ours) == ids(theirs) == []
        for cob_id, sender in enumerate((ours, theirs)):
            sender.send(frame(cob_id))
            clocks.pass_ns(1_000_000)
            clocks.set_ns(set_s * 10**9)
        for cob_id, age_s in ((0, 0.002), (1, 0.001)):
            heard = listening.recv(0)
            assert heard is not None
            assert heard.arbitration_id == cob_id
            assert clocks.time_ns() * 1e-9 - heard.timestamp == pytest.approx(age_s, abs=1e-6)


def test_a_program_that_was_killed_leaves_a_socket_that_the_next_one_removes(channel):
    command = [sys.executable, "-c", JOINING, channel]
    with (
        UnixBus(channel) as ours,
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as killed,
    ):
        assert killed.stdout is not None
        assert killed.stdout.readline() == "joined\n"
        assert ours.recv(0) is None
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        assert len(list(Path(channel).iterdir())) == 2
        ours.send(frame(1))
        with UnixBus(channel) as theirs:
            assert len(list(Path(channel).iterdir())) == 2
            assert ours.recv(0) is None
            ours.send(frame(2))
            assert ids(theirs) == [2]
    assert not Path(channel).exists()


@pytest.fixture
def killed():
    """The id of a process that has ended."""
    with subprocess.Popen(["/bin/true"]) as process:
        process.wait()
    return process.pid


def test_the_next_program_on_any_named_bus_sweeps_what_killed_ones_left(
    tmp_path, monkeypatch, killed
):
    monkeypatch.setattr(bus_folder, "shared_folder", lambda: tmp_path)
    abandoned, half = folder_of("abandoned"), folder_of("half")
    for place in (abandoned, half):
        place.mkdir()
        (place / f"{killed}-ab.can").touch()
    with UnixBus("half") as ours:
        assert ids(ours) == []
        (half / f"{killed}-cd.can").touch()
        with UnixBus("another"):
            assert not abandoned.exists()
            assert [path.name.partition("-")[0] for path in half.iterdir()] == [str(os.getpid())]
            with UnixBus("half") as theirs:
                theirs.send(frame(7))
                assert ids(ours) == [7]
    assert not list(tmp_path.iterdir())


def test_a_bus_that_the_last_program_removes_meanwhile_is_made_anew(channel, monkeypatch):
    opened = bus_folder._open

    def removed_before_it_was_locked(place):
        folder = opened(place)
        monkeypatch.setattr(bus_folder, "_open", opened)
        place.rmdir()
        return folder

    monkeypatch.setattr(bus_folder, "_open", removed_before_it_was_locked)
    with UnixBus(channel) as ours, UnixBus(channel) as theirs:
        theirs.send(frame(1))
        assert ids(ours) == [1]


def test_who_does_not_listen_loses_frames_and_holds_nobody_up(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as deaf, UnixBus(channel) as theirs:
        assert ids(ours) == []
        count = 0
        while ours.lost < 10:
            ours.send(frame(count % 0x7FF))
            assert ids(theirs) == [count % 0x7FF]
            count += 1
        assert count > 100
        heard = ids(deaf)
        assert heard == [number % 0x7FF for number in range(count - 10)]
        ours.send(frame(0x123))
        assert ids(deaf) == [0x123]


def test_its_descriptor_is_readable_while_a_frame_waits(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs:
        assert ids(ours) == []
        assert select.select([theirs], [], [], 0)[0] == []
        ours.send(frame(1))
        assert select.select([theirs], [], [], 0)[0] == [theirs]
        assert ids(theirs) == [1]
        assert select.select([theirs], [], [], 0)[0] == []


def test_what_is_no_frame_is_refused_at_either_end_and_the_next_one_is_heard(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs:
        assert ids(ours) == []
        long = can.Message(arbitration_id=1, is_extended_id=False, is_fd=True, data=bytes(12))
        long.is_fd = False
        with pytest.raises(can.CanOperationError, match="12 bytes is not a CAN frame"):
            ours.send(long)
        ours._peers[0].send(b"not a frame")  # which `send` refuses
        ours.send(frame(2))
        with pytest.raises(can.CanOperationError, match="11 bytes is not a CAN frame"):
            theirs.recv(0)
        assert ids(theirs) == [2]


@pytest.mark.parametrize("size", [0, 8, 48, 64])
@pytest.mark.parametrize("switch", [False, True])
def test_a_wide_frame_arrives_as_it_was_sent(channel, size, switch):
    sent = can.Message(
        arbitration_id=0x8001, is_extended_id=True, is_fd=True, bitrate_switch=switch,
        data=bytes(range(size)),
    )  # fmt: skip
    with UnixBus(channel) as ours, UnixBus(channel) as theirs:
        assert ids(ours) == []
        ours.send(sent)
        heard = theirs.recv(1.0)
    assert heard is not None
    assert heard.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)


def test_a_frame_of_socketcan_without_a_stamp_is_understood(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs:
        assert ids(ours) == []
        ours._peers[0].send(b"\x81\x01\0\0\x03\0\0\0abc\0\0\0\0\0")
        heard = theirs.recv(0)
        assert heard is not None
        assert (heard.arbitration_id, bytes(heard.data)) == (0x181, b"abc")


def test_filters_hold(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs:
        assert ids(ours) == []
        theirs.set_filters([{"can_id": 0x181, "can_mask": 0x7FF, "extended": False}])
        for cob_id in (0x180, 0x181, 0x182):
            ours.send(frame(cob_id))
        assert ids(theirs) == [0x181]


def test_python_can_finds_it_by_its_entry_point():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    module, _, name = project["entry-points"]["can.interface"]["unix"].partition(":")
    assert getattr(import_module(module), name) is UnixBus


SENT = (
    frame(0x181, b"12345678"),
    frame(0x000),
    frame(0x7FF, b"abc"),
    can.Message(arbitration_id=0x1ABCDEF0, is_extended_id=True, data=b"abc"),
    can.Message(arbitration_id=0x701, is_extended_id=False, is_remote_frame=True, dlc=1),
    can.Message(arbitration_id=0x40, is_extended_id=False, is_error_frame=True, data=bytes(8)),
    can.Message(arbitration_id=5, is_extended_id=False, is_fd=True, data=bytes(range(48))),
)


def plain(frames: list[CanFrame]) -> list[tuple[int, bytes]]:
    return [(can_id, bytes(data)) for can_id, data, _ in frames if not can_id & can_frames.REMOTE]


def test_all_that_waits_is_what_comes_one_by_one(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs, UnixBus(channel) as listening:
        assert ids(ours) == ids(theirs) == []
        read = []
        for taking in (listening.waiting_frames, lambda most: one_by_one(listening, most)):
            for sent in SENT:
                ours.send(sent)
                theirs.send(sent)
            ours._peers[1].send(b"not a frame")
            ours._peers[1].send(b"\x81\x01\0\0\x03\0\0\0abc\0\0\0\0\0")
            read.append(taking(256))
        at_once, each = read
        assert sorted(plain(at_once)) == sorted(plain(each))
        assert [one[0] for one in at_once].count(UNREADABLE) == 1
        assert len(at_once) == len(each) == 2 * len(SENT) + 2


def test_all_that_waits_comes_in_the_order_of_sending_and_no_more_than_asked_for(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs, UnixBus(channel) as listening:
        assert ids(ours) == ids(theirs) == []
        for cob_id in range(0, 400, 2):
            theirs.send(frame(cob_id))
            ours.send(frame(cob_id + 1))
        first = listening.waiting_frames(256)
        assert [one[0] for one in first] == sorted(one[0] for one in first)
        assert 128 <= len(first) <= 256
        rest = listening.waiting_frames(256)
        assert sorted(one[0] for one in (*first, *rest)) == list(range(400))
        assert listening.waiting_frames(256) == []


def test_who_leaves_is_heard_to_the_end_and_who_comes_is_met_while_others_talk(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as talking:
        assert ids(ours) == []
        theirs = UnixBus(channel)
        heard = []
        for _ in range(20):
            talking.send(frame(1))
            heard += ours.waiting_frames(256)
        ours.send(frame(2))
        assert ids(theirs)[-1] == 2
        theirs.send(frame(3))
        theirs.shutdown()
        assert [one[0] for one in ours.waiting_frames(256)] == [3]
        assert len(ours._peers) == 1  # who left would show only as memory and time
        assert len(heard) == 20


def test_classic_frames_alone_are_what_comes_one_by_one(channel):
    with UnixBus(channel) as ours, UnixBus(channel) as theirs:
        assert ids(ours) == []
        read = []
        for taking in (theirs.waiting_frames, lambda most: one_by_one(theirs, most)):
            for length in range(9):
                ours.send(frame(0x180 + length, bytes(range(length))))
            read.append(plain(taking(256)))
        assert read[0] == read[1]
        assert read[0] == [(0x180 + n, bytes(range(n))) for n in range(9)]


def test_frames_that_wait_are_not_taken_for_a_program_that_comes(channel, monkeypatch):
    with UnixBus(channel) as ours, UnixBus(channel) as talking:
        assert ids(ours) == []
        talking.send(frame(1))
        with monkeypatch.context() as alone:
            alone.setattr(ours, "_meet", lambda: pytest.fail("that takes longer than the cycle"))
            for _ in range(20):
                assert ours.is_plain()
            for _ in range(20):
                talking.send(frame(2))
                assert ours.waiting_frames(256)
        with UnixBus(channel):
            for _ in range(20):
                plain_still = ours.is_plain()
            assert not plain_still
