"""Not a number, in any field of any device: rejected, and the axis stops."""

from __future__ import annotations

import math
import struct
from itertools import product

import pytest
from framed_bench import FramedBench, load
from rig_bench import MS

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.config.supervision import SupervisionConfig
from teleop_rt.slave import hazards
from teleop_rt.slave.supervision import Supervision
from teleop_rt_drivers.actuators.codec import Frame, Report
from teleop_rt_drivers.actuators.moteus import FAULT, MODE, MoteusCodec
from teleop_rt_drivers.framed.axis import FramedAxis
from teleop_rt_drivers.framed.binary import FrameCounter
from teleop_rt_drivers.framed.config import FramedPart
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.framed.serial_port import SerialPort
from teleop_rt_drivers.framed.signal import Switch
from teleop_rt_drivers.framed.signal_config import SwitchSignal
from teleop_rt_drivers.framed.source import FieldInfo, Source

NAN = math.nan
KINDS = (
    "serial", "raw_can", "mixed", "odrive", "damiao", "robstride", "moteus", "vesc", "dynamixel",
    "feetech",
)  # fmt: skip
WITHIN_MS = 120
"""A drive without a valid frame is lost after 60 ms, and averages take longer."""


def framed(axis) -> list[FramedAxis]:
    parts = [part for _, part, _ in axis._parts] if hasattr(axis, "_parts") else [axis]
    return [part for part in parts if isinstance(part, FramedAxis)]


def used(part: FramedAxis) -> list[tuple[Source, str]]:
    """Every field that the axis looks at."""
    config: FramedPart = part._config
    sources = {name: source for port in part._ports for name, source in port.sources.items()}
    found = []
    for signal in config.signals.values():
        fields = [signal.field]
        fields += [] if signal.clock is None else [signal.clock.field]
        fields += [] if signal.status is None else [signal.status.field]
        found += [(sources[signal.source], field) for field in fields]
    if (drive := config.drive) is not None:
        answer = sources[drive.answer]
        names = {info.name for info in answer.fields}
        found += [(answer, field) for field in (drive.actual, drive.state)]
        found += [(answer, "torque")] if "torque" in names else []
    return list(dict.fromkeys(found))


def cases() -> list[tuple[str, int, str]]:
    """Return rig, place of the field and its name, for every field that any driver looks at."""
    found = []
    for kind in KINDS:
        fields = [each for part in framed(FramedBench(load(kind)).axis) for each in used(part)]
        found += [(kind, place, name) for place, (_, name) in enumerate(fields)]
    return found


class Judge:
    """The slave's judgement of a sample while the axis has power."""

    def __init__(self, rig) -> None:
        lacks = rig.axis.unsafe()
        self.supervision = Supervision(SupervisionConfig(), rig.limits, rig.rate_hz, lacks)
        self.patience = hazards.Patience.at(rig.rate_hz)

    def stops(self, sample: Sample) -> bool:
        """Whether the axis stops for it."""
        return (
            sample.fault is not AxisFault.NONE
            or sample.missing >= self.patience.stop
            or self.supervision.check(sample, sample.position, sample.position, follows=True)
            is not None
        )


@pytest.mark.parametrize("wrong", [NAN, math.inf, -math.inf], ids=["nan", "inf", "-inf"])
@pytest.mark.parametrize(("kind", "place", "name"), cases(), ids=str)
def test_no_number_in_a_field_that_is_looked_at_stops_the_axis(kind, place, name, wrong):
    rig = load(kind)
    bench = FramedBench(rig)
    bench.axis.configure()
    bench.axis.arm()
    bench.cycles(100)
    judge = Judge(rig)
    assert not any(judge.stops(bench.cycle()) for _ in range(30))
    assert bench.sample.enabled
    source, field = [each for part in framed(bench.axis) for each in used(part)][place]
    assert field == name
    deliver, slot = source.deliver, source.slot(field)

    def spoilt(values, now_ns):
        values = list(values)
        values[slot] = wrong
        deliver(values, now_ns)

    source.deliver = spoilt
    for part in framed(bench.axis):
        for port in part._ports:
            if isinstance(port, SerialPort) and port._binary is not None:
                # Kernels deliver nothing: test_whole_frames has those.
                port._binary._whole = port._binary.read = None
    stopped = False
    for _ in range(WITHIN_MS):
        sample = bench.cycle()
        assert math.isfinite(sample.position)
        assert math.isfinite(sample.force)
        stopped = stopped or judge.stops(sample)
    assert stopped


QUANTITIES = ("position", "command", "force", "drive_position", "drive_force")


@pytest.mark.parametrize("wrong", [NAN, math.inf, -math.inf, None], ids=str)
def test_only_where_all_that_is_compared_are_numbers_does_the_axis_go_on(wrong):
    for values in product((0.0, wrong), repeat=len(QUANTITIES)):
        given = dict(zip(QUANTITIES, values, strict=True))
        if None in (given["position"], given["command"], given["force"]):
            continue
        supervision = Supervision(SupervisionConfig(), load("mixed").limits, 1000)
        sample = Sample(enabled=True, drive_position=0.0, drive_force=0.0, position_stamp_ns=MS)
        found = []
        for tick in range(200):
            sample.position_stamp_ns += MS
            if tick == 50:
                assert found == [None] * 50
                sample.force = given["force"]
                sample.drive_position, sample.drive_force = (
                    given["drive_position"],
                    given["drive_force"],
                )
            position, command = given["position"], given["command"]
            at = (position, command) if tick >= 50 else (0.0, 0.0)
            found.append(supervision.check(sample, *at, follows=True))
        assert any(found) == any(value != 0.0 for value in values), given


def test_a_counter_and_a_switch_that_are_no_numbers_count_nothing_and_close_nothing():
    counters = FramedCounters()
    counter = FrameCounter(0, 256, counters)
    assert counter.accept([1.0])
    assert not counter.accept([NAN])
    assert counter.accept([2.0])
    assert counters["not_a_number"] == 1
    source = Source("inputs", (FieldInfo("bits", "1"),))
    for inverted in (False, True):
        switch = Switch(SwitchSignal(source="inputs", field="bits", inverted=inverted), source)
        source.deliver([NAN], 0)
        assert not switch.closed


def test_a_moteus_whose_fault_code_is_no_number_is_refused():
    answer = bytes((0x2C, 4, MODE)) + struct.pack("<4f", 10.0, 0.0, 0.0, 0.0)
    spoilt = answer + bytes((0x2D, FAULT)) + struct.pack("<f", NAN)
    report = Report()
    MoteusCodec(1, 1.0, 1.0, 0.05).take(
        Frame(0x100, spoilt.ljust(32, bytes((0x50,))), extended=True, fd=True), report
    )
    assert report.refusal == "not_a_number"
