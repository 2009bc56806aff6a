"""The raw bus beside a trial, and the same decoding on it afterwards."""

from __future__ import annotations

import socket
from itertools import pairwise
from pathlib import Path

import can
import pytest
from framed_bench import FramedBench, load
from rig_bench import MS, path

from teleop_rt.axis import AxisError, EndOfRecording, Sample
from teleop_rt_drivers import opening
from teleop_rt_drivers.bus import BusConfig, open_bus
from teleop_rt_drivers.bus_log import logging_processes
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.findings import worst


def on_bus(kind, **changes):
    """The rig with other keys in its bus section."""
    rig = load(kind)
    bus = rig.axis.bus.model_copy(update=changes)
    return rig.model_copy(update={"axis": rig.axis.model_copy(update={"bus": bus})})


def logged_run(kind, tmp_path, suffix):
    """Follow the path with the bus logged; return the samples seen from arming on."""
    bench = FramedBench(on_bus(kind, log=suffix), log_folder=tmp_path).armed()
    seen = []
    for k in range(300):
        sample = bench.cycle(path(k))
        seen.append((sample.valid, sample.position, sample.force, sample.position_stamp_ns))
    bench.axis.close()
    return seen


def replayed(kind, file):
    rig = on_bus(kind, interface="replay", channel=str(file))
    return opening.open_axis(rig, lambda: 5 * MS), rig


def play(axis, again):
    sample = Sample()
    while True:
        axis.read_into(sample)
        axis.write(0.0)
        assert sample.enabled
        again.append((sample.valid, sample.position, sample.force, sample.position_stamp_ns))


@pytest.mark.parametrize(
    ("kind", "suffix"), [("canopen", "asc"), ("canopen", "blf"), ("raw_can", "asc")]
)
def test_a_replayed_bus_gives_the_samples_of_the_run(kind, suffix, tmp_path):
    seen = logged_run(kind, tmp_path, suffix)
    axis, rig = replayed(kind, tmp_path / f"bus.{suffix}")
    assert worst(check_rig(rig)) != "error"
    axis.configure()
    axis.arm()
    again = []
    with pytest.raises(EndOfRecording, match="cycles of replay of"):
        play(axis, again)
    first = next(i for i in range(len(again)) if again[i][1:3] == seen[0][1:3])
    assert [s[:3] for s in again[first : first + 300]] == [s[:3] for s in seen]
    steps = {(b[3] - a[3]) for a, b in pairwise(again[first : first + 300])}
    assert all(abs(step - MS) < 2000 for step in steps)
    assert len({s[1] for s in seen}) > 200
    assert axis.counters["foreign_master" if kind == "canopen" else "unexpected_id"] == 0


def on_multicast(_: Path) -> BusConfig:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    return BusConfig(interface="udp_multicast", channel="239.74.163.2", port=port, log="asc")


def on_unix_sockets(folder: Path) -> BusConfig:
    return BusConfig(interface="unix", channel=str(folder / "bus"), log="asc")


@pytest.mark.parametrize("on", [on_multicast, on_unix_sockets])
def test_a_second_program_logs_what_daemon_and_devices_send(tmp_path, on):
    config = on(tmp_path)
    with (
        logging_processes({"": config}, tmp_path),
        open_bus(config) as daemon,
        open_bus(config) as device,
    ):
        for count in range(50):
            daemon.send(can.Message(arbitration_id=0x80, is_extended_id=False))
            data = bytes([count] * 8)
            device.send(can.Message(arbitration_id=0x290, is_extended_id=False, data=data))
    messages = list(can.LogReader(tmp_path / "bus.asc"))
    assert [m.arbitration_id for m in messages].count(0x80) == 50
    data = [bytes(m.data) for m in messages if m.arbitration_id == 0x290]
    assert data == [bytes([count] * 8) for count in range(50)]


def test_a_bus_that_cannot_be_heard_twice_is_refused_before_arming(tmp_path):
    config = BusConfig(interface="slcan", channel="/dev/nothing-here", log="asc")
    with (
        pytest.raises(AxisError, match=r"bus.log: .*use SocketCAN"),
        logging_processes({"": config}, tmp_path),
    ):
        pass


def test_a_log_that_is_missing_or_of_another_rig_is_refused(tmp_path):
    with pytest.raises(AxisError, match="no such file"):
        replayed("canopen", tmp_path / "none.asc")
    logged_run("raw_can", tmp_path, "asc")
    with pytest.raises(AxisError, match="no cycle of the daemon"):
        replayed("canopen", tmp_path / "bus.asc")
    (tmp_path / "broken.blf").write_bytes(b"no log at all")
    with pytest.raises(AxisError, match="cannot be read"):
        replayed("canopen", tmp_path / "broken.blf")
