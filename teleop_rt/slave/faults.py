"""Safety states and faults: each fault with its code, its cause in words and the next step."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from teleop_rt.axis import AxisFault


class State(IntEnum):
    """The safety chain; FAULT is latched, and a reset leads to DISARMED, never to motion."""

    BOOT = 0
    SELFTEST = 1
    DISARMED = 2
    ARMED = 3
    RUN = 4
    HOLD = 5
    SAFE_STOP = 6
    FAULT = 7


# By these names a tick finds them at once: in Python 3.11 each look-up in an enum is a call.
BOOT, SELFTEST, DISARMED, ARMED, RUN, HOLD, SAFE_STOP, FAULT = State


FOLLOWS, NO_MOTION, LATE_LOOP, STALE_SAMPLE = range(4)
HELD_BY = {
    FOLLOWS: "",
    NO_MOTION: "no fresh motion from the master",
    LATE_LOOP: "the loop was late",
    STALE_SAMPLE: "a device gave no value in time",
}
"""Why an axis under power holds and does not follow, by code."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Why the axis was stopped."""

    code: int
    name: str
    cause: str
    next_step: str


@dataclass(frozen=True, slots=True)
class Stopped:
    """A fault, its time, and the device's report of it, in its own words; empty for none.

    `traceback` is that of an error which the driver raised, for the log.
    """

    fault: Fault
    stamp_ns: int
    said: str
    traceback: str = ""


NO_FAULT = Fault(0, "none", "no fault", "nothing to do")
NOT_STOPPED = Stopped(NO_FAULT, 0, "")
SAMPLES_LOST = Fault(
    10,
    "samples_lost",
    "no usable sample of position and force for longer than realtime.late.stop_ms (20 ms at least)",
    "check power and wiring of encoder and force sensor, then reset and arm",
)
LATE_TICKS = Fault(
    11,
    "late_ticks",
    "the loop stalled for longer than realtime.late of the rig allows",
    "give the daemon real-time priority and a core of its own, or lower rate_hz",
)
FORCE_LIMIT = Fault(
    12,
    "force_limit",
    "the measured force exceeded the rig's force_max",
    "move the tool away from the environment by hand, then reset and arm",
)
POSITION_LIMIT = Fault(
    13,
    "position_limit",
    "the measured position left the rig's range",
    "move the axis back into its range by hand, then reset and arm",
)
INTERNAL = Fault(
    14,
    "internal",
    "the program raised an error in its cycle; it is in the log",
    "read log.jsonl and report it",
)
TARE_CONTACT = Fault(
    15,
    "tare_contact",
    "the force sensor reads more than tare.offset_max: the tool touches something",
    "move the tool into free air by hand, then reset",
)
TARE_NOISE = Fault(
    16,
    "tare_noise",
    "the force sensor is noisier than tare.noise_max",
    "check shielding and ground, keep hands off the tool, then reset",
)
TARE_DRIFT = Fault(
    17,
    "tare_drift",
    "the force sensor drifts by more than tare.drift_max",
    "let it warm up, keep hands off the tool, then reset",
)
HOMING_NOT_FOUND = Fault(
    18,
    "homing_not_found",
    "homing found no switch, or nothing to touch, within its way",
    "check the switch, reference.homing.direction and search, then reset and arm",
)
HOMING_STUCK = Fault(
    19,
    "homing_stuck",
    "the tool did not follow, or its switch did not open, while homing",
    "free the tool by hand, check the switch, then reset and arm",
)
FOLLOWING_ERROR = Fault(
    30,
    "following_error",
    "the measured position stayed away from the commanded one",
    "free the axis, check the drive's gains and the bound in supervision, then reset and arm",
)
OVERSPEED = Fault(
    31,
    "overspeed",
    "the measured velocity exceeded velocity_max by more than supervision.velocity_share_max",
    "check the drive's gains, and whether something held or pushed the tool, then reset and arm",
)
FORCE_MISMATCH = Fault(
    32,
    "force_mismatch",
    "force sensor and drive measure different forces",
    "check the sensor's wiring, sign, zero and scale, and supervision.load, then reset and arm",
)
POSITION_MISMATCH = Fault(
    33,
    "position_mismatch",
    "encoder and drive measure different motions",
    "check the encoder's mounting, its sign, the coupling and both scales, then reset and arm",
)
DRIVE_SILENT = Fault(
    34,
    "drive_silent",
    "the drive is silent or not enabled while it should be",
    "check the drive's display, its wiring and its enable input, then reset and arm",
)
POSITION_REPEATED = Fault(
    35,
    "position_repeated",
    "the measured position is one and the same number while the command moves on",
    "free the axis, check whether the position sensor only repeats its last value, then reset"
    " and arm",
)
DRIVER = Fault(
    36,
    "driver",
    "the driver raised an error",
    "correct the driver by the traceback in log.jsonl, then reset and arm",
)
FORCE_INVALID = Fault(
    37,
    "force_invalid",
    "the driver gave a force that is no finite number",
    "correct the driver or check the force sensor's wiring, then reset and arm",
)
POSITION_INVALID = Fault(
    38,
    "position_invalid",
    "the driver gave a position that is no finite number",
    "correct the driver or check the encoder's wiring, then reset and arm",
)
FIRST_OF_AXIS = 20
"""The code of an axis's first fault; the others follow in its order."""
_AXIS_FAULTS = {
    AxisFault.DEVICE_LOST: Fault(
        20,
        "device_lost",
        "a device's heartbeat ended",
        "check its power and wiring, then reset and arm",
    ),
    AxisFault.BUS_OFF: Fault(
        21,
        "bus_off",
        "the CAN controller went bus-off",
        "check termination and wiring, bring the interface up, then reset and arm",
    ),
    AxisFault.ERROR_PASSIVE: Fault(
        22,
        "error_passive",
        "the CAN controller went error-passive",
        "check termination and wiring, then reset and arm",
    ),
    AxisFault.EMERGENCY: Fault(
        23,
        "emergency",
        "a device sent an emergency",
        "read the device's error, here or in log.jsonl, and remove its cause, then reset and arm",
    ),
    AxisFault.FOREIGN_MASTER: Fault(
        24,
        "foreign_master",
        "somebody else sends SYNC or NMT on this bus",
        "stop the other controller, for one bus has one master; then reset and arm",
    ),
    AxisFault.DUPLICATE_NODE: Fault(
        25,
        "duplicate_node",
        "two devices answer to one node id",
        "give each device its own id, then reset and arm",
    ),
    AxisFault.DRIVE_FAULT: Fault(
        26,
        "drive_fault",
        "the drive reports a fault",
        "read its error code and remove its cause, then reset and arm",
    ),
    AxisFault.UNPLUGGED: Fault(
        27,
        "unplugged",
        "the bus or the port is gone",
        "plug the cable in, then reset and arm; if the reset fails, start the daemon again",
    ),
    AxisFault.NOT_ACKNOWLEDGED: Fault(
        28,
        "not_acknowledged",
        "nothing acknowledges on the bus, and frames queue up",
        "check the devices' power, termination and bit rate, then reset and arm",
    ),
}


def of_axis(fault: AxisFault) -> Fault:
    """Return the fault that an axis reports."""
    return _AXIS_FAULTS.get(fault, NO_FAULT)


FAULTS = {
    fault.code: fault
    for fault in (
        NO_FAULT,
        SAMPLES_LOST,
        LATE_TICKS,
        FORCE_LIMIT,
        POSITION_LIMIT,
        INTERNAL,
        TARE_CONTACT,
        TARE_NOISE,
        TARE_DRIFT,
        HOMING_NOT_FOUND,
        HOMING_STUCK,
        FOLLOWING_ERROR,
        OVERSPEED,
        FORCE_MISMATCH,
        POSITION_MISMATCH,
        DRIVE_SILENT,
        POSITION_REPEATED,
        DRIVER,
        FORCE_INVALID,
        POSITION_INVALID,
        *_AXIS_FAULTS.values(),
    )
}
