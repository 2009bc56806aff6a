"""Swing a free handle between two places by its own motor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.slave.faults import of_axis
from teleop_rt_drivers.calibration.weights import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from teleop_rt.axis import Device

POWER_S = 3.0
"""Time in which the drive must have power."""
TOO_FAR = 3.0
"""Way from where it began, over `reach`, at which the motor is stopped: a stop swings through."""
SOFTER = 0.5
"""Share of the force in the second half: two sizes separate dry friction from damping."""
FEWEST_TURNS = 8
"""Of the push: four swings to and fro, two with each force."""
REST_CYCLES = 200
"""Cycles in which the drive is asked to stop at the end."""


@dataclass(frozen=True, slots=True)
class SwingRecord:
    """Positions as they were read and the forces that were asked for then, n of each.

    `reported` is the drive's own measurement of its force, not a number where it has none.
    """

    time_s: NDArray[np.float64]
    position: NDArray[np.float64]
    force: NDArray[np.float64]
    reported: NDArray[np.float64]


def swing(
    device: Device,
    wait_cycle: Callable[[], None],
    now_ns: Callable[[], int],
    force: float,
    reach: float,
    seconds: float,
) -> SwingRecord:
    """Push the device to and fro about its present position, and return its motion.

    The push turns where the device is `reach` from its beginning. Raises CalibrationError for a
    fault, for one that gets no power, that does not turn, or that goes too far; it ends stopped.
    """
    sample = Sample()
    try:
        _power(device, sample, wait_cycle, now_ns)
        rows, turns = _push(device, sample, wait_cycle, now_ns, force, reach, seconds)
    finally:
        for _ in range(REST_CYCLES):
            device.stop()
            wait_cycle()
            device.read_into(sample)
    if turns < FEWEST_TURNS:
        raise CalibrationError(
            f"the device turned {turns} times in {seconds:g} s: raise --force, or lower --reach"
        )
    return SwingRecord(*np.array(rows).T)


def _push(
    device: Device, sample: Sample, wait_cycle: Callable[[], None], now_ns: Callable[[], int],
    force: float, reach: float, seconds: float,
) -> tuple[list[tuple[float, float, float, float]], int]:  # fmt: skip
    """Push for so long; return a row of the record for each cycle, and how often it turned."""
    rows, turns, direction = [], 0, 1.0
    begin, begin_ns = sample.position, now_ns()
    end_ns = begin_ns + round(1e9 * seconds)
    while now_ns() < end_ns:
        wait_cycle()
        device.read_into(sample)
        _refuse_fault(sample)
        away = sample.position - begin
        if abs(away) > TOO_FAR * reach:
            raise CalibrationError(
                f"the device went {abs(away):.3g} from where it began: lower --force"
            )
        if away * direction > reach:
            direction, turns = -direction, turns + 1
        share = 1.0 if now_ns() < (begin_ns + end_ns) // 2 else SOFTER
        pushed = share * direction * force
        device.push(pushed)
        reported = math.nan if sample.drive_force is None else sample.drive_force
        rows.append((1e-9 * (now_ns() - begin_ns), sample.position, pushed, reported))
    return rows, turns


def _power(
    device: Device, sample: Sample, wait_cycle: Callable[[], None], now_ns: Callable[[], int]
) -> None:
    """Give the drive power, without force. Raises CalibrationError."""
    device.arm()
    end_ns = now_ns() + round(1e9 * POWER_S)
    while not sample.enabled:
        if now_ns() >= end_ns:
            raise CalibrationError("the drive gets no power: run `teleop-rt doctor`")
        wait_cycle()
        device.read_into(sample)
        _refuse_fault(sample)
        device.push(0.0)


def _refuse_fault(sample: Sample) -> None:
    if sample.fault is not AxisFault.NONE:
        found = of_axis(sample.fault)
        raise CalibrationError(f"{found.cause} {sample.complaint}; {found.next_step}")
