from __future__ import annotations

import select
import socket

import pytest

from teleop_rt.link.channel import Endpoint
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import MotionMessage, StateMessage
from teleop_rt.link.transport import LinkError, UdpTransport

KEYS = shared_key(bytes(range(32)))


class Clock:
    now = 10**12

    def __call__(self) -> int:
        return self.now


def wait_for(transport: UdpTransport) -> None:
    readable, _, _ = select.select([transport._socket], [], [], 5.0)
    assert readable


@pytest.fixture
def ends():
    clock = Clock()
    at_slave = UdpTransport()
    at_master = UdpTransport(peer=("127.0.0.1", at_slave.port))
    slave = Endpoint("slave", at_slave, KEYS, clock, rate_hz=1000)
    master = Endpoint("master", at_master, KEYS, clock, rate_hz=1000)
    master.poll()
    wait_for(at_slave)
    slave.poll()
    wait_for(at_master)
    master.poll()
    yield master, slave, at_master, at_slave
    master.close()
    slave.close()


def test_messages_pass_over_loopback_and_the_slave_learns_its_peer(ends) -> None:
    master, slave, at_master, at_slave = ends
    master.send(MotionMessage(0.5, 0.0, 0, engaged=True))
    wait_for(at_slave)
    slave.poll()
    assert slave.motion == MotionMessage(0.5, 0.0, 0, engaged=True)
    assert at_slave.peer == ("127.0.0.1", at_master.port)
    slave.send(StateMessage(0.25, 1.0, 0, in_contact=False))
    wait_for(at_master)
    master.poll()
    assert master.state == StateMessage(0.25, 1.0, 0, in_contact=False)


def test_a_foreign_sender_does_not_become_the_peer(ends) -> None:
    master, slave, at_master, at_slave = ends
    master.send(MotionMessage(0.5, 0.0, 0, engaged=True))
    wait_for(at_slave)
    slave.poll()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(b"TR\x01\x03" + bytes(60), ("127.0.0.1", at_slave.port))
        stranger.sendto(b"hello", ("127.0.0.1", at_slave.port))
        wait_for(at_slave)
        slave.poll()
    assert at_slave.peer == ("127.0.0.1", at_master.port)
    assert sum(slave.statistics.rejected.values()) == 2


def test_a_port_in_use_is_named_with_the_next_step() -> None:
    first = UdpTransport()
    with pytest.raises(LinkError, match=rf"127\.0\.0\.1:{first.port}.*another port"):
        UdpTransport(port=first.port)
    first.close()


def test_an_unreachable_peer_costs_packets_and_raises_nothing() -> None:
    transport = UdpTransport(peer=("255.255.255.255", 9))
    transport.send(b"packet")
    assert transport.unsent == 1
    assert transport.receive() is None
    transport.close()
    transport.send(b"packet")
    assert transport.receive() is None


def test_a_restarted_master_on_another_port_is_followed(ends) -> None:
    master, slave, at_master, at_slave = ends
    master.send(MotionMessage(0.5, 0.0, 0, engaged=True))
    wait_for(at_slave)
    slave.poll()
    moved = UdpTransport(peer=("127.0.0.1", at_slave.port))
    again = Endpoint("master", moved, KEYS, Clock(), rate_hz=1000)
    again.poll()
    wait_for(at_slave)
    slave.poll()
    assert at_slave.peer == ("127.0.0.1", at_master.port)
    wait_for(moved)
    again.poll()
    again.send(MotionMessage(0.75, 0.0, 0, engaged=True))
    wait_for(at_slave)
    slave.poll()
    assert slave.motion == MotionMessage(0.75, 0.0, 0, engaged=True)
    assert at_slave.peer == ("127.0.0.1", moved.port)
    again.close()
