"""The buses between processes of one machine: an axis finds its devices on each of them."""

from __future__ import annotations

import socket
import time
from pathlib import Path

import can
import pytest
from live_rig import cycles_until, serving
from rig_bench import canopen_rig, changed

from teleop_rt.axis import AxisError, AxisFault, Sample
from teleop_rt_drivers.bus import MulticastBus, open_bus
from teleop_rt_drivers.bus_folder import folder_of
from teleop_rt_drivers.opening import open_axis
from teleop_rt_drivers.registry import own_run

GROUP = "239.74.163.2"


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


def multicast_rig():
    bus = {"interface": "udp_multicast", "channel": GROUP, "port": free_port()}
    return changed(canopen_rig(), bus=bus)


@pytest.fixture(params=["unix", "udp_multicast"])
def rig(request, tmp_path):
    """A rig on a bus of its own."""
    if request.param == "unix":
        return changed(canopen_rig(), bus={"channel": str(tmp_path / "bus")})
    return multicast_rig()


def test_the_axis_configures_arms_and_stops_devices_of_another_program(rig):
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
    assert not Path(rig.axis.bus.channel).exists(), "the last one leaves nothing behind"


def test_without_devices_the_bus_and_the_node_are_named(rig):
    bus = rig.axis.bus
    daemon = rig.axis.daemon.model_copy(update={"answer_timeout_ms": 20, "attempts": 2})
    quick = rig.model_copy(update={"axis": rig.axis.model_copy(update={"daemon": daemon})})
    axis = open_axis(quick, time.monotonic_ns)
    with pytest.raises(AxisError, match=rf"node 0x10 \(encoder\) on {bus.interface} .*") as result:
        axis.configure()
    assert str(bus.channel) in str(result.value)
    axis.close()


def test_runs_of_their_own_get_channels_of_their_own():
    one, other = own_run(canopen_rig()), own_run(canopen_rig())
    assert one != other
    (change,) = one
    assert change.startswith("rig.axis.bus.channel=")
    assert folder_of("rig") != folder_of(change.partition("=")[2])


def test_two_runs_on_two_ports_do_not_hear_each_other():
    rig, other = multicast_rig(), multicast_rig()
    with open_bus(rig.axis.bus) as ours, open_bus(other.axis.bus) as theirs:
        theirs.send(can.Message(arbitration_id=0x000, is_extended_id=False, data=b"\x01\0"))
        ours.send(can.Message(arbitration_id=0x080, is_extended_id=False))
        assert ours.recv(0.05) is None


def test_own_frames_of_multicast_are_not_heard_and_others_frames_are():
    port = free_port()
    with MulticastBus(GROUP, port) as ours, MulticastBus(GROUP, port) as theirs:
        ours.send(can.Message(arbitration_id=0x80, is_extended_id=False))
        assert theirs.recv(1.0).arbitration_id == 0x80
        theirs.send(can.Message(arbitration_id=0x290, is_extended_id=False, data=b"12345678"))
        heard = ours.recv(1.0)
        assert heard.arbitration_id == 0x290
        assert bytes(heard.data) == b"12345678"
        assert ours.recv(0) is None


def test_a_datagram_that_is_no_frame_is_counted_and_the_cycle_goes_on():
    rig = multicast_rig()
    sample = Sample()
    with serving(rig), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        axis = open_axis(rig, time.monotonic_ns)
        axis.configure()
        stranger.sendto(b"not a frame", (GROUP, rig.axis.bus.port))
        assert cycles_until(axis, sample, lambda: axis.counters["unreadable"] == 1)
        assert cycles_until(axis, sample, lambda: sample.valid)
        axis.close()
