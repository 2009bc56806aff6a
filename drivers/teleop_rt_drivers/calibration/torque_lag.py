"""The lag of a drive's reported torque behind its position, from a run that pressed on a body.

The inertial force of a mass follows the acceleration at once. So the recorded force, with the
drivetrain's losses added again, is fitted by stiffness, mass and dry friction of the motion at
several earlier times; the time with the smallest residual is the lag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from teleop_rt.realtime.reading import read_topics
from teleop_rt_drivers.calibration.weights import CalibrationError
from teleop_rt_drivers.drivetrain import HALF_WINDOW_NS, SLOW_SHARE, DrivetrainConfig

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from teleop_rt.config.rig import RigConfig

Vector = NDArray[np.float64]

LARGEST_LAG_MS = 4.0
"""Of a drivetrain's key."""
STEP_MS = 0.05
"""Grid of the lags that are tried; a parabola refines the best one."""
PRESSED_SHARE = 0.2
"""Of the largest force: above it the tool surely presses, whatever the mass took in free air."""
SMOOTHED_NS = 16_000_000
"""To either side, of force and position alike: a drive runs to a command in steps of a cycle, in
which its torque is no longer even, and the mean over a cycle does not belong to its middle."""
STEPS_SHARE = 0.1
"""Of a period: the error that these steps leave in the lag."""
LEAST_S = 1.0
"""Of pressing."""


@dataclass(frozen=True, slots=True)
class TorqueLag:
    """The lag and its standard deviation [ms]; mass and stiffness as found beside [rig unit]."""

    torque_lag_ms: float
    deviation_ms: float
    mass: float
    stiffness: float


@dataclass(frozen=True, slots=True)
class _Pressing:
    """Times [ns] a period apart at which the tool presses, force then, position at any time."""

    times: Vector
    force: Vector
    position: Callable[[Vector], Vector]
    half_ns: int
    dry_speed: float

    def motion(self, lag_ms: float) -> tuple[Vector, Vector, Vector]:
        """Return position, velocity and acceleration so long before, as the drivetrain takes them.

        The position is averaged in the window of the acceleration, by Simpson's rule of a triangle.
        """
        at, span_s = self.times - 1e6 * lag_ms, 1e-9 * self.half_ns
        before, here, after = (
            self.position(at + shift) for shift in (-self.half_ns, 0, self.half_ns)
        )
        bend = after - 2.0 * here + before
        return here + bend / 12.0, (after - before) / (2.0 * span_s), bend / span_s**2


def find_torque_lag(
    recording: Path, config: DrivetrainConfig, rig: RigConfig, damping: float
) -> TorqueLag:
    """Return the lag by a run on a body of this damping; `config` and `rig` are those of the run.

    Raises CalibrationError if the recording does not determine it, RecordingError for no recording.
    """
    slave = read_topics(recording, ["/slave"]).get("/slave")
    if slave is None:
        raise CalibrationError(
            f"{recording}: has no slave's side of a run: give the recording of a run"
        )
    pressing = _pressing(slave, rig)
    if pressing.times.size * rig.period_ns < 1e9 * LEAST_S:
        raise CalibrationError(f"{recording}: press on something elastic for 10 s or more")
    before_ms = config.torque_lag_ms
    _, velocity, acceleration = pressing.motion(0.0)
    motor = pressing.force + config.mass * acceleration + config.viscous_friction * velocity
    motor += config.coulomb_friction * np.clip(velocity / pressing.dry_speed, -1.0, 1.0)
    known = config.viscous_friction + damping
    lags = np.arange(-before_ms, LARGEST_LAG_MS - before_ms + STEP_MS, STEP_MS)
    fits = [_fit(pressing, motor, lag, known) for lag in lags]
    left = np.array([square for square, _ in fits])
    best = int(np.argmin(left[1:-1])) + 1
    slope, bend = left[best + 1] - left[best - 1], np.sum(left[best - 1 : best + 2] * [1, -2, 1])
    if not bend > 0.0 or left[best] > min(left[0], left[-1]):
        raise CalibrationError(
            f"{recording}: no torque lag from 0 to {LARGEST_LAG_MS:g} ms fits best: "
            "press faster, deeper and for longer"
        )
    # Forces are averaged in a window, so that fewer of them are independent.
    independent = pressing.times.size * rig.period_ns / SMOOTHED_NS
    by_noise_ms = STEP_MS * math.sqrt(2.0 * left.item(best) / independent / bend)
    deviation_ms = math.hypot(by_noise_ms, 1e-6 * STEPS_SHARE * rig.period_ns)
    lag_ms = before_ms + lags.item(best) - 0.5 * STEP_MS * slope / bend
    stiffness, mass = fits[best][1][:2].tolist()
    return TorqueLag(float(lag_ms), deviation_ms, mass, stiffness)


def _pressing(slave: dict[str, Vector], rig: RigConfig) -> _Pressing:
    """Return where a run pressed for longer than windows: force and position at their own times."""
    valid, period_ns = slave["valid"] > 0, rig.period_ns
    now = slave["stamp_ns"] - slave["stamp_ns"][0]
    position_ns, place = np.unique((now - 1e6 * slave["position_age_ms"])[valid], return_index=True)
    force_ns, of_force = np.unique((now - 1e6 * slave["force_age_ms"])[valid], return_index=True)
    times = np.arange(position_ns[0], force_ns[-1], period_ns)
    smoothing = np.ones(2 * round(SMOOTHED_NS / period_ns) + 1)
    smoothing /= smoothing.size
    position = np.interp(times, position_ns, slave["position"][valid][place])
    force = np.interp(times, force_ns, slave["force"][valid][of_force])
    lifted = force < PRESSED_SHARE * np.max(force)
    half = max(1, round(HALF_WINDOW_NS / period_ns))
    around = 2 * half + round(1e6 * LARGEST_LAG_MS / period_ns) + smoothing.size
    lifted[:around] = lifted[-around:] = True
    pressed = np.convolve(lifted, np.ones(2 * around + 1), mode="same") < 0.5
    return _Pressing(
        times[pressed],
        np.convolve(force, smoothing, mode="same")[pressed],
        CubicSpline(times, np.convolve(position, smoothing, mode="same")),
        half * period_ns,
        SLOW_SHARE * rig.limits.velocity_max,
    )


def _fit(
    pressing: _Pressing, motor: Vector, lag_ms: float, known_damping: float
) -> tuple[float, Vector]:
    """Return the residual of the motor's force by a motion `lag_ms` before [force^2], and its fit.

    That is stiffness, mass, dry friction and offset.
    """
    x, v, a = pressing.motion(lag_ms)
    dry = np.clip(v / pressing.dry_speed, -1.0, 1.0)
    columns = np.column_stack([x, a, dry, np.ones_like(x)])
    force = motor - known_damping * v
    found = np.linalg.lstsq(columns, force, rcond=None)[0].astype(np.float64)
    return float(np.sum((force - columns @ found) ** 2)), found
