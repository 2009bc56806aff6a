"""Next steps after a fault on a simulated rig, which no hand can move."""

from __future__ import annotations

from teleop_rt.slave.faults import (
    FORCE_LIMIT,
    HOMING_NOT_FOUND,
    HOMING_STUCK,
    POSITION_LIMIT,
    SAMPLES_LOST,
    TARE_CONTACT,
    TARE_DRIFT,
    TARE_NOISE,
    Fault,
)

_HOMING = (
    "check plant.start, plant.sensors.home_switch and reference.homing against each other, then"
    " reset and arm"
)
_SIMULATED = {
    SAMPLES_LOST: (
        "leave the simulated rig, which lacked a processor, a core of its own, or run with --clock"
        " simulated; then reset and arm"
    ),
    FORCE_LIMIT: (
        "lower plant.environment.stiffness, or raise limits.stiffness_max to it, for the tool's "
        "speed is matched to that; then reset and arm"
    ),
    POSITION_LIMIT: (
        "keep plant.start and the operator's motion between limits.position_min and position_max,"
        " then reset and arm"
    ),
    TARE_CONTACT: "set plant.environment.surface above plant.start, then reset",
    TARE_NOISE: "lower plant.sensors.force_noise, or raise tare.noise_max, then reset",
    TARE_DRIFT: "lower plant.sensors.force_drift, or raise tare.drift_max, then reset",
    HOMING_NOT_FOUND: _HOMING,
    HOMING_STUCK: _HOMING,
}


def next_step_of(fault: Fault, *, simulated: bool) -> str:
    """Return the next step after a fault; `simulated` says whether the rig is."""
    return (_SIMULATED.get(fault) if simulated else None) or fault.next_step
