"""Screening of tones, and of oscillations of the position in time or along the stroke."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Effect, Matrix
from teleop_rt.diagnosis.inference.starts import Start, chi2_falls, extended
from teleop_rt.diagnosis.models.axes import grid
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import bounds
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.models.simulate import rate_of, run_step
from teleop_rt.diagnosis.noise.whiten import power_of
from teleop_rt.diagnosis.samples.motion import RecordedMotion

_SOLVED = 8  # periods that are simulated, of those that promise most
_SWUNG = 5  # periods of an oscillation; of more, the likeliest are screened
_TONES = 3  # strongest lines of the residual that are screened


def is_tone(effect: Effect) -> bool:
    """Return whether the effect is a tone, whose frequency is read off the residual."""
    return any(shape.points == 0 for shape in effect.shapes)


def swings(effect: Effect) -> bool:
    """Return whether the effect oscillates in time or along the stroke, with a phase."""
    return any(shape.phase for shape in effect.shapes)


def localised(problem: Problem, fit: Fit, effect: Effect) -> list[Effect]:
    """Return the declaration of a tone, narrowed to each of the strongest lines of the residual."""
    if not is_tone(effect):
        return [effect]
    resolution = 1.0 / (problem.motion.dt * problem.force.size)
    power = power_of(fit.residual)
    lowest = next(shape.lower for shape in effect.shapes if shape.points == 0)
    highest = next(shape.upper for shape in effect.shapes if shape.points == 0)
    power[: int(np.ceil(lowest / resolution))] = 0.0
    power[int(highest / resolution) :] = 0.0
    found = []
    for _ in range(_TONES):
        peak = int(np.argmax(power))
        power[max(0, peak - 3) : peak + 4] = 0.0
        frequency = peak * resolution
        shapes = tuple(
            replace(
                shape,
                lower=max(frequency - resolution, lowest),
                upper=frequency + resolution,
                start=frequency,
                points=5,
            )
            if shape.points == 0
            else shape
            for shape in effect.shapes
        )
        found.append(replace(effect, shapes=shapes))
    return found


def screen_swing(problem: Problem, fit: Fit, own: Matrix, effect: Effect) -> Start:
    """Screen a small oscillation of the position by its two derivatives, in time or stroke."""
    model = extended(fit.model, effect)
    small = 1e-3 * problem.motion.scales["travel"]
    period = _likely_periods(problem, fit, own, effect)
    largest = bounds(effect.amplitude, problem.motion.scales)[1]
    still = fit.force_on(problem.motion)
    moved = np.empty((len(period), 2, still.size))
    for i, j in np.ndindex(moved.shape[:2]):
        zeta = np.concatenate([fit.zeta, [small, period[i], 0.5 * np.pi * j]])
        moved[i, j] = force_of(model, problem.motion, zeta, fit.theta) - still
    signs = np.zeros(2, dtype=bool)
    gains, theta = chi2_falls(problem.whitener(moved), own, fit.residual, signs)
    best = int(np.argmax(gains))
    size = min(small * float(np.hypot(*theta[best])), 0.8 * largest)
    turned = np.arctan2(theta[best, 1], theta[best, 0])
    zeta = np.concatenate([fit.zeta, [size, period[best], turned]])
    return Start(effect, zeta, float(gains[best]), model)


def _likely_periods(problem: Problem, fit: Fit, own: Matrix, effect: Effect) -> list[float]:
    """Return the grid's periods at which a small oscillation along the stroke gains most.

    Here the force follows position, velocity and acceleration without memory.
    """
    motion = problem.motion
    periods = grid(effect.shapes[0], motion.scales)
    if len(periods) <= _SWUNG:
        return periods
    still = fit.force_on(motion)
    change = np.zeros((len(periods), 2, still.size))
    swung = motion.made((effect, "swung"), lambda: _swung(motion, effect, periods))
    for name, moved in zip("xva", swung, strict=True):
        row = getattr(motion, name)
        step = 1e-3 * float(np.max(np.abs(row)))
        beside = fit.force_on(replace(motion, **{name: row + step}))
        change += (beside - still) / step * moved
    gains, _ = chi2_falls(problem.whitener(change), own, fit.residual, np.zeros(2, dtype=bool))
    return [periods[i] for i in np.argsort(-gains)[:_SOLVED]]


def _swung(motion: RecordedMotion, effect: Effect, periods: list[float]) -> list[Matrix]:
    """Return an oscillation of unit size, and its first and second rate.

    Each is an array (periods, 2 phases, samples).
    """
    found = np.empty((3, len(periods), 2, motion.x.size))
    for i, j in np.ndindex(found.shape[1:3]):
        eta = np.array([periods[i], 0.5 * np.pi * j])
        found[0, i, j] = run_step(effect, motion.x, motion.v, motion.a, motion.t, motion.dt, eta)
        found[1, i, j] = rate_of(found[0, i, j], motion.dt)
        found[2, i, j] = rate_of(found[1, i, j], motion.dt)
    return list(found)
