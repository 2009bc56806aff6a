from __future__ import annotations

import socket
import time

import can
import pytest
from live_rig import cycles_until, serving
from rig_bench import canopen_rig, changed

from teleop_rt.axis import AxisError, AxisFault, Sample
from teleop_rt_drivers.bus import BusConfig, MulticastBus, open_bus
from teleop_rt_drivers.registry import open_axis

GROUP = "239.74.163.2"


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def rig():
    bus = {"interface": "udp_multicast", "channel": GROUP, "port": free_port()}
    return changed(canopen_rig(), bus=bus)


@pytest.fixture
def port_of(rig):
    return rig.axis.bus.port


def test_the_axis_configures_arms_and_stops_real_processes_devices(rig):
    sample = Sample()
    with serving(rig) as simulated:
        axis = open_axis(rig, time.monotonic_ns)
        axis.configure()
        axis.arm()
        assert cycles_until(axis, sample, lambda: sample.enabled and sample.valid)
        assert sample.fault is AxisFault.NONE
        assert simulated.drive.enabled
        axis.stop()
        assert cycles_until(axis, sample, lambda: not simulated.drive.powered)
        axis.close()


def test_without_devices_the_bus_and_the_node_are_named(rig):
    daemon = rig.axis.daemon.model_copy(update={"answer_timeout_ms": 20, "attempts": 2})
    quick = rig.model_copy(update={"axis": rig.axis.model_copy(update={"daemon": daemon})})
    axis = open_axis(quick, time.monotonic_ns)
    with pytest.raises(
        AxisError, match=rf"node 0x10 \(encoder\) on udp_multicast .*:{rig.axis.bus.port}"
    ):
        axis.configure()
    axis.close()


def test_own_frames_are_not_heard_and_others_frames_are(port_of):
    with MulticastBus(GROUP, port_of) as ours, MulticastBus(GROUP, port_of) as theirs:
        ours.send(can.Message(arbitration_id=0x80, is_extended_id=False))
        assert theirs.recv(1.0).arbitration_id == 0x80
        theirs.send(can.Message(arbitration_id=0x290, is_extended_id=False, data=b"12345678"))
        heard = ours.recv(1.0)
        assert heard.arbitration_id == 0x290
        assert bytes(heard.data) == b"12345678"
        assert ours.recv(0) is None


def test_a_datagram_that_is_no_frame_is_counted_and_the_cycle_goes_on(rig, port_of):
    sample = Sample()
    with serving(rig), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        axis = open_axis(rig, time.monotonic_ns)
        axis.configure()
        stranger.sendto(b"not a frame", (GROUP, port_of))
        assert cycles_until(axis, sample, lambda: axis.counters["unreadable"] == 1)
        assert cycles_until(axis, sample, lambda: sample.valid)
        axis.close()


def test_two_runs_on_two_ports_do_not_hear_each_other(rig):
    other = changed(rig, bus={"port": free_port()})
    with open_bus(rig.axis.bus) as ours, open_bus(other.axis.bus) as theirs:
        theirs.send(can.Message(arbitration_id=0x000, is_extended_id=False, data=b"\x01\0"))
        ours.send(can.Message(arbitration_id=0x080, is_extended_id=False))
        assert ours.recv(0.05) is None


def test_a_port_held_by_another_program_is_said_to_be():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("", 0))
        config = BusConfig(interface="udp_multicast", channel=GROUP, port=holder.getsockname()[1])
        with pytest.raises(AxisError, match="another program holds this UDP port"):
            open_bus(config)


def test_a_channel_that_is_no_multicast_group_is_refused_with_the_next_step():
    config = BusConfig(interface="udp_multicast", channel="127.0.0.1", port=free_port())
    with pytest.raises(AxisError, match="multicast group"):
        open_bus(config)


def test_a_missing_socketcan_interface_is_refused_with_the_next_step():
    config = BusConfig(interface="socketcan", channel="can77", bitrate=500_000)
    with pytest.raises(AxisError, match="ip link set can77 up type can bitrate 500000"):
        open_bus(config)


def test_an_unknown_interface_is_refused():
    with pytest.raises(AxisError, match="nosuchbus"):
        open_bus(BusConfig(interface="nosuchbus", channel="x"))
