"""A tick takes in and gives out all values by one call each: each in the field of its name."""

import struct

import pytest

from teleop_rt.link.bodies import NewestMotion, new_state_body
from teleop_rt.link.codec import decode, encode
from teleop_rt.link.messages import Kind, MotionMessage, StateMessage
from teleop_rt.slave.record import CAME_IN, Tick, TickRecord
from teleop_rt.slave.step import read_motion


def test_a_run_writes_its_fields_in_their_order_and_nothing_beside() -> None:
    run, record = CAME_IN, TickRecord()
    for name in Tick.__annotations__:
        if name not in ("forces", "positions", "stamps_ns"):
            setattr(record.tick, name, -7)
    values = range(2, 2 + len(run.fields))
    run.write(record, *values)
    for name in Tick.__annotations__:
        if name in run.fields:
            assert getattr(record.tick, name) == values[run.fields.index(name)], name
        elif name not in ("forces", "positions", "stamps_ns"):
            assert getattr(record.tick, name) == -7, name


def test_a_run_refuses_a_value_too_few() -> None:
    with pytest.raises(struct.error):
        CAME_IN.write(TickRecord(), *range(len(CAME_IN.fields) - 1))


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
