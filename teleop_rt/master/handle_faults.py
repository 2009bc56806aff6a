"""Why the operator's device was let go: every fault with a number, its cause and the next step."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class HandleFault:
    """Why no force is rendered any more; latched until the master restarts."""

    code: int
    name: str
    cause: str
    next_step: str


NO_FAULT = HandleFault(0, "none", "no fault", "nothing to do")
_OTHERS = (
    OSCILLATION := HandleFault(
        50,
        "handle_oscillates",
        "the device oscillated by itself, and went on when the wall was rendered softer",
        "measure the device's damping and latency again, and correct device and bus in its rig",
    ),
    STALE := HandleFault(
        51,
        "handle_stale",
        "no valid sample of the operator's device for 10 ms",
        "check power and wiring of its encoder, the load of its bus and its answer_within_ms; "
        "then start again",
    ),
    OVERSPEED := HandleFault(
        52,
        "handle_overspeed",
        "the operator's device moved faster than its velocity_max",
        "take it in hand before it is powered; check the sign of its force, then start again",
    ),
    NOT_ENABLED := HandleFault(
        53,
        "handle_not_enabled",
        "the drive of the operator's device is silent, or no longer enabled",
        "read the drive's error and remove its cause, then start again",
    ),
    FORCE_OFF := HandleFault(
        54,
        "handle_force_off",
        "the drive's own force differed from the commanded one for 5 ms",
        "check rated_force, the motor and its supply, then start again",
    ),
    END_OF_TRAVEL := HandleFault(
        55,
        "handle_end_of_travel",
        "the operator's device left its position_min to position_max",
        "move it back into the middle of its travel, then start again",
    ),
    RELEASED := HandleFault(
        56,
        "handle_released",
        "the enabling switch was released while a force was rendered",
        "hold the switch, then start again",
    ),
    DEVICE := HandleFault(
        57,
        "handle_device",
        "the driver of the operator's device reports a fault",
        "read log.jsonl, check its bus and power, then start again",
    ),
    STALLED := HandleFault(
        58,
        "handle_stalled",
        "the master's loop stood still for longer than stop_ms, and left a force on the hand",
        "give the master real-time priority and a core of its own, then start again",
    ),
    POSITION_OFF := HandleFault(
        59,
        "handle_position_off",
        "the encoder of the operator's device and its drive's own position parted",
        "check the encoder, its coupling and both scales, then start again",
    ),
)
HANDLE_FAULTS = {fault.code: fault for fault in (NO_FAULT, *_OTHERS)}
