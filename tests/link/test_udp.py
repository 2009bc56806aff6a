from __future__ import annotations

import select
import socket
from contextlib import closing

import numpy as np
import pytest

from teleop_rt.errors import FAULT
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import ModelMessage, MotionMessage, StateMessage
from teleop_rt.link.transport import LinkError, UdpTransport

KEYS = shared_key(bytes(range(32)))
MODEL = ModelMessage("kelvin-voigt", 1, 1, 0.0, k=1.0)


class Clock:
    now = 10**12

    def __call__(self) -> int:
        return self.now


def wait_for(transport: UdpTransport) -> None:
    readable, _, _ = select.select([transport.descriptor], [], [], 5.0)
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
    with pytest.raises(LinkError, match=r"in use; take another or an address of this machine$"):
        UdpTransport(port=first.port, if_taken="take another")
    first.close()


def test_a_peer_whose_name_is_unknown_is_an_error_at_the_start() -> None:
    with pytest.raises(LinkError, match=r"cannot resolve 'no-such-host.invalid'.*link.host") as one:
        UdpTransport(peer=("no-such-host.invalid", 38_220))
    assert one.value.code == FAULT, "systemd starts the service again: at boot names come late"
    with closing(UdpTransport(peer=("localhost", 38_220))) as transport:
        assert transport.peer == ("127.0.0.1", 38_220)
        assert np.any(transport.peer_name)


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


def led_once(master: Endpoint, slave: Endpoint, at_slave: UdpTransport) -> None:
    """Let the slave know its master's address, and take packets from there by kernels."""
    master.send(MotionMessage(0.125, 0.0, 0, engaged=True))
    wait_for(at_slave)
    slave.poll()


def test_one_expected_packet_is_all_that_a_poll_looks_at(ends, monkeypatch) -> None:
    master, slave, _, at_slave = ends
    led_once(master, slave, at_slave)
    monkeypatch.setattr(at_slave, "receive", lambda: pytest.fail("looked at by Python"))
    slave.poll()
    assert not slave.fresh_motion
    for target in (0.5, 0.75):
        master.send(MotionMessage(target, 0.0, 0, engaged=True))
        wait_for(at_slave)
        slave.poll()
        assert slave.fresh_motion
        assert slave.motion == MotionMessage(target, 0.0, 0, engaged=True)
    assert slave.statistics.received == 3


def test_a_packet_taken_ahead_is_as_old_as_it_is_and_the_next_poll_takes_what_follows(ends) -> None:
    master, slave, _, at_slave = ends
    led_once(master, slave, at_slave)
    clock = slave._now_ns
    master.send(MotionMessage(0.5, 0.0, 0, engaged=True))
    wait_for(at_slave)
    clock.now += 1000
    slave.take_ahead()
    assert slave.motion == MotionMessage(0.5, 0.0, 0, engaged=True)
    clock.now += 200
    slave.poll()
    assert slave.silence_ns(clock.now) == 200
    master.send(MotionMessage(0.75, 0.0, 0, engaged=True))
    wait_for(at_slave)
    slave.poll()
    assert slave.motion == MotionMessage(0.75, 0.0, 0, engaged=True)
    assert slave.statistics.received == 3


def test_several_packets_ahead_of_a_poll_are_left_for_it_and_none_is_lost(
    ends, monkeypatch
) -> None:
    master, slave, _, at_slave = ends
    led_once(master, slave, at_slave)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for target in (0.5, 0.75):
            master.send(MotionMessage(target, 0.0, 0, engaged=True))
            stranger.sendto(b"hello", ("127.0.0.1", at_slave.port))
    wait_for(at_slave)
    with monkeypatch.context() as ahead:
        ahead.setattr(at_slave, "receive", lambda: pytest.fail("a flood would delay the tick"))
        slave.take_ahead()
        slave.take_ahead()
    assert slave.motion == MotionMessage(0.125, 0.0, 0, engaged=True)
    slave.poll()
    assert slave.motion == MotionMessage(0.75, 0.0, 0, engaged=True)
    assert (slave.statistics.received, sum(slave.statistics.rejected.values())) == (3, 2)


def test_a_state_and_a_model_are_taken_ahead_and_the_next_poll_takes_what_follows(ends) -> None:
    master, slave, at_master, at_slave = ends
    led_once(master, slave, at_slave)
    states = [StateMessage(x, 1.0, 0, in_contact=False) for x in (0.25, 0.5, 0.75)]
    slave.send(states[0])
    wait_for(at_master)
    master.poll()
    slave.send(MODEL)
    slave.send(states[1])
    wait_for(at_master)
    master.take_ahead()
    assert (master.model, master.state) == (MODEL, states[1])
    slave.send(states[2])
    wait_for(at_master)
    master.poll()
    assert master.state == states[2]
    assert master.statistics.rejected == {}


def test_a_state_taken_ahead_is_fresh_in_the_next_poll_and_in_no_other(ends) -> None:
    master, slave, at_master, at_slave = ends
    led_once(master, slave, at_slave)
    for model in (None, MODEL, None):
        if model is not None:
            slave.send(model)
        slave.send(StateMessage(0.25, 1.0, 0, in_contact=False))
        wait_for(at_master)
        master.take_ahead()
        master.take_ahead()
        master.poll()
        assert master.fresh_state
        master.poll()
        assert not master.fresh_state
        master.take_ahead()
        master.poll()
        assert not master.fresh_state


def test_of_two_packets_a_strange_one_is_left_for_the_poll(ends) -> None:
    master, slave, _, at_slave = ends
    led_once(master, slave, at_slave)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        master.send(MotionMessage(0.5, 0.0, 0, engaged=True))
        stranger.sendto(b"hello", ("127.0.0.1", at_slave.port))
        wait_for(at_slave)
        slave.take_ahead()
        assert slave.motion == MotionMessage(0.5, 0.0, 0, engaged=True)
        assert slave.statistics.rejected == {}
        slave.poll()
    assert sum(slave.statistics.rejected.values()) == 1
    assert slave.motion == MotionMessage(0.5, 0.0, 0, engaged=True)


def test_nothing_is_taken_ahead_before_a_session_stands() -> None:
    at_slave = UdpTransport()
    slave = Endpoint("slave", at_slave, KEYS, Clock(), rate_hz=1000)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(b"hello", ("127.0.0.1", at_slave.port))
        wait_for(at_slave)
    slave.take_ahead()
    assert not slave.statistics.rejected
    slave.poll()
    assert sum(slave.statistics.rejected.values()) == 1
    slave.close()


def test_of_several_packets_in_a_poll_the_last_is_the_newest(ends) -> None:
    master, slave, at_master, at_slave = ends
    led_once(master, slave, at_slave)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for target in (0.5, 0.75, 0.25):
            master.send(MotionMessage(target, 0.0, 0, engaged=True))
            stranger.sendto(b"hello", ("127.0.0.1", at_slave.port))
        wait_for(at_slave)
        slave.poll()
    assert slave.motion == MotionMessage(0.25, 0.0, 0, engaged=True)
    assert at_slave.peer == ("127.0.0.1", at_master.port)
    assert (slave.statistics.received, sum(slave.statistics.rejected.values())) == (4, 3)


def test_a_stranger_whose_packet_was_dropped_does_not_become_the_peer(ends) -> None:
    master, slave, at_master, at_slave = ends
    led_once(master, slave, at_slave)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(b"hello", ("127.0.0.1", at_slave.port))
        wait_for(at_slave)
        slave.forget_waiting()
    led_once(master, slave, at_slave)
    assert slave.statistics.received == 2
    assert at_slave.peer == ("127.0.0.1", at_master.port)


def test_a_single_spoilt_or_repeated_packet_is_refused(ends) -> None:
    master, slave, at_master, at_slave = ends
    led_once(master, slave, at_slave)
    master.send(MotionMessage(0.5, 0.0, 0, engaged=True))
    wait_for(at_slave)
    sent = at_slave.receive()
    assert sent is not None
    assert at_slave.receive() is None
    wrong = bytearray(sent)
    wrong[-1] ^= 1
    for packet, target in ((bytes(wrong), 0.125), (sent, 0.5), (sent, 0.5)):
        at_master.send(packet)
        wait_for(at_slave)
        slave.poll()
        assert slave.motion == MotionMessage(target, 0.0, 0, engaged=True)
    found = {reason: count for reason, count in slave.statistics.rejected.items() if count}
    assert found == {"authentication": 1, "replay": 1}


def test_a_peer_that_is_known_by_name_gets_what_a_session_sends(ends) -> None:
    master, slave, at_master, at_slave = ends
    led_once(master, slave, at_slave)
    at_master.peer = ("localhost", at_slave.port)
    master.send(MotionMessage(0.5, 0.0, 0, engaged=True))
    wait_for(at_slave)
    slave.poll()
    assert slave.motion == MotionMessage(0.5, 0.0, 0, engaged=True)


def test_what_a_session_cannot_send_is_counted(ends) -> None:
    master, slave, at_master, at_slave = ends
    led_once(master, slave, at_slave)
    before = at_master.unsent
    at_master.peer = ("255.255.255.255", at_slave.port)  # no broadcast without permission
    master.send(MotionMessage(0.5, 0.0, 0, engaged=True))
    assert at_master.unsent == before + 1
