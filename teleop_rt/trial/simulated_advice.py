"""Next steps after a fault on a simulated rig, which no hand can move."""

from __future__ import annotations

from teleop_rt.slave.faults import FORCE_LIMIT, TARE_CONTACT, Fault

_SIMULATED = {
    FORCE_LIMIT: (
        "lower plant.environment.stiffness, or raise limits.stiffness_max to it, for the tool's "
        "speed is matched to that; then reset and arm"
    ),
    TARE_CONTACT: "set plant.environment.surface above plant.start, then reset",
}


def next_step_of(fault: Fault, *, simulated: bool) -> str:
    """Return the next step after a fault; `simulated` says whether the rig is."""
    return (_SIMULATED.get(fault) if simulated else None) or fault.next_step
