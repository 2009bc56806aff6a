"""ODrive's messages byte by byte, against cantools and a table of our own."""

from __future__ import annotations

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st
from makers_codecs import FLOATS, NODE, odrive

from teleop_rt_drivers.actuators.codec import DriveState, Frame, Report, Taken
from teleop_rt_drivers.actuators.odrive import OdriveCodec

# Command, name, signals: name, start bit, bits, "f" float, "s" signed, "u" unsigned, factor. From
# the table of messages in ODrive's documentation.
TABLE = [
    (0x01, "Heartbeat", [("Error", 0, 32, "u", 1), ("State", 32, 8, "u", 1),
                         ("Motor", 40, 1, "u", 1), ("Encoder", 48, 1, "u", 1),
                         ("Controller", 56, 1, "u", 1), ("Done", 63, 1, "u", 1)]),
    (0x07, "Set_State", [("State", 0, 32, "u", 1)]),
    (0x09, "Estimates", [("Pos", 0, 32, "f", 1), ("Vel", 32, 32, "f", 1)]),
    (0x0B, "Modes", [("Control", 0, 32, "s", 1), ("Input", 32, 32, "s", 1)]),
    (0x0C, "Input_Pos", [("Pos", 0, 32, "f", 1), ("Vel", 32, 16, "s", 0.001),
                         ("Torque", 48, 16, "s", 0.001)]),
    (0x0E, "Input_Torque", [("Torque", 0, 32, "f", 1)]),
    (0x0F, "Limits", [("Vel", 0, 32, "f", 1), ("Current", 32, 32, "f", 1)]),
    (0x14, "Iq", [("Setpoint", 0, 32, "f", 1), ("Measured", 32, 32, "f", 1)]),
]  # fmt: skip


def odrive_database():
    """A DBC of our own from the table, read by cantools."""
    lines, types = ['VERSION ""', "NS_ :", "BS_:", "BU_: M D"], []
    for command, name, signals in TABLE:
        frame_id = NODE * 32 + command
        lines.append(f"BO_ {frame_id} {name}: 8 M")  # all, says the maker's DBC
        for signal, start, bits, kind, factor in signals:
            sign = "+" if kind == "u" else "-"
            lines.append(f' SG_ {signal} : {start}|{bits}@1{sign} ({factor},0) [0|0] "" D')
            types += [f"SIG_VALTYPE_ {frame_id} {signal} : 1;"] if kind == "f" else []
        lines.append("")
    return cantools.database.load_string("\n".join([*lines, *types]), "dbc")


DATABASE = odrive_database()


def said(name: str, **values: float) -> Frame:
    message = DATABASE.get_message_by_name(name)
    return Frame(message.frame_id, message.encode(values))


def understood(frame: Frame) -> tuple[str, dict[str, float]]:
    message = DATABASE.get_message_by_frame_id(frame.can_id)
    return message.name, message.decode(frame.data)


@given(FLOATS, st.floats(-30, 30))
def test_odrive_commands_are_what_cantools_reads(position, velocity):
    (frame,) = odrive().follow(position, velocity)
    name, values = understood(frame)
    assert name == "Input_Pos"
    assert values["Pos"] == position
    assert values["Vel"] == pytest.approx(velocity, abs=0.5e-3 + 1e-9)
    assert values["Torque"] == 0


def test_odrive_is_given_power_by_mode_position_and_state_and_its_limits_are_written():
    codec = odrive()
    assert [understood(frame) for frame in codec.enable(1.25)] == [
        ("Modes", {"Control": 3, "Input": 1}),
        ("Input_Pos", {"Pos": 1.25, "Vel": 0, "Torque": 0}),
        ("Set_State", {"State": 8}),
    ]
    idle, clear, limits = codec.opening()
    assert understood(idle) == ("Set_State", {"State": 1})
    assert clear == Frame(NODE * 32 + 0x18, b"")
    assert understood(limits) == ("Limits", {"Vel": 50.0, "Current": 40.0})
    mode, torque = codec.push(0.75)
    assert understood(mode) == ("Modes", {"Control": 1, "Input": 1})
    assert understood(torque) == ("Input_Torque", {"Torque": 0.75})


@given(FLOATS, FLOATS, FLOATS)
def test_odrive_reports_are_read_as_cantools_writes_them(position, velocity, current):
    codec, report = odrive(), Report()
    assert codec.take(said("Iq", Setpoint=0, Measured=current), report) is Taken.NOTED
    assert codec.take(said("Estimates", Pos=position, Vel=velocity), report) is Taken.MEASURED
    assert (report.position, report.velocity) == (position, velocity)
    assert report.torque == pytest.approx(0.05 * current)


@pytest.mark.parametrize(
    ("fields", "state", "words"),
    [
        ({"State": 1}, DriveState.OFF, ""),
        ({"State": 8}, DriveState.FOLLOWING, ""),
        ({"State": 3}, DriveState.BUSY, ""),
        ({"State": 8, "Error": 0x800}, DriveState.FAULT, "watchdog timer expired"),
        ({"State": 1, "Error": 0x40040}, DriveState.FAULT, "over-temperature"),
        ({"State": 8, "Motor": 1}, DriveState.FAULT, "dump_errors"),
        ({"State": 8, "Encoder": 1}, DriveState.FAULT, "dump_errors"),
        ({"State": 8, "Controller": 1}, DriveState.FAULT, "dump_errors"),
        ({"State": 8, "Done": 1}, DriveState.FOLLOWING, ""),
    ],
)
def test_odrive_heartbeats_contain_state_and_errors(fields, state, words):
    report = Report()
    values = dict.fromkeys(("Error", "Motor", "Encoder", "Controller", "Done"), 0) | fields
    assert odrive().take(said("Heartbeat", **values), report) is Taken.STATE
    assert report.state is state
    assert words in report.complaint


def beat(codec: OdriveCodec, state: int, error: int) -> DriveState:
    report = Report()
    values = {"State": state, "Error": error, "Motor": 0, "Encoder": 0, "Controller": 0, "Done": 0}
    codec.take(said("Heartbeat", **values), report)
    return report.state


def test_an_odrive_s_watchdog_that_expires_without_power_is_cleared_and_with_power_is_a_fault():
    codec, clear = odrive(), Frame(NODE * 32 + 0x18, b"")
    codec.opening()
    assert clear not in codec.enable(0.0)
    codec.opening()
    assert beat(codec, 1, 0x800) is DriveState.OFF
    assert beat(codec, 1, 0x801) is DriveState.FAULT, "no other error is forgiven"
    assert beat(codec, 1, 0x800) is DriveState.OFF
    assert codec.enable(0.0)[0] == clear
    assert beat(codec, 8, 0) is DriveState.FOLLOWING
    codec.disable()
    assert beat(codec, 1, 0x800) is DriveState.FAULT, "it expired under power"
    codec.disable()
    assert beat(codec, 1, 0x800) is DriveState.FAULT, "until the axis is opened again"
    codec.opening()
    beat(codec, 8, 0)  # of a daemon before this one
    assert beat(codec, 1, 0x800) is DriveState.OFF
    codec.enable(0.0)
    assert beat(codec, 1, 0x800) is DriveState.OFF, "it was sent before the order was obeyed"
    assert codec.disable()[0] == clear
    assert beat(codec, 1, 0) is DriveState.OFF
    assert clear not in codec.disable()
    assert beat(codec, 1, 0x800) is DriveState.OFF, "a watchdog that expires later is none"
