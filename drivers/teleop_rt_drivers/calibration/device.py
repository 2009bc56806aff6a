"""Identification of an operator's device from a motion: mass, damping, dry friction, latency.

m x'' + b x' + F sign(x') = u(t - T), weighed by a smooth window w that ends at 0: integrated by
parts the derivatives fall on w alone, so that positions are never differentiated (Shinbrot, 1957).
The latency T is the one that leaves least.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt_drivers.calibration.weights import CalibrationError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.calibration.device_motion import SwingRecord
    from teleop_rt_drivers.calibration.rig_file import KeyPath
    from teleop_rt_drivers.transport import TransportTimes

    Floats = NDArray[np.float64]

FINE = 10
"""Points between two cycles at which pushes, which turn within one, are integrated."""
WINDOW_SHARE = 0.5
"""Length of the window over the time between two turns of the push."""
LONGEST_S = 0.03
"""Largest latency that is searched: three times that of a loop of 100 Hz."""
LEFT_SHARE = 0.2
"""Share of the push that may be left: a hand on the device, or a spring, leaves more."""
ROUNDED_SHARE = 0.25
"""Of a push by which the drive may round it: 12 bits of torque are half a newton of some motors."""
SAFE_SHARE = 0.98
"""Of the damping that is written: on simulated devices the estimate is up to 0.2 % too large."""
SURE = 2.0
"""Standard deviations by which the damping that is written is below the estimate."""


@dataclass(frozen=True, slots=True)
class DeviceFit:
    """The estimates, each with its standard deviation [rig units, s]."""

    mass: float
    damping: float
    coulomb_friction: float
    latency_s: float
    mass_deviation: float
    damping_deviation: float
    friction_deviation: float
    latency_deviation_s: float
    left_share: float


def fit_device(motion: SwingRecord) -> DeviceFit:
    """Return the estimates from a motion. Raises CalibrationError if it determines none."""
    period_s = float(np.median(np.diff(motion.time_s)))
    grid_s = np.arange(motion.time_s[0], motion.time_s[-1], period_s)
    position = np.interp(grid_s, motion.time_s, motion.position)
    turns = max(1, int(np.count_nonzero(np.diff(np.sign(motion.force)))))
    half = max(4, round(0.5 * WINDOW_SHARE * len(grid_s) / turns))
    if len(grid_s) < 8 * half:
        raise CalibrationError("the motion is too short for its swings: raise the time")
    window, slope, bend = _window(half, period_s)
    columns = _columns(position, window, slope, bend)
    latencies = np.arange(0.0, LONGEST_S, period_s / FINE)
    pushes = _pushes(motion, grid_s, half, period_s, latencies)
    cut = round(LONGEST_S / period_s) + half
    columns = columns[cut:]
    left = np.array([_left(columns, push[cut:])[1] for push in pushes])
    best = int(np.argmin(left))
    if not 0 < best < len(latencies) - 1:
        raise CalibrationError(
            "no latency up to 30 ms explains the motion: let the device move freely"
        )
    return _judged(columns, pushes[best][cut:], left, best, latencies, 2 * half)


def _window(half: int, period_s: float) -> tuple[Floats, Floats, Floats]:
    """Return w = (1 - s^2)^4 over 2 half + 1 cycles, and its first two derivatives in time."""
    s, per_s = np.linspace(-1.0, 1.0, 2 * half + 1), 1.0 / (half * period_s)
    inner = 1.0 - s**2
    window = inner**4
    slope = -8.0 * s * inner**3 * per_s
    bend = (48.0 * s**2 * inner**2 - 8.0 * inner**3) * per_s**2
    scale = 1.0 / window.sum()
    return scale * window, scale * slope, scale * bend


def _columns(position: Floats, window: Floats, slope: Floats, bend: Floats) -> Floats:
    """Return weighed acceleration, velocity and sign of the velocity, for each place (n, 3)."""
    # numpy convolves with the kernel reversed in time: w is even, w' is odd.
    acceleration = np.convolve(position, bend, "valid")
    velocity = np.convolve(position, slope, "valid")
    signs = np.convolve(np.sign(np.gradient(_smooth(position))), window, "valid")
    return np.stack((acceleration, velocity, signs), axis=1)


def _smooth(position: Floats) -> Floats:
    """Return positions averaged over five cycles: their sign of change is then the motion's."""
    return np.convolve(np.pad(position, 2, mode="edge"), np.full(5, 0.2), "valid")


def _pushes(
    motion: SwingRecord, grid_s: Floats, half: int, period_s: float, latencies: Floats
) -> list[Floats]:
    """Return the pushes, weighed by the window, as each latency would delay them."""
    s = np.linspace(-1.0, 1.0, 2 * half * FINE + 1)
    window = (1.0 - s**2) ** 4
    window /= window.sum()
    fine_s = np.arange(len(grid_s) * FINE) * period_s / FINE + grid_s[0]
    held = np.searchsorted(motion.time_s, fine_s, side="right") - 1
    asked = _as_pushed(motion)[np.clip(held, 0, len(motion.force) - 1)]
    weighed = np.convolve(asked, window, "valid")
    padded = np.pad(weighed, (len(latencies), 0))
    places = np.arange(len(grid_s) - 2 * half) * FINE + len(latencies)
    return [padded[np.minimum(places - back, len(padded) - 1)] for back in range(len(latencies))]


def _as_pushed(motion: SwingRecord) -> Floats:
    """Return the pushes as large as the drive reports them: it may round a command.

    Raises CalibrationError where the two differ by more than rounding.
    """
    pushed = motion.force.copy()
    for level in np.unique(motion.force):
        there = motion.force == level
        if not np.isfinite(motion.reported[there]).any():
            continue
        reported = motion.reported[there]
        typical = float(np.nanmedian(reported))
        if abs(typical - level) > ROUNDED_SHARE * abs(level):
            raise CalibrationError(
                f"the drive reports a force of {typical:.3g} where {level:.3g} is commanded: "
                "raise --force, or correct the drive's scale"
            )
        # A drive of few bits goes to and fro between two codes; after a turn it reports the last
        # force for a while.
        settled = np.abs(reported - typical) < ROUNDED_SHARE * abs(level)
        pushed[there] = float(np.mean(reported[settled]))
    return pushed


def _left(columns: Floats, push: Floats) -> tuple[Floats, float]:
    """Return mass, damping and friction, and the mean square of the residual."""
    found = np.asarray(np.linalg.lstsq(columns, push)[0], dtype=np.float64)
    return found, float(np.mean((push - columns @ found) ** 2))


def _judged(
    columns: Floats, push: Floats, left: Floats, best: int, latencies: Floats, window: int
) -> DeviceFit:
    """Return the fit with its deviations; overlapping windows are not independent."""
    found, least = _left(columns, push)
    independent = max(4.0, len(push) / window)
    covariance = np.linalg.inv(columns.T @ columns / len(push)) * least / independent
    deviations = np.sqrt(np.diag(covariance))
    before, at, after = left[best - 1 : best + 2]
    curvature = before - 2.0 * at + after
    step_s = latencies[1] - latencies[0]
    latency_s = latencies[best] + 0.5 * step_s * (before - after) / curvature
    # The squared residual doubles its excess where the latency is off by its deviation.
    latency_deviation_s = step_s * float(np.sqrt(2.0 * least / independent / curvature))
    mass, damping, friction = found.tolist()
    share = float(np.sqrt(least / np.mean(push**2)))
    if share > LEFT_SHARE:
        raise CalibrationError(
            f"{100 * share:.0f} % of the push is not explained by mass, damping and friction: let "
            "go of the device, and keep it away from its end stops"
        )
    if not mass > 0.0:
        raise CalibrationError(
            f"a mass of {mass:.3g} is none: the motion is too small or too slow"
            ": raise --force or --reach"
        )
    if damping < -SURE * deviations[1] or friction < -SURE * deviations[2]:
        raise CalibrationError(
            f"damping {damping:.3g} or friction {friction:.3g} is below 0: something drives it"
            ": let go of it, and keep springs and weights off it"
        )
    return DeviceFit(
        mass=mass,
        damping=damping,
        coulomb_friction=friction,
        latency_s=float(latency_s),
        mass_deviation=float(deviations[0]),
        damping_deviation=float(deviations[1]),
        friction_deviation=float(deviations[2]),
        latency_deviation_s=latency_deviation_s,
        left_share=share,
    )


def device_keys(rig: RigConfig, transport: TransportTimes, fit: DeviceFit) -> dict[KeyPath, float]:
    """Return the keys of the rig's file by a fit. Raises CalibrationError.

    The damping is the least that the motion allows, for the passivity bound counts on it; of the
    latency the part of bus and frames is the driver's to count.
    """
    body, units = rig.device, rig.units
    if body is None:
        raise CalibrationError("device is missing in the rig: name the rig of an operator's device")
    moving, force = f"{units.force}_s", units.position
    others_s = transport.sample_age_s + transport.force_delay_s
    others_s += body.latency_s - 1e-3 * body.force_latency_ms
    own_ms = 1e3 * (fit.latency_s - others_s)
    if own_ms < -1e3 * max(1.0 / rig.rate_hz, SURE * fit.latency_deviation_s):
        raise CalibrationError(
            f"a latency of {1e3 * fit.latency_s:.2f} ms is less than the {1e3 * others_s:.2f} ms "
            "that bus, frames and the device's own bandwidth make: correct those first"
        )
    return {
        ("device", f"mass_{moving}2_per_{force}"): fit.mass,
        ("device", f"damping_{moving}_per_{force}"): max(
            0.0, SAFE_SHARE * fit.damping - SURE * fit.damping_deviation
        ),
        ("device", f"coulomb_friction_{units.force}"): max(0.0, fit.coulomb_friction),
        ("device", "force_latency_ms"): max(0.0, own_ms),
    }
