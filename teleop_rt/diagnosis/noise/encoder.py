"""Effects of the encoder's steps on the motion, and on the force through a model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise import whiten
from teleop_rt.diagnosis.samples.converter import before_steps, mean_error
from teleop_rt.diagnosis.samples.motion import (
    SMOOTHING_ORDER,
    RecordedMotion,
    differentiate,
    reading_noise,
    resolution_step,
)
from teleop_rt.diagnosis.samples.smoothing import lost_motion, moves_in_steps
from teleop_rt.recordings.filters import local_polynomial
from teleop_rt.recordings.recording import Recording
from teleop_rt.recordings.rows import force_noise, quantisation_step, stretches

_JUMP_RATIO = 4.0  # times the 99 % quantile of errors; larger: a sample on the other side
_ENCODER_DRAWS = 10  # draws of the encoder's errors
_SEED = 7  # of every draw here: an answer is the same each time
_WINDOW_FACTORS, _PROJECTIONS = (8, 4, 2, 1), 6


def input_errors(motion: RecordedMotion, recording: Recording) -> list[RecordedMotion]:
    """Return motions as a noisy encoder would have read them, for the same movement.

    The quantisation grid is shifted at random under the smoothed position, so slow motion has slow
    errors, unlike with white noise. At each rest the tool is at another random position within the
    step. Noise of the encoder is added before the steps. If the position was filtered after it was
    read, the step is the one that causes its noise. Every second motion follows the smoothest path
    that the readings allow: at constant speed, steps and samples beat, and the rest of that beat in
    the smoothed position would hide it, unless noise breaks it. Where the motion has steps, the
    derivatives are those of an unknown instant within half a period (see `samples.steps`);
    elsewhere they lack the part of the motion that their window removes.
    """
    step = resolution_step(recording.position, recording.dt)
    half = motion.half
    rng = np.random.default_rng(_SEED)
    rests = _rests(recording.position, 2 * half + 1)
    noise = reading_noise(recording.position, recording.dt)
    seen = quantisation_step(recording.position) > 0.0 and noise <= 0.0
    even = _evenly(recording.position, step, half) if seen else motion.x
    evenly = [seen and number % 2 == 1 for number in range(_ENCODER_DRAWS)]
    in_steps = moves_in_steps(recording.position, recording.force, recording.dt)
    lost = np.zeros((3, _ENCODER_DRAWS, motion.x.size))
    if not in_steps:
        lost = lost_motion(recording.position, motion.dt, half, _ENCODER_DRAWS, rng)
    positions = []
    for number, on_even in enumerate(evenly):
        path, apart = (even, 2 * half) if on_even else (motion.x, motion.x.size)
        shift = np.repeat(rng.uniform(0.0, step), path.size)
        if rests:
            inside = rng.uniform(-0.5 * step, 0.5 * step, len(rests))
            shift = shift + _held(rests, inside, apart, path.size)
        moved = path + shift + lost[0, number]
        if noise > 0.0:
            moved = moved + noise * rng.standard_normal(path.size)
        positions.append(step * np.round(moved / step) - shift)
    rows = np.array(differentiate(np.array([*positions, even]), motion.dt, half))
    rows[:, :-1] -= lost
    *found, plain = zip(*rows, strict=True)
    measured = (motion.x, motion.v, motion.a)
    for which in np.flatnonzero(evenly):
        both = zip(measured, found[which], plain, strict=True)
        found[which] = tuple(row + one - path for row, one, path in both)
    coarse_v, coarse_a = _between_samples(motion)
    drawn = [replace(motion, x=x, v=v + coarse_v, a=a + coarse_a) for x, v, a in found]
    if not in_steps:
        return drawn
    return [_at_another_instant(one, motion, share) for one, share in
            zip(drawn, rng.uniform(-0.5, 0.5, len(drawn)), strict=True)]  # fmt: skip


def _between_samples(motion: RecordedMotion) -> tuple[Vector, Vector]:
    """Return the difference that central differences make to velocity and acceleration.

    How the tool moves between two samples is not recorded. The polynomial takes it to be smooth;
    differences take another course, which a model's force must not depend on. Noise of the
    differences is no part of it.
    """
    v = np.gradient(motion.x, motion.dt)
    rows = np.array([v - motion.v, np.gradient(v, motion.dt) - motion.a])
    coarse_v, coarse_a = local_polynomial(rows, motion.half, SMOOTHING_ORDER)
    return coarse_v, coarse_a


def _at_another_instant(
    drawn: RecordedMotion, motion: RecordedMotion, periods: float
) -> RecordedMotion:
    """Return the drawn motion with velocity and acceleration of `motion` so many periods later.

    A drive that follows set-points has its kinks always at one place between two samples, and no
    derivative of the samples knows which.
    """
    later = periods * motion.dt
    jerk = np.gradient(motion.a, motion.dt)
    return replace(drawn, v=drawn.v + later * motion.a, a=drawn.a + later * jerk)


def _held(rests: list[tuple[int, int]], within: Vector, apart: int, samples: int) -> Vector:
    """Return a row (samples,) that is `within` in each rest and 0 farther than `apart` from any.

    Between two closer rests it is linear.
    """
    places, values = [rests[0][0] - apart], [0.0]
    for (first, last), here in zip(rests, within.tolist(), strict=True):
        if first - places[-1] > 2 * apart:
            places += [places[-1] + apart, first - apart]
            values += [0.0, 0.0]
        places += [first, last]
        values += [here, here]
    row = np.interp(np.arange(samples), [*places, places[-1] + apart], [*values, 0.0])
    return np.asarray(row, dtype=np.float64)


def _evenly(position: Vector, step: float, half: int) -> Vector:
    """Return the smoothest path within half a step of each reading.

    Smoothing by ever narrower windows alternates with a clip to the range of the readings.
    """
    path = position
    for wider in _WINDOW_FACTORS:
        wide = min(half * wider, (position.size - 1) // 2 - 1)
        for _ in range(_PROJECTIONS):
            smooth = local_polynomial(path, wide, 3)
            path = np.clip(smooth, position - 0.5 * step, position + 0.5 * step)
    return local_polynomial(path, half, 5)


def _rests(position: Vector, least: int) -> list[tuple[int, int]]:
    """Return first and last sample of each stretch of one reading, if it holds as many samples."""
    still = stretches(np.diff(position) == 0.0)
    return [(first, last) for first, last in still if last - first + 1 >= least]


def input_floor(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> Matrix:
    """Return the whitened force errors that encoder errors cause, one row per motion."""
    return problem.whitener(force_errors(problem, fit, errors))


def converter_errors(problem: Problem, fit: Fit, draws: int) -> Matrix:
    """Return the mean errors of the steps in which the force is read (draws x samples).

    Each draw shifts the grid of steps under the fit's force. Noise smaller than a step leaves an
    error that is the same at each visit to a force: a bias in free air, a ripple along the force.
    """
    step = problem.force_step
    if step <= 0.0:
        return np.zeros((draws, problem.force.size))
    noise = before_steps(force_noise(problem.force, step), step)
    clean = fit.force_on(problem.motion)
    shifts = np.random.default_rng(_SEED).uniform(-0.5, 0.5, draws) * step
    return np.array([mean_error(clean + s, step, noise) for s in shifts])


def errors_without_jumps(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> Matrix:
    """Return the same errors for a comparison of fits, clipped at `_JUMP_RATIO`.

    An error may move a sample across the surface, where a damper's force jumps. A draw may do so
    for one fit and not for another with its surface a step away. Such a jump is not typical of the
    recording and would exceed all other errors.
    """
    rows = force_errors(problem, fit, errors)
    most = _JUMP_RATIO * float(np.quantile(np.abs(rows), 0.99))
    return problem.whitener(np.clip(rows, -most, most))


def force_errors(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> Matrix:
    """Return the force errors that encoder errors cause through a model (motions x samples)."""
    clean = fit.force_on(problem.motion)
    return np.array([fit.force_on(one) - clean for one in errors])


def knowing_encoder(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> Problem:
    """Return the problem with the force noise that encoder errors cause through the model.

    A mass or a stiff wall can amplify these errors above the sensor noise. Their spectrum has a
    maximum that no mixture of common colours describes.
    """
    return replace(
        problem, whitener=whiten.knowing(problem.whitener, input_floor(problem, fit, errors))
    )


def within_a_step(problem: Problem, fit: Fit, step: float, own: Matrix) -> Fit:
    """Return the fit with the surface that fits best within one encoder step of its position.

    Position and surface are known to one step: an encoder that truncates reads half a step less
    than one that rounds. This shift is no effect, however large its evidence. `own` is the fit's
    tangent space.
    """
    free = force_of_a_step(problem, fit, step, own)
    energy = float(free @ free)
    if energy == 0.0:
        return fit
    share = float(np.clip(free @ fit.residual / energy, -1.0, 1.0))
    return replace(fit, residual=fit.residual - share * free)


def force_of_a_step(problem: Problem, fit: Fit, step: float, own: Matrix) -> Vector:
    """Return the whitened force by which one encoder step of the surface differs, beside `own`."""
    motion = problem.motion
    if step <= 0.0 or not fit.model.base.touches:
        return np.zeros_like(fit.residual)
    nearer = fit.force_on(replace(motion, x=motion.x + step))
    row = problem.whitener((nearer - fit.force_on(motion))[None, :])[0]
    free = row - own @ (own.T @ row)
    known = float(free @ free) > 1e-8 * float(row @ row)
    return np.asarray(free if known else np.zeros_like(free))
