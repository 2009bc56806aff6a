"""A tick takes in and gives out all values by one call each: each in the field of its name."""

import pytest

from teleop_rt.axis import Sample
from teleop_rt.estimation.state import new_state
from teleop_rt.link.bodies import NewestMotion, new_state_body
from teleop_rt.link.codec import decode, encode
from teleop_rt.link.intake import new_words
from teleop_rt.link.messages import Kind, MotionMessage, StateMessage
from teleop_rt.link.peer_clock import FIXED, PeerClock
from teleop_rt.link.statistics import Statistics
from teleop_rt.realtime.lateness import ON_HARDWARE, Lateness
from teleop_rt.realtime.row import NamedRow
from teleop_rt.signals import SLAVE
from teleop_rt.slave.record import TickRecord
from teleop_rt.slave.step import (
    CHECK,
    FOLLOW,
    HOLD_CLOCK,
    LEAD,
    NO_INPUTS,
    STAND,
    STOP_DRIVE,
    decide,
    prepared,
    read_motion,
)


def test_the_inputs_of_a_tick_are_written_into_the_fields_of_their_names() -> None:
    late, record = Lateness(ON_HARDWARE, 1_000_000).record, TickRecord()
    arrays = (
        record.stored, Sample().stored, new_state()[0], late, late.copy(), Statistics().words,
        new_words(0, 0), PeerClock().words, NewestMotion().stored, NamedRow(SLAVE).stored,
        new_state_body(),
    )  # fmt: skip
    inputs = 2, 3_000_000_000, 4, 500_000, True, 6.5, True
    names = ("tick", "now_ns", "skipped", "wake_latency_ns", "ready", "surface_shift", "homed")
    decide(*arrays, CHECK, *inputs)
    assert tuple(getattr(record.tick, name) for name in names) == inputs
    decide(*arrays, LEAD, *NO_INPUTS)
    assert tuple(getattr(record.tick, name) for name in names) == inputs


@pytest.mark.parametrize(("led", "fixed", "action", "holds"), [
    (True, False, FOLLOW, True),
    (True, False, STAND, True),
    (True, True, FOLLOW, False),
    (False, False, FOLLOW, False),
    (True, False, STOP_DRIVE, False),
])  # fmt: skip
def test_the_link_s_state_is_to_be_held_once_the_master_leads_an_axis_under_power(
    led: bool, fixed: bool, action: int, holds: bool
) -> None:
    tick, clock = TickRecord().tick, PeerClock()
    tick.led, clock.words[FIXED] = led, fixed
    assert prepared(tick, clock.words, action) == action + holds * HOLD_CLOCK


def test_the_body_of_a_state_is_what_its_message_packs() -> None:
    message = StateMessage(
        0.25, -1.5, 2**40, in_contact=True, following=False, safety_state=4, fault=29,
        verified_free=0.2, velocity=-0.125, energy_J=3e-3, inadequate=True,
    )  # fmt: skip
    body = new_state_body()
    for name, value in message._asdict().items():
        setattr(body[0], name, value)
    assert body.tobytes() == encode(message)
    assert decode(Kind.STATE, body.tobytes()) == message


@pytest.mark.parametrize("contact_id", [0, 7, 2**63 - 1, 2**63, 2**64 - 1])
def test_a_motion_is_heard_as_its_message_says_and_counts_for_nothing_once_forgotten(
    contact_id: int,
) -> None:
    message = MotionMessage(
        0.5, -0.25, contact_id, engaged=True, surface=0.1, force=3.0, energy_J=2e-3,
        provisional=True, faulted=True,
    )  # fmt: skip
    motion, tick = NewestMotion(), TickRecord().tick
    read_motion(tick, motion.stored[0])
    assert tick.has_motion == 0
    motion.take(encode(message))
    read_motion(tick, motion.stored[0])
    assert (tick.has_motion, tick.engaged, tick.provisional, tick.faulted) == (1, 1, 1, 1)
    assert (tick.lead, tick.lead_velocity) == (message.target, message.velocity)
    assert (tick.lead_force, tick.lead_energy_J) == (message.force, message.energy_J)
    assert tick.acknowledged == min(contact_id, 2**63 - 1)
    motion.forget()
    read_motion(tick, motion.stored[0])
    assert (tick.has_motion, tick.faulted) == (0, 0)
