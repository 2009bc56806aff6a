"""Read a rig's force sensor under weights, and turn the fit into keys of its file."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.slave.faults import of_axis
from teleop_rt_drivers.calibration.weights import CalibrationError, Weighing
from teleop_rt_drivers.canopen.config import CanopenPart
from teleop_rt_drivers.framed.config import FramedPart
from teleop_rt_drivers.quantity import FROM_INPUT
from teleop_rt_drivers.registry import parts_of

if TYPE_CHECKING:
    from teleop_rt.axis import Axis
    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.calibration.rig_file import KeyPath
    from teleop_rt_drivers.calibration.weights import ForceFit
    from teleop_rt_drivers.canopen.node_config import ForceReading
    from teleop_rt_drivers.framed.signal_config import ForceSignal

    Wait = Callable[[], None]


def read_force(
    axis: Axis, wait_cycle: Wait, now_ns: Callable[[], int], force: float, seconds: float
) -> Weighing:
    """Read the sensor for a time under a known force, each new value once; nothing is armed.

    Raises CalibrationError where a device has a fault.
    """
    sample, taken, last_ns = Sample(), [], -1
    end_ns = now_ns() + round(1e9 * seconds)
    while now_ns() < end_ns:
        wait_cycle()
        axis.read_into(sample)
        axis.write(sample.position)
        if sample.fault is not AxisFault.NONE:
            found = of_axis(sample.fault)
            raise CalibrationError(f"{found.cause} {sample.complaint}; {found.next_step}")
        if sample.valid and sample.force_stamp_ns != last_ns:
            last_ns = sample.force_stamp_ns
            taken.append(sample.force)
    return Weighing(force, np.array(taken), seconds)


def force_keys(rig: RigConfig, fit: ForceFit) -> dict[KeyPath, float]:
    """Return scale, offset and noise of the rig's file by a fit. Raises CalibrationError."""
    unit = rig.units.force
    for name, part in parts_of(rig.axis).items():
        section = ("axis", "parts", name, "force") if name else ("axis", "force")
        force: ForceReading | ForceSignal | None = None
        if isinstance(part, CanopenPart):
            per, force = "count", part.force_reading
            if part.force == FROM_INPUT:
                section = (*section[:-1], "drive", "force_input")
        elif isinstance(part, FramedPart):
            per, force = "unit", part.force
        if force is None:
            continue
        scale = 1.0 if force.scale is None else force.scale
        return {
            (*section, f"scale_{unit}_per_{per}"): fit.factor * scale,
            (*section, f"offset_{unit}"): fit.offset + fit.factor * force.offset,
            ("sensors", f"force_noise_{unit}"): fit.noise,
        }
    raise CalibrationError(
        "the rig has no force sensor whose scale is in its file"
        ": put one into axis, or correct the scale where the sensor has it"
    )
