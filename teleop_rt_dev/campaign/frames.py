"""Mutated frames at every maker's drive: each is refused, or a value within range and jump limits.

    teleop-rt-dev campaign frames [--count N] [--seed N] [--drives NAME...]

Real answers of a simulated drive that moves are damaged: bits flipped, bytes exchanged, cut, put in
or replaced, ids changed. Each is followed by a whole one. Where a protocol has a checksum half of
the damage is such that it must be found (three bits by a CRC of 16, one byte by a sum), and
accepted frames of the rest are counted. Prints one JSON object per drive; exits with 1 for a value
that cannot be.
"""

from __future__ import annotations

import argparse
import json
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.config.loader import load_trial
from teleop_rt_dev.paths import CONFIG
from teleop_rt_dev.trial.files import plant_of
from teleop_rt_drivers import opening, registry
from teleop_rt_drivers.actuators.codec import Frame, Report, Taken
from teleop_rt_drivers.can_frames import EXTENDED, LONGEST
from teleop_rt_drivers.quantity import plausible_position

ON_CAN = ("odrive", "damiao", "robstride", "moteus", "vesc")
ON_LINES = ("dynamixel", "feetech")
PERIOD_NS = 1_000_000  # of the shipped rigs: 1 kHz
CYCLES = 400  # before the attack; the answers of the second half, in steady motion, are kept
FD_SIZES = (*range(9), 12, 16, 20, 24, 32, 48, 64)
STANDARD_BITS, EXTENDED_BITS = 11, 29


@dataclass
class Count:
    """Numbers of damaged frames of one drive: sent, accepted, and rejected by cause."""

    drive: str
    frames: int = 0
    values: int = 0
    accepted: int = 0
    accepted_detectable: int = 0
    impossible: int = 0
    counted: dict[str, int] = field(default_factory=dict)


class Victim:
    """The daemon's side of one drive, which is moving; `answers` are those of its simulation."""

    def __init__(self, drive: str) -> None:
        self.now_ns = 10**12
        trial = load_trial(
            CONFIG / "trials" / "silicone_cube.yaml", registry.AXIS_SCHEMAS,
            registry.PLANT_SCHEMAS, [f"rig=../rigs/simulated_{drive}.yaml"],
        )  # fmt: skip
        rig: Any = trial.rig
        whole: Any = opening.open_lock_step(rig, plant_of(trial), lambda: self.now_ns, 1)[0]
        whole.configure()
        whole.arm()
        self.axis = whole._parts[0][1]
        self.port = self.axis._ports[0]
        self.wire = self.port.wire
        self.signal = self.axis._position
        self.bounds = plausible_position(rig)
        self.answers: list[Any] = []
        self._note(whole)

    def _note(self, whole: Any) -> None:
        """Let the drive move, and keep its answers."""
        sample, on_can = Sample(), not hasattr(self.wire, "_stream")
        handed = self.wire.take if on_can else self.wire._stream.read

        def note(*given: Any) -> Any:
            if on_can:
                self.answers.append(given[:2])
                return handed(*given)
            data = handed()
            if data:
                self.answers.append(data)
            return data

        if on_can:
            self.wire.take = note
        else:
            self.wire._stream.read = note
        for k in range(CYCLES):
            self.now_ns += 2 * PERIOD_NS
            whole.read_into(sample)
            whole.write(0.005 * (1 - np.cos(2 * np.pi * 6e-3 * max(0, k - 100))))
        if on_can:
            del self.wire.take
        assert sample.enabled
        self.answers = self.answers[CYCLES // 2 :]

    def settle(self) -> bool:
        """Take over a value as a cycle does; return whether there is a new one."""
        self.wire.fault = AxisFault.NONE
        taken: bool = self.signal.settle(self.now_ns)
        return taken

    def stands(self, before: float, before_ns: int) -> bool:
        """Return whether the signal's value can be true after the one before."""
        signal, bounds = self.signal, self.bounds
        reach = bounds.slack + bounds.rate * (signal.stamp_ns - before_ns) * 1e-9
        inside: bool = bounds.lower <= signal.value <= bounds.upper
        return inside and abs(signal.value - before) <= reach + 1e-12


def mutated(can_id: int, data: bytes, rng: random.Random) -> tuple[int, bytes]:
    """Return id and data of a frame with one to four damages."""
    bits = EXTENDED_BITS if can_id & EXTENDED else STANDARD_BITS
    found, wide = bytearray(data), len(data) > LONGEST
    for _ in range(rng.randint(1, 4)):
        kind = rng.random()
        if kind < 0.15:
            can_id ^= 1 << rng.randrange(bits)
        elif kind < 0.3:
            del found[rng.randrange(len(found) + 1) :]
        elif kind < 0.4 and found:
            found[rng.randrange(len(found))] = rng.choice((0, 0xFF, 0x7F, 0x80))
        elif kind < 0.5 and len(found) > 1:
            at = rng.randrange(len(found) - 1)
            found[at : at + 2] = found[at : at + 2][::-1]
        elif found:
            found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    size = max(n for n in FD_SIZES if n <= len(found))
    return can_id, bytes(found[: size if wide else LONGEST])


def on_can(drive: str, count: int, seed: int) -> Count:
    """Send damaged frames of a drive on a CAN bus."""
    victim, found = Victim(drive), Count(drive)
    rng = random.Random(f"{drive} {seed}")
    answers, signal, wire = victim.answers, victim.signal, victim.wire
    while found.frames < count:
        whole = answers[found.frames % len(answers)]
        for can_id, data in (mutated(whole[0], whole[1], rng), whole):
            victim.now_ns += PERIOD_NS // 2
            victim.port._asked_ns = victim.now_ns
            before, before_ns = signal.value, signal.stamp_ns
            wire.take(can_id, data, victim.now_ns)
            if victim.settle():
                found.values += 1
                found.impossible += not victim.stands(before, before_ns)
        found.frames += 1
    found.counted = {name: number for name, number in victim.axis.counters.items() if number}
    return found


class ReplayedStream:
    """A stream that returns the data given to it."""

    def __init__(self) -> None:
        self.data = b""
        self.kept: list[tuple[int, bytes]] = []
        self.arrived_ns = 0

    def read(self) -> bytes:
        """Return it, once."""
        data, self.data = self.data, b""
        return data


def spoilt(packet: bytes, rng: random.Random, *, bits: int) -> bytes:
    """Return the packet with up to `bits` bits flipped, or with one byte changed for 0."""
    changed = bytearray(packet)
    if bits:
        for place in rng.sample(range(8 * len(packet)), rng.randint(1, bits)):
            changed[place // 8] ^= 1 << place % 8
    else:
        changed[rng.randrange(len(packet))] ^= rng.randint(1, 255)
    return bytes(changed)


def damaged(packet: bytes, rng: random.Random) -> bytes:
    """Return the packet with damages of any kind and number."""
    changed = bytearray(packet)
    for _ in range(rng.randint(1, 5)):
        at, kind = rng.randrange(len(changed) + 1), rng.randrange(5)
        if kind == 0:
            changed[at:at] = rng.randbytes(rng.randint(1, 8))
        elif kind == 1:
            del changed[at : at + rng.randint(1, 8)]
        elif kind == 2:
            changed[at : at + 2] = changed[at : at + 2][::-1]
        elif at < len(changed):
            changed[at] ^= rng.randint(1, 255) if kind == 3 else 1 << rng.randrange(8)
    return bytes(changed)


def on_line(drive: str, count: int, seed: int) -> Count:
    """Send damaged packets of a servo on a serial line."""
    victim, found = Victim(drive), Count(drive)
    rng = random.Random(f"{drive} {seed}")
    answers, signal, wire = victim.answers, victim.signal, victim.wire
    wire._stream = stream = ReplayedStream()
    whole = set(answers)
    heard: list[bytes] = []
    codec = victim.port._codec
    take = codec.take

    def note(frame: Frame, report: Report) -> Taken:
        taken: Taken = take(frame, report)
        if taken in {Taken.MEASURED, Taken.STATE}:
            heard.append(frame.data)
        return taken

    codec.take = note
    while found.frames < count:
        packet = answers[found.frames % len(answers)]
        detectable = found.frames % 2 == 0
        bits = 3 if drive == "dynamixel" else 0
        bad = spoilt(packet, rng, bits=bits) if detectable else damaged(packet, rng)
        for data in (bad, packet):
            victim.now_ns += PERIOD_NS // 2
            before, before_ns = signal.value, signal.stamp_ns
            stream.data = data
            victim.port._asked_ns = victim.now_ns
            wire.drain(victim.now_ns)
            if victim.settle():
                found.values += 1
                found.impossible += not victim.stands(before, before_ns)
        wrong = sum(one not in whole for one in heard)
        heard.clear()
        found.accepted += wrong
        found.accepted_detectable += wrong if detectable else 0
        found.frames += 1
    found.counted = {name: number for name, number in victim.axis.counters.items() if number}
    return found


def attack(drive: str, count: int, seed: int) -> Count:
    """Send so many damaged frames to the daemon's side of a drive."""
    return (on_line if drive in ON_LINES else on_can)(drive, count, seed)


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign frames", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--count", type=int, default=1_000_000, help="damaged frames per drive")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drives", nargs="*", default=[*ON_CAN, *ON_LINES])
    options = parser.parse_args(arguments)
    harmed = 0
    for drive in options.drives:
        found = attack(drive, options.count, options.seed)
        harmed += found.impossible + found.accepted_detectable
        print(json.dumps(vars(found)), flush=True)
    return 1 if harmed else 0
