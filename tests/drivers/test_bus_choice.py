"""Which bus: as python-can's users expect, from the rig, the environment, or can.conf."""

from __future__ import annotations

import errno
import itertools
import os
import re
import socket

import can
import pytest
from framed_bench import edited, load
from rig_bench import MS, START_NS, plant_config

from teleop_rt.axis import AxisError, Sample
from teleop_rt_drivers.bus import BusConfig, open_bus
from teleop_rt_drivers.opening import open_axis, open_rig


@pytest.fixture(autouse=True)
def no_config_of_this_machine(monkeypatch, tmp_path):
    for name in ("CAN_INTERFACE", "CAN_CHANNEL", "CAN_BITRATE", "CAN_CONFIG"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)


def hears(config: BusConfig, channel: str) -> bool:
    """Whether the bus that the config opens is python-can's virtual one on this channel."""
    with open_bus(config) as bus, can.Bus(interface="virtual", channel=channel) as other:
        other.send(can.Message(arbitration_id=0x123, is_extended_id=False))
        message = bus.recv(1.0)
        return message is not None and message.arbitration_id == 0x123


def test_the_environment_chooses_what_the_rig_leaves_out(monkeypatch):
    monkeypatch.setenv("CAN_INTERFACE", "virtual")
    monkeypatch.setenv("CAN_CHANNEL", "from-environment")
    assert hears(BusConfig(), "from-environment")
    assert hears(BusConfig(channel="from-rig"), "from-rig")


def test_can_conf_chooses_where_there_is_no_environment(tmp_path):
    (tmp_path / "can.conf").write_text("[default]\ninterface = virtual\nchannel = from-file\n")
    (tmp_path / ".can").write_text("[default]\ninterface = virtual\nchannel = from-file\n")
    assert hears(BusConfig(), "from-file")


def test_the_bit_rate_reaches_the_adapter(monkeypatch):
    seen = []
    bus = can.Bus(interface="virtual")
    monkeypatch.setattr(can, "Bus", lambda **options: seen.append(options) or bus)
    open_bus(BusConfig(interface="pcan", channel="PCAN_USBBUS1", bitrate=500_000))
    assert seen == [{"interface": "pcan", "channel": "PCAN_USBBUS1", "bitrate": 500_000}]
    monkeypatch.undo()
    monkeypatch.setenv("CAN_INTERFACE", "virtual")
    monkeypatch.setenv("CAN_CHANNEL", "x")
    monkeypatch.setenv("CAN_BITRATE", "250000")
    assert can.util.load_config()["bitrate"] == 250_000
    bus.shutdown()


@pytest.mark.parametrize(
    "config",
    [
        BusConfig(interface="virtual", channel="clock"),
        BusConfig(interface="udp_multicast", channel="239.74.163.9", port=41_999),
    ],
)
def test_a_wall_clock_that_is_set_back_holds_nobody_up(config, monkeypatch):
    an_hour_less_each_time = itertools.count(1e9, -3600.0)
    monkeypatch.setattr("can.bus.time", lambda: next(an_hour_less_each_time))
    waited = []

    def nothing(timeout):
        waited.append(timeout)
        assert len(waited) == 1, "it looks again, for an hour"
        return None, False

    with open_bus(config) as bus:
        monkeypatch.setattr(bus, "_recv_internal", nothing)
        assert bus.recv(0) is None
    assert waited == [0]


def test_what_a_filter_leaves_out_is_passed_over_until_the_time_is_over(monkeypatch):
    with (
        open_bus(BusConfig(interface="virtual", channel="filtered")) as bus,
        can.Bus(interface="virtual", channel="filtered") as other,
    ):
        bus.set_filters([{"can_id": 0x123, "can_mask": 0x7FF}])
        for can_id in (0x122, 0x123, 0x124):
            other.send(can.Message(arbitration_id=can_id, is_extended_id=False))
        frame = bus.recv(1.0)
        assert frame is not None
        assert frame.arbitration_id == 0x123
        assert bus.recv(0.001) is None


def test_without_any_choice_the_next_step_is_reported():
    with pytest.raises(AxisError, match=r"cannot open the bus default interface.*check interface"):
        open_bus(BusConfig())


def test_a_serial_line_adapter_that_is_not_there_is_named():
    with pytest.raises(AxisError, match=r"slcan /dev/nothing-here.*/dev/serial/by-id"):
        open_bus(BusConfig(interface="slcan", channel="/dev/nothing-here", bitrate=500_000))


def test_the_whole_rig_runs_on_a_bus_of_python_can_chosen_by_the_environment(monkeypatch):
    monkeypatch.setenv("CAN_INTERFACE", "virtual")
    monkeypatch.setenv("CAN_CHANNEL", "rig")
    rig = load("canopen")
    bus = BusConfig(bitrate=1_000_000)
    rig = rig.model_copy(update={"axis": rig.axis.model_copy(update={"bus": bus})})
    now = [START_NS]
    devices = open_rig(rig, plant_config(), lambda: now[0], 1)
    axis = open_axis(rig, lambda: now[0])
    daemon = axis._bus
    receive = daemon.recv

    def recv(timeout=None):
        devices.process()
        return receive(0)

    daemon.recv = recv
    devices.power_on()
    axis.configure()
    axis.arm()
    sample = Sample()
    for _ in range(30):
        now[0] += MS
        axis.read_into(sample)
        axis.write(0.0)
        devices.process()
    assert sample.valid
    assert sample.enabled
    axis.close()
    devices.close()


def test_a_folder_that_cannot_be_had_is_reported_with_the_next_step(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(AxisError, match=r"cannot open the bus unix .*folder that both may use"):
        open_bus(BusConfig(interface="unix", channel=str(tmp_path / "file")))


def test_a_port_held_by_another_program_is_said_to_be():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("", 0))
        config = BusConfig(
            interface="udp_multicast", channel="239.74.163.2", port=holder.getsockname()[1]
        )
        with pytest.raises(AxisError, match="another program holds this UDP port"):
            open_bus(config)


def test_a_channel_that_is_no_multicast_group_is_refused_with_the_next_step():
    config = BusConfig(interface="udp_multicast", channel="127.0.0.1", port=43210)
    with pytest.raises(AxisError, match="multicast group"):
        open_bus(config)


@pytest.mark.parametrize(
    ("number", "next_step", "useless"),
    [
        (errno.ENODEV, "ip link set can77 up type can bitrate 500000", "modprobe"),
        (errno.EAFNOSUPPORT, "this kernel has no SocketCAN: `modprobe can_raw`", "ip link"),
    ],
)
def test_a_missing_socketcan_interface_is_refused_with_the_next_step(
    monkeypatch, number, next_step, useless
):
    def refused(**_options):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("teleop_rt_drivers.bus.DirectSocketcanBus", refused)
    config = BusConfig(interface="socketcan", channel="can77", bitrate=500_000)
    with pytest.raises(AxisError, match=next_step) as raised:
        open_bus(config)
    assert useless not in str(raised.value)


def test_an_unknown_interface_is_refused():
    with pytest.raises(AxisError, match="nosuchbus"):
        open_bus(BusConfig(interface="nosuchbus", channel="x"))


@pytest.mark.parametrize(
    ("kind", "old", "new"),
    [
        ("canopen", "eds: encoder_cia406.eds", "eds: none.eds"),
        ("raw_can", "dbc: ", "dbc: none"),
        ("mixed", "format: wrench_crc16", "format: none"),
    ],
)
def test_an_axis_that_is_refused_leaves_no_bus_open(kind, old, new, tmp_path, monkeypatch):
    opened = []

    def noted(config):
        opened.append(can.Bus(interface="virtual", channel=config.channel))
        return opened[-1]

    monkeypatch.setattr("teleop_rt_drivers.ends.open_bus", noted)
    with pytest.raises(AxisError, match="none"):
        open_axis(edited(kind, tmp_path, (old, new)), lambda: 0)
    (bus,) = opened
    with pytest.raises(can.CanOperationError, match="closed"):
        bus.recv(0)


@pytest.mark.parametrize(
    ("interface", "channel", "words"),
    [
        ("gs_usb", "0", "pip install 'python-can[gs-usb]"),
        ("pcan", "PCAN_USBBUS1", "PCAN-Basic"),
    ],
)
def test_an_adapter_that_is_not_there_says_what_it_needs(interface, channel, words):
    config = BusConfig(interface=interface, channel=channel, bitrate=1_000_000)
    with pytest.raises(AxisError, match=re.escape(words)):
        open_bus(config)
