"""Servos on half-duplex serial lines: turns, watchdog, and how drive and adapter are set."""

from __future__ import annotations

import random
import struct

import pytest
from armed_actuators import ON_LINES, armed, at_1_khz, cycle, until
from framed_bench import FramedBench, edited, load
from rig_bench import MS, plant_config

from teleop_rt.axis import AxisError, AxisFault
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt_drivers import opening
from teleop_rt_drivers.actuators.dynamixel import packet as dynamixel_packet
from teleop_rt_drivers.actuators.feetech import packet as feetech_packet
from teleop_rt_drivers.actuators.survey import latency_timer, survey_lines
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.findings import worst
from teleop_rt_drivers.quantity import plausible_position


def patient(folder) -> FramedBench:
    """An armed Dynamixel that the daemon takes for lost only long after its own watchdog."""
    longer = ("      watchdog_ms: 60\n", "      watchdog_ms: 60\n      timeout_ms: 400\n")
    rig = edited("dynamixel", folder, longer).model_copy(update={"rate_hz": 1000.0})
    bench = FramedBench(rig, plant=plant_config(start=0.0))
    bench.axis.configure()
    bench.axis.arm()
    until(bench, lambda sample: sample.enabled, 60)
    return bench


def test_a_dynamixel_stops_where_it_is_when_no_packet_comes_for_its_watchdog(tmp_path):
    bench = patient(tmp_path)
    drive, plant = bench.simulated.drive, bench.simulated.plant
    for k in range(100):
        cycle(bench, 1e-4 * k)
    assert plant.velocity > 0.05
    bench.silence(55)
    assert drive.enabled, "fed until now"
    bench.silence(40)
    assert not drive.enabled
    assert abs(plant.velocity) < 1e-3
    stood = plant.position
    until(bench, lambda sample: sample.fault is AxisFault.DRIVE_FAULT, 5)
    assert "bus watchdog" in bench.sample.complaint
    for _ in range(50):
        cycle(bench, 0.02)
    assert plant.position == pytest.approx(stood, abs=1e-4), "goals are refused until it is reset"


def test_a_dynamixel_is_armed_again_after_its_watchdog(tmp_path):
    bench = patient(tmp_path)
    bench.silence(100)
    until(bench, lambda sample: sample.fault is AxisFault.DRIVE_FAULT, 5)
    bench.silence(2)
    bench.axis.configure()
    bench.axis.arm()
    until(bench, lambda sample: sample.enabled, 60)


def test_a_servo_without_watchdog_goes_on_and_the_rig_must_say_that_it_knows(tmp_path):
    bench = armed("feetech")
    bench.silence(1000)
    assert bench.simulated.drive.powered
    both = "unsafe_i_know: [watchdog, position_comparison]"
    words = (both, "unsafe_i_know: [position_comparison]")
    with pytest.raises(ConfigError, match="watchdog"):
        edited("feetech", tmp_path, words)
    declared = ("      position: from drive", "      watchdog_ms: 60\n      position: from drive")
    with pytest.raises(ConfigError, match="no time-out for commands"):
        edited("feetech", tmp_path, declared)


@pytest.mark.parametrize("kind", ON_LINES)
def test_a_second_master_on_the_line_is_found(kind):
    bench = armed(kind)
    device_end = bench.ends.line_pair("drive")[1]
    other = {
        "dynamixel": dynamixel_packet(0xFE, 0x83, struct.pack("<HHBi", 116, 4, 1, 400)),
        "feetech": feetech_packet(0xFE, 0x83, struct.pack("<BBBH", 42, 2, 1, 400)),
    }
    device_end.write(other[kind])
    assert cycle(bench).fault is AxisFault.FOREIGN_MASTER


@pytest.mark.parametrize("kind", ON_LINES)
def test_a_reset_servo_is_found_and_not_given_power_again(kind):
    bench = armed(kind)
    for _ in range(50):
        cycle(bench, 0.01)
    bench.simulated.inject("reset", "drive")
    until(bench, lambda sample: sample.fault is AxisFault.DRIVE_FAULT, 5)
    for _ in range(50):
        cycle(bench, 0.01)
    assert not bench.simulated.drive.powered


@pytest.mark.parametrize("kind", ON_LINES)
def test_mutated_packets_raise_nothing_and_no_position_is_out_of_range_or_jumps(kind):
    rng = random.Random(5)  # noqa: S311 - reproducible
    rig = at_1_khz(kind)
    bounds, compared, refused = plausible_position(rig), 0, 0
    for _ in range(4):
        bench = armed(kind)
        device_end = bench.ends.line_pair("drive")[1]
        write = device_end.write

        def spoil(data: bytes, write=write) -> bool:
            spoilt = bytearray(data)
            if rng.random() < 0.5:
                for _ in range(rng.randint(1, 4)):
                    spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
            return write(bytes(spoilt))

        device_end.write = spoil
        last, stamp = bench.sample.position, bench.sample.position_stamp_ns
        for k in range(200):
            sample = cycle(bench, 4e-5 * k)
            if sample.position_stamp_ns > stamp:
                elapsed_s = (sample.position_stamp_ns - stamp) * 1e-9
                assert bounds.lower <= sample.position <= bounds.upper
                assert abs(sample.position - last) <= bounds.slack + bounds.rate * elapsed_s + 1e-12
                last, stamp, compared = sample.position, sample.position_stamp_ns, compared + 1
            if sample.fault is not AxisFault.NONE:
                break
        refused += bench.sample.rejected
    assert compared > 60
    assert refused > 60


@pytest.mark.parametrize("kind", ON_LINES)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("rate_hz: 500 ", "rate_hz: 1000 "), "of a cycle of 1 ms"),
        (("usb_latency_ms: 1 ", "usb_latency_ms: 16 "), "16 ms in the adapter"),
        (("return_delay_us: 0", "return_delay_us: 500"), "of a cycle of 2 ms"),
    ],
)
def test_check_refuses_a_rate_that_line_and_adapter_cannot_do(kind, change, words, tmp_path):
    found = [one for one in check_rig(edited(kind, tmp_path, change)) if "baud" in one.where]
    assert any(words in one.what for one in found)
    # Half a millisecond more is still possible at 3 Mbit/s.
    possible = kind == "dynamixel" and "return_delay" in change[0]
    assert worst(found) == ("ok" if possible else "error")


def surveyed(kind: str, change=lambda table: None):
    bench = FramedBench(load(kind))
    change(bench.simulated.drive._table)
    return survey_lines(load(kind), lambda *_: bench.ends.line_pair("drive")[0], lambda: bench.now)


@pytest.mark.parametrize("kind", ON_LINES)
def test_doctor_asks_the_servo_how_it_is_set(kind):
    found = surveyed(kind)
    assert worst(found) == "ok"
    assert any("answers after 0 us" in one.what for one in found)


def put(register: int, *content: int):
    return lambda table: table.__setitem__(slice(register, register + len(content)), bytes(content))


@pytest.mark.parametrize(
    ("kind", "change", "words"),
    [
        ("dynamixel", put(9, 250), "answers after 500 us, return_delay_us is 0"),
        ("dynamixel", put(6, 37), "firmware 37"),
        ("dynamixel", put(38, 0, 1), "Current Limit is 256, the rig asks for 1115"),
        ("dynamixel", put(44, 100, 0), "Velocity Limit is 100, the rig asks for 524"),
        ("dynamixel", put(68, 0), "servo 1 on /tmp/teleop-rt-ports/servo does not answer"),
        ("feetech", put(7, 250), "answers after 500 us"),
        ("feetech", put(33, 1), "mode 1"),
        ("feetech", put(18, 0x04), "one turn"),
        ("feetech", put(18, 0x10), "0.732 rpm"),
        ("feetech", put(11, 0xFF, 0x0F), "one turn"),
    ],
)
def test_doctor_names_what_is_set_wrong_in_the_servo(kind, change, words):
    found = surveyed(kind, change)
    (wrong,) = (one for one in found if one.severity == "error")
    assert words in wrong.what
    assert wrong.next_step


@pytest.mark.parametrize(
    ("timer", "severity", "words"),
    [
        ("16\n", "error", "for 16 ms, usb_latency_ms is 1"),
        ("1\n", "ok", "for 1 ms"),
        (None, "ok", "shows no latency timer"),
    ],
)
def test_doctor_compares_the_adapter_s_latency_timer(timer, severity, words, tmp_path):
    port = tmp_path / "ttyUSB7"
    port.touch()
    by_id = tmp_path / "usb-FTDI-if00"
    by_id.symlink_to(port)
    if timer is not None:
        (tmp_path / "sys" / "ttyUSB7").mkdir(parents=True)
        (tmp_path / "sys" / "ttyUSB7" / "latency_timer").write_text(timer)
    found = latency_timer(str(by_id), 1.0, tmp_path / "sys")
    assert found.severity == severity
    assert words in found.what


def test_a_port_that_is_not_there_is_named():
    with pytest.raises(AxisError, match="cannot open the serial port /tmp/teleop-rt-ports/servo"):
        opening.open_axis(load("dynamixel"), lambda: 0).configure()


@pytest.mark.parametrize("kind", ON_LINES)
def test_a_damaged_position_that_its_checksum_does_not_show_is_not_where_the_servo_stops(kind):
    bench = armed(kind)
    for k in range(100):
        cycle(bench, 1e-4 * k)
    at = bench.simulated.plant.position
    bench.simulated.inject("swapped_bytes", "drive")
    for _ in range(150):
        bench.now += MS
        bench.axis.read_into(bench.sample)
        bench.axis.stop()
        assert abs(bench.simulated.plant.position - at) < 4e-3
    assert not bench.simulated.drive.powered
