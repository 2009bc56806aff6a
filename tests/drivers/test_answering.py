"""Answers of a kernel in place of the simulated CANopen devices: they are those of the devices."""

from __future__ import annotations

import os
import socket
import struct
import time

import numpy as np
import pytest
from rig_bench import canopen_rig, changed, plant_config

from teleop_rt_drivers.can_door import LOOK_EVERY
from teleop_rt_drivers.can_frames import FRAME
from teleop_rt_drivers.opening import open_rig
from teleop_rt_drivers.simulated.faults import FaultyWire
from teleop_rt_drivers.unix_bus import UnixBus

ENCODER, FORCE, DRIVE, DAEMON = 0x10, 0x20, 0x30, 127
NMT, SYNC, COMMAND, HEARTBEAT, SDO = 0x000, 0x080, 0x230, 0x700, 0x600
UP = (0x06, 0x07, 0x0F)
PDOS = range(0x180, 0x580)
SLOWEST_NS = 40_000_000
"""A step that takes longer is no case: the devices take its frames for younger than they are."""


FAR_NS = 2**62
"""A time [ns] that does not come."""
PROCESS_DATA = 3
"""Frames that answer a SYNC."""


class TooSlowError(Exception):
    """The machine was busy with something else."""


class Side:
    """A simulated rig, and the frames that a daemon exchanges with it.

    `steps` says whether the rig follows a clock that the test moves, in which no kernel answers.
    """

    def __init__(self, channel: str, *, steps: bool, plant) -> None:
        self.now_ns = time.monotonic_ns()
        self._steps = steps
        clock = (lambda: self.now_ns) if steps else time.monotonic_ns
        rig = changed(canopen_rig(), bus={"channel": channel})
        self.rig = open_rig(rig, plant, clock, 5)
        self.end = UnixBus(channel)
        self.network = self.rig.networks[0]
        self.truths: list[list[float]] = []
        self.rig.on_truth = self.truths.append
        self.rig.on_truths = lambda rows: self.truths.extend(rows.tolist())
        self.network.serve_once(())  # meets the other end
        self.rig.power_on()
        self.heard()

    def heard(self) -> list[tuple[int, bytes]]:
        frames = self.end.waiting_frames(256)
        return [(name, bytes(data)) for name, data, _ in frames if name & 0x780 != HEARTBEAT]

    def step(self, stamp_ns: int, *frames: tuple[int, bytes]) -> list[tuple[int, bytes]]:
        """The answers to frames that were sent together, then."""
        self.now_ns = stamp_ns
        sent_ns = 0 if self._steps else stamp_ns
        packet = b"".join(FRAME.pack(name, len(data), data, sent_ns) for name, data in frames)
        os.write(self.end.door.door.descriptor, packet)
        self.network.serve_once(())
        if time.monotonic_ns() - stamp_ns > SLOWEST_NS:
            raise TooSlowError
        return self.heard()

    def close(self) -> None:
        self.end.shutdown()
        self.rig.close()


class Both:
    """Two rigs that get the same frames; all that they answer has to be equal."""

    def __init__(self, folder, **plant) -> None:
        config = plant_config(**plant)
        self.kernel = Side(str(folder / "kernel"), steps=False, plant=config)
        self.python = Side(str(folder / "python"), steps=True, plant=config)
        self.answers = 0
        self._random = np.random.default_rng(3)
        self._target = 0
        for node in (ENCODER, FORCE, DRIVE):
            self.step((NMT, bytes((1, node))))
        self.step((SDO + DRIVE, struct.pack("<BHBB3x", 0x2F, 0x6060, 0, 8)))

    def step(self, *frames: tuple[int, bytes]) -> None:
        stamp_ns = time.monotonic_ns()
        answers = self.kernel.step(stamp_ns, *frames)
        # The two plants began at different times, and the frames of this step come at one.
        assert answers == self.python.step(stamp_ns, *frames)
        self.answers += len(answers)

    def cycles(self, count: int, control: int, together: bool) -> None:
        """Cycles of a daemon whose target wanders."""
        for cycle in range(count):
            self._target += int(self._random.integers(-300, 500))
            command = COMMAND, struct.pack("<Hhi", control, 0, self._target)
            beat = [(HEARTBEAT + DAEMON, b"\x05")] if cycle % 10 == 9 else []
            if together:
                self.step((SYNC, b""), *beat, command)
            else:
                self.step((SYNC, b""))
                self.step(*beat, command)

    def inject(self, fault: str, device: str) -> None:
        for side in (self.kernel, self.python):
            side.rig.inject(fault, device)
            side.heard()

    def heal(self, device: str) -> None:
        for side in (self.kernel, self.python):
            side.rig.heal(device)

    def close(self) -> None:
        self.kernel.close()
        self.python.close()


def enabled_then_faults(both: Both, together: bool) -> None:
    for control in (0x00, *UP):
        both.cycles(15, control, together)
    both.cycles(100, 0x0F, together)
    both.step((SDO + DRIVE, struct.pack("<BHB4x", 0x40, 0x607A, 0)))  # reads the last target
    for fault, device in (("freeze", "encoder"), ("corrupt", "force sensor"), ("delay", "drive")):
        both.inject(fault, device)
        both.cycles(5, 0x0F, together)
        both.heal(device)
        both.cycles(5, 0x0F, together)
    both.inject("emergency", "force sensor")
    both.cycles(5, 0x0F, together)
    both.step((COMMAND, b"\x0f\x00"))  # too short: an emergency
    both.cycles(5, 0x0F, together)
    both.step((SDO + DRIVE, struct.pack("<BHBI", 0x23, 0x607F, 0, 10_000)))  # slower
    both.cycles(20, 0x0F, together)
    both.inject("over_temperature", "drive")
    both.cycles(10, 0x0F, together)
    for control in (0x80, *UP):
        both.cycles(5, control, together)
    both.step((NMT, bytes((0x80, ENCODER))))
    both.cycles(5, 0x0F, together)
    both.inject("reset", "drive")
    both.cycles(5, 0x0F, together)


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize(
    "undeclared", [(), ({"effect": "force_bias", "bias": 1.0},)], ids=["plain", "hidden"]
)
def test_the_kernel_answers_what_the_devices_answer(tmp_path, monkeypatch, together, undeclared):
    by_python: list[object] = []
    send = FaultyWire.send

    def noted(wire, can_id, data):
        if can_id in PDOS:
            by_python.append(wire)
        send(wire, can_id, data)

    monkeypatch.setattr(FaultyWire, "send", noted)
    for attempt in range(20):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        by_python.clear()
        both = Both(folder, undeclared=undeclared)
        try:
            enabled_then_faults(both, together)
        except TooSlowError:
            continue
        finally:
            both.close()
        break
    else:
        pytest.fail("the machine is too busy")
    assert both.answers > 700
    of_wires = [sum(one is wire for one in by_python) for wire in set(by_python)]
    assert len(of_wires) == 2
    assert min(of_wires) < 0.3 * max(of_wires), "a kernel answered most"
    assert both.kernel.truths == both.python.truths


@pytest.fixture
def operational(tmp_path):
    """A rig on the machine's clock whose devices do nothing but answer, and the daemon's end."""
    side = Side(str(tmp_path / "bus"), steps=False, plant=plant_config())
    side.end.send_frame(NMT, bytes((1, 0)))
    for _ in range(3):
        side.end.send_frame(COMMAND, bytes(8))
        side.end.send_frame(SYNC, b"")
        side.network.serve_once(())
    side.heard()
    side.truths.clear()
    yield side
    side.close()


def answered_until(side: Side, until_ns: int, *others: int) -> bool:
    return side.network.answer_until(until_ns, [*others, *side.network.descriptors()])


def ask(end: UnixBus, cycles: int, frames: int = PROCESS_DATA) -> int:
    """Ask for so many cycles, each after the frames that answer it; return how many came."""
    for cycle in range(cycles):
        end.send_frame(SYNC, b"")
        left = frames
        while left > 0:
            if not end._ready.poll(10.0):
                return cycle
            left -= sum(name in PDOS for name, _, _ in end.waiting_frames(64))
    return cycles


def test_cycle_after_cycle_is_answered_before_python_is_asked(operational):
    side, cycles, noted, ended = operational, 200, [], 0
    child = os.fork()
    if child == 0:
        os._exit(0 if ask(side.end, cycles) == cycles else 1)
    while not ended:
        before = len(side.truths)
        assert answered_until(side, time.monotonic_ns() + 20_000_000)
        noted.append(len(side.truths) - before)
        ended, status = os.waitpid(child, os.WNOHANG)
    assert os.waitstatus_to_exitcode(status) == 0
    assert len(side.truths) == cycles, "the motion at each SYNC is noted"
    assert max(noted) >= 10


def test_another_readable_line_ends_the_wait_before_anything_is_answered(operational):
    side = operational
    far, line = socket.socketpair()
    with far, line:
        far.send(b"frame")
        side.end.send_frame(SYNC, b"")
        assert answered_until(side, FAR_NS, line.fileno())
        assert side.heard() == []
        line.recv(100)
        assert answered_until(side, FAR_NS, line.fileno())
        assert len(side.heard()) == PROCESS_DATA


def test_a_program_that_comes_to_the_bus_ends_the_wait_and_is_met(operational, tmp_path):
    until_ns = time.monotonic_ns() + 60_000_000_000
    newcomer = UnixBus(str(tmp_path / "bus"))
    try:
        met = any(not answered_until(operational, until_ns) for _ in range(2 * LOOK_EVERY))
        assert met
        assert time.monotonic_ns() < until_ns
    finally:
        newcomer.shutdown()


def test_the_devices_hear_a_heartbeat_that_a_kernel_took(operational, monkeypatch):
    side, heard = operational, []
    drive = side.network.devices["drive"]
    monkeypatch.setattr(drive, "receive_heartbeat", lambda node, _: heard.append(node))
    side.end.send_frame(HEARTBEAT + DAEMON, b"\x05")
    assert answered_until(side, FAR_NS)
    assert heard == [DAEMON]


def test_a_kernel_sends_the_devices_heartbeats_and_they_go_on_where_it_was(
    operational, monkeypatch
):
    side, nodes = operational, (ENCODER, FORCE, DRIVE)
    for node in nodes:
        every_20_ms = struct.pack("<BHBH2x", 0x2B, 0x1017, 0, 20)
        side.end.send_frame(SDO + node, every_20_ms)
        side.network.serve_once(())
    for _ in range(2):  # a drive that was written to looks at the next command, too
        side.end.send_frame(COMMAND, bytes(8))
        side.end.send_frame(SYNC, b"")
        side.network.serve_once(())
    assert answered_until(side, FAR_NS)
    side.end.waiting_frames(256)
    sends = FaultyWire.send
    monkeypatch.setattr(FaultyWire, "send", lambda *_: pytest.fail("Python sends a heartbeat"))
    beats: dict[int, list[int]] = {HEARTBEAT + node: [] for node in nodes}

    def run(count: int) -> None:
        until_ns = time.monotonic_ns() + 10_000_000_000
        while min(map(len, beats.values())) < count:
            assert time.monotonic_ns() < until_ns, beats
            answered_until(side, FAR_NS)
            for name, data, stamp_ns in side.end.waiting_frames(256):
                assert data == b"\x05"
                beats[name].append(stamp_ns)

    run(4)
    now_ns = time.monotonic_ns()
    assert side.network.due_ns(now_ns) <= max(map(max, beats.values())) + 20_000_000
    for stamps in beats.values():
        assert min(np.diff(stamps)) > 0
        assert stamps[-1] - stamps[0] > (len(stamps) - 2) * 20 * 1_000_000
    monkeypatch.setattr(FaultyWire, "send", sends)
    side.rig.inject("mute_pdo", "encoder")
    assert not answered_until(side, FAR_NS), "no kernel sends for a broken device"
    for node in side.network.devices.values():
        assert node.quiet_until_ns == 0, "its timers are looked at"
        node.run_timers(max(map(max, beats.values())) + 20_000_000)
    assert {name for name, *_ in side.end.waiting_frames(256)} == set(beats)


def test_the_kernel_waits_for_the_socket_of_the_program_that_is_there(operational):
    door = operational.network._bus.door
    assert answered_until(operational, FAR_NS)
    first, second = operational.network._answering._polls.astype(np.int32)
    assert first == door.door.descriptor
    # Time: a wait for the bus's own descriptor ends as well, and takes longer.
    assert second == door.comers == operational.network._bus._listening.fileno()
