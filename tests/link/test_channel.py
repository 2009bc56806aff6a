from __future__ import annotations

import math

import pytest

from teleop_rt.link.channel import Endpoint
from teleop_rt.link.codec import decode_header
from teleop_rt.link.impairment import Impairment
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import Kind, ModelMessage, MotionMessage, StateMessage
from teleop_rt.link.statistics import Statistics
from teleop_rt.link.transport import MemoryTransport
from teleop_rt.link.troubles import DAMAGED_TROUBLE, SILENT_TROUBLE, TROUBLES
from teleop_rt_dev.link.pair import KEY, MS, Pair


def delayed(ms: int) -> Impairment:
    return Impairment(delay_ns=ms * MS)


@pytest.mark.parametrize("one_way_ms", [0, 75, 500, 2000])
def test_a_session_stands_after_a_round_trip_and_carries_both_directions(one_way_ms: int) -> None:
    pair = Pair(there=delayed(one_way_ms), back=delayed(one_way_ms))
    pair.run(2 * one_way_ms + 4)
    assert pair.master.connected
    session_id = pair.master.session_id
    pair.run(4 * one_way_ms + 10)
    assert pair.slave.session_id == session_id == pair.master.session_id
    assert pair.slave.motion is not None
    assert pair.master.state is not None
    assert pair.master.statistics.refused == pair.slave.statistics.refused == 0
    assert pair.slave.peer_rate_hz == pair.master.peer_rate_hz == 1000
    assert pair.master.trouble is None


def test_what_a_peer_sent_while_nobody_polled_is_dropped_and_the_session_stands_as_ever() -> None:
    pair = Pair()
    pair.run(1)
    hello = pair.master_tap.sent[0]
    pair.slave_tap.injected.extend([hello] * 3000)
    pair.slave.forget_waiting()
    pair.run(200)
    assert pair.slave.statistics.rejected == {}
    assert pair.slave.connected


def test_nothing_is_sent_before_a_session_stands() -> None:
    end, other = MemoryTransport.pair()
    endpoint = Endpoint("slave", end, shared_key(KEY), lambda: 1, rate_hz=1000)
    endpoint.send(ModelMessage("mass", 1, 1, 0.0))
    assert other.receive() is None
    assert endpoint.statistics.sent == 0


def test_another_key_gives_no_session_and_names_the_cause_on_the_side_that_sees_it() -> None:
    pair = Pair(slave_key=b"x" * 32)
    pair.run(1000)
    assert not pair.master.connected
    assert not pair.slave.connected
    assert pair.slave.motion is None
    assert pair.master.state is None
    assert "key" in (pair.slave.trouble or "")
    assert "nothing has arrived" in (pair.master.trouble or "")
    assert "same key" in (pair.master.trouble or "")
    assert TROUBLES[pair.slave.trouble_code(pair.now)][0] == "authentication"
    assert pair.master.trouble_code(pair.now) == 0, "too early for a verdict"
    pair.run(1500)
    assert TROUBLES[pair.master.trouble_code(pair.now)][0] == "nothing"


def test_another_protocol_version_gives_no_session_and_names_the_cause() -> None:
    pair = Pair()
    pair.run(1)
    hello = bytearray(pair.master_tap.sent[0])
    hello[2] = 1
    fresh = Pair()
    fresh.slave_tap.injected.append(bytes(hello))
    fresh.slave.poll()
    assert "version" in (fresh.slave.trouble or "")


def test_a_rate_outside_of_what_the_slave_accepts_is_refused() -> None:
    pair = Pair(master_rate_hz=4000, slave_rates_hz=(500, 2000))
    pair.run(500)
    assert not pair.master.connected
    assert "rate" in (pair.slave.trouble or "")


def test_the_applied_sequence_strictly_increases_on_a_bad_network() -> None:
    bad = Impairment(100 * MS, 25 * MS, loss=0.3, duplicate=0.05, reorder=0.1)
    late = 0
    for seed in range(5):
        pair = Pair(there=bad, back=bad, seed=seed)
        applied = {"motion": 0.0, "state": 0.0}
        for _ in range(3000):
            pair.step()
            if pair.slave.fresh_motion:
                assert pair.slave.motion.target > applied["motion"]
                applied["motion"] = pair.slave.motion.target
            if pair.master.fresh_state:
                assert pair.master.state.position > applied["state"]
                applied["state"] = pair.master.state.position
        assert min(applied.values()) > 2800
        late += pair.master.statistics.rejected["late"]
        assert pair.master.statistics.rejected["replay"] > 50
        counted = pair.master.statistics
        assert counted.lost / (counted.lost + counted.received) == pytest.approx(0.3, abs=0.05)
    assert late > 1000


def test_a_motion_that_is_refused_leaves_the_newest_one_that_kernels_know() -> None:
    pair = Pair()
    pair.run(20)
    pair.slave.poll()
    newest = pair.slave.newest_motion.stored
    assert (newest["target"][0], newest["known"][0]) == (pair.sent, 1)
    pair.master.send(MotionMessage(-1.0, 0.0, 0, engaged=True))
    overtaken = pair.master_tap.sent[-1]
    pair.slave_tap.inner.receive()
    pair.master.send(MotionMessage(-2.0, 0.0, 0, engaged=True))
    pair.slave.poll()
    assert newest["target"][0] == -2.0
    pair.slave_tap.injected.append(overtaken)
    pair.slave.poll()
    assert pair.slave.statistics.rejected == {"late": 1}
    assert newest["target"][0] == -2.0


def test_a_model_that_is_refused_leaves_the_newest_one_and_does_not_come_again() -> None:
    pair = Pair()
    pair.run(20)
    newest = ModelMessage("kelvin-voigt", 1, 1, 0.0, k=1.0)
    pair.slave.send(newest)
    pair.slave.send(newest._replace(k=math.nan))
    refused = pair.slave_tap.sent[-1]
    pair.master.poll()
    assert pair.master.model == newest
    assert pair.master.statistics.rejected == {"not finite": 1}
    pair.master_tap.injected.append(refused)
    pair.master.poll()
    assert pair.master.model == newest
    assert pair.master.statistics.rejected == {"not finite": 1, "replay": 1}


def test_a_packet_that_a_newer_one_overtook_is_not_refused() -> None:
    statistics = Statistics()
    for reason in ("late", "late welcome", "replay", "late", "authentication"):
        statistics.reject(reason)
    assert (statistics.refused, statistics.overtaken) == (2, 3)
    assert sum(statistics.rejected.values()) == 5


def test_silence_is_the_time_since_the_last_accepted_packet_whatever_its_age() -> None:
    dark = Impairment(500 * MS, blackouts_ns=((2000 * MS, 3000 * MS),))
    pair = Pair(there=delayed(500), back=dark)
    pair.run(2400)
    assert pair.master.silence_ns(pair.now) == 0
    assert pair.master.silence_ns(pair.now - MS) == 0, "it came after the tick had read its clock"
    pair.run(300)
    assert pair.master.silence_ns(pair.now) == 201 * MS


def test_a_slave_that_no_longer_answers_is_reported_after_two_seconds() -> None:
    pair = Pair(back=Impairment(0, blackouts_ns=((1000 * MS, 9000 * MS),)))
    pair.run(900)
    pair.master.statistics.reject("authentication")  # an attacker's, before packets of the slave
    pair.run(2000)
    assert pair.master.trouble_code(pair.now) == 0
    pair.run(200)
    assert pair.master.trouble_code(pair.now) == SILENT_TROUBLE
    assert "silent for more than 2 s" in TROUBLES[SILENT_TROUBLE][1]
    pair.master.statistics.reject("authentication")
    assert pair.master.trouble_code(pair.now) == DAMAGED_TROUBLE
    assert "damaged or forged" in TROUBLES[DAMAGED_TROUBLE][1]


def test_round_trip_and_clock_offset_are_estimated() -> None:
    pair = Pair(there=delayed(80), back=delayed(80), slave_clock_ahead_ns=12_345 * MS)
    pair.run(1000)
    for end, sign in ((pair.master, 1), (pair.slave, -1)):
        assert end.statistics.round_trip_ns == pytest.approx(160 * MS, abs=2 * MS)
        assert end.clock.offset_ns == pytest.approx(sign * 12_345 * MS, abs=2 * MS)
        assert end.statistics.one_way_ns == pytest.approx(80 * MS, abs=2 * MS)


def test_the_time_that_the_peer_waits_before_it_answers_is_not_counted_as_delay() -> None:
    pair = Pair(there=delayed(30), back=delayed(30))
    pair.run(200)
    for tick in range(2000):
        pair.now += MS
        pair.slave.poll()
        pair.master.poll()
        if tick % 50 == 0:
            pair.master.send(MotionMessage(0.0, 0.0, 0, engaged=True))
        if tick % 50 == 10:
            pair.slave.send(StateMessage(0.0, 0.0, 0, in_contact=False))
    for end in (pair.master, pair.slave):
        assert end.statistics.round_trip_ns == pytest.approx(60 * MS, abs=2 * MS)


def test_a_restarted_slave_is_found_again_by_a_new_session() -> None:
    pair = Pair()
    pair.run(100)
    first = pair.master.session_id
    pair.restart_slave()
    pair.run(1900)
    assert pair.master.session_id == first
    assert not pair.slave.connected
    pair.run(400)
    assert pair.master.session_id == pair.slave.session_id != first
    assert pair.slave.motion.target == pair.sent - 1


@pytest.mark.parametrize("one_way_ms", [20, 500])
def test_a_session_survives_a_long_blackout_when_both_sides_do(one_way_ms: int) -> None:
    dark = Impairment(one_way_ms * MS, blackouts_ns=((3000 * MS, 8000 * MS),))
    pair = Pair(there=dark, back=dark)
    pair.run(2500)
    session_id = pair.master.session_id
    pair.run(7500)
    assert session_id
    assert pair.master.session_id == pair.slave.session_id == session_id
    assert pair.master.silence_ns(pair.now) == 0


def test_replayed_hellos_cost_neither_the_session_nor_a_key() -> None:
    pair = Pair()
    pair.run(10)
    hello = pair.master_tap.sent[0]
    assert decode_header(hello).kind == Kind.HELLO
    old_packets = [p for p in pair.master_tap.sent if decode_header(p).kind == Kind.MOTION]
    pair.restart_slave()
    pair.run(2500)
    session_id, received = pair.slave.session_id, pair.slave.statistics.received
    assert session_id
    pair.slave_tap.injected.extend([hello, *old_packets] * 3)
    pair.slave.poll()
    assert pair.slave.session_id == session_id
    assert pair.slave.statistics.received <= received + 1
    pair.run(100)
    assert pair.slave.motion.target == pair.sent - 1


def test_a_flood_of_hellos_is_answered_at_a_limited_rate() -> None:
    pair = Pair()
    pair.run(1)
    hello = pair.master_tap.sent[0]
    answered = len(pair.slave_tap.sent)
    for _ in range(1000):
        pair.now += MS
        pair.slave_tap.injected.extend([hello] * 10)
        pair.slave.poll()
    assert len(pair.slave_tap.sent) - answered <= 101
    assert pair.slave.statistics.rejected["handshake rate"] > 9000


def test_no_nonce_is_used_twice_under_one_key() -> None:
    pair = Pair(there=Impairment(loss=0.3), back=Impairment(loss=0.3))
    pair.run(1000)
    for tap in (pair.master_tap, pair.slave_tap):
        headers = [decode_header(packet) for packet in tap.sent]
        used = [(header.session, header.sequence) for header in headers if header.session]
        assert len(used) > 200
        assert len(set(used)) == len(used)


def test_a_poll_takes_a_bounded_number_of_packets() -> None:
    pair = Pair()
    pair.slave_tap.injected.extend([b"noise"] * 1000)
    pair.slave.poll()
    assert len(pair.slave_tap.injected) == 1000 - 128


def test_a_message_of_the_wrong_direction_is_refused() -> None:
    pair = Pair()
    pair.run(10)
    pair.slave_tap.injected.append(pair.slave_tap.sent[-1])
    before = pair.slave.motion
    pair.slave.poll()
    assert pair.slave.statistics.rejected["kind"] == 1
    assert isinstance(before, MotionMessage)
