"""Effects of the encoder's steps on the motion, and on the force through a model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.noise import whiten
from teleop_rt.diagnosis.noise.whiten import Matrix
from teleop_rt.diagnosis.recordings.recording import Recording
from teleop_rt.diagnosis.samples.motion import (
    RecordedMotion,
    differentiate,
    quantisation_step,
    reading_noise,
    resolution_step,
)

_JUMP_RATIO = 4.0  # times the 99 % quantile of errors; larger: a sample on the other side
_ENCODER_DRAWS = 10  # draws of the encoder's errors
_WINDOW_FACTORS, _PROJECTIONS = (8, 4, 2, 1), 6


def input_errors(
    motion: RecordedMotion, recording: Recording, seed: int = 7
) -> list[RecordedMotion]:
    """Return motions as a noisy encoder would have given them, for the same movement.

    A grid of steps is shifted at random under the smoothed position: slow motion then gives the
    slow errors that it gives in truth, where white noise would not. At rest the tool is anywhere
    within the step that is read, and elsewhere in each rest. An encoder's own noise comes before
    its steps. Where steps are not seen, for the position was filtered after it was read, they are
    what its noise would need. Every other motion is that of a path as even as the readings allow:
    at constant speed steps and samples beat, and what is left of that in the smoothed position
    would hide it, unless noise breaks the beat.
    """
    step = resolution_step(recording.position, recording.dt)
    half = motion.half
    rng = np.random.default_rng(seed)
    rests = _rests(recording.position, 2 * half + 1)
    noise = reading_noise(recording.position, recording.dt)
    seen = quantisation_step(recording.position) > 0.0 and noise <= 0.0
    even = _evenly(recording.position, step, half) if seen else motion.x
    evenly = [seen and number % 2 == 1 for number in range(_ENCODER_DRAWS)]
    positions = []
    for on_even in evenly:
        path, apart = (even, 2 * half) if on_even else (motion.x, motion.x.size)
        shift = np.repeat(rng.uniform(0.0, step), path.size)
        if rests.size:
            inside = rng.uniform(-0.5 * step, 0.5 * step, size=(rests.shape[0],))
            shift = shift + _held(rests, inside, apart, path.size)
        moved = path + shift
        if noise > 0.0:
            moved = moved + noise * rng.standard_normal(path.size)
        positions.append(step * np.round(moved / step) - shift)
    *found, plain = zip(*differentiate(np.array([*positions, even]), motion.dt, half), strict=True)
    measured = (motion.x, motion.v, motion.a)
    for number in np.flatnonzero(evenly):
        both = zip(measured, found[number], plain, strict=True)
        found[number] = tuple(row + one - path for row, one, path in both)
    return [replace(motion, x=x, v=v, a=a) for x, v, a in found]


def _held(rests: NDArray[np.intp], within: Vector, apart: int, samples: int) -> Vector:
    """Return a row (samples,) that is `within` in each rest and 0 far from any, `apart` samples.

    Between two rests that are nearer it goes straight from one to the other.
    """
    places, values = [int(rests[0, 0]) - apart], [0.0]
    for (first, last), here in zip(rests.tolist(), within.tolist(), strict=True):
        if first - places[-1] > 2 * apart:
            places += [places[-1] + apart, first - apart]
            values += [0.0, 0.0]
        places += [first, last]
        values += [here, here]
    row = np.interp(np.arange(samples), [*places, places[-1] + apart], [*values, 0.0])
    return np.asarray(row, dtype=np.float64)


def _evenly(position: Vector, step: float, half: int) -> Vector:
    """Return a path as even as it can be within half a step of each reading.

    By projections: smoothed by ever narrower windows, and back to where the readings allow.
    """
    path = position
    for wider in _WINDOW_FACTORS:
        width = min(2 * half * wider + 1, (position.size - 1) // 2 * 2 - 1)
        for _ in range(_PROJECTIONS):
            smooth = scipy.signal.savgol_filter(path, width, 3)
            path = np.clip(smooth, position - 0.5 * step, position + 0.5 * step)
    return np.asarray(scipy.signal.savgol_filter(path, 2 * half + 1, 5), dtype=np.float64)


def _rests(position: Vector, least: int) -> NDArray[np.intp]:
    """Return first and last sample of each stretch of one reading, if it holds as many samples."""
    moves = np.flatnonzero(np.diff(position)) + 1
    first = np.concatenate(([0], moves))
    last = np.concatenate((moves, [position.size])) - 1
    long = last - first + 1 >= least
    return np.column_stack((first[long], last[long]))


def input_floor(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> Matrix:
    """Return the whitened force errors that encoder errors alone make, one row per motion."""
    return problem.whitener(_force_errors(problem, fit, errors))


def errors_without_jumps(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> Matrix:
    """Return the same, for a comparison of fits: errors up to a few times what nearly all have.

    A sample just at the surface may fall on its other side, where a damper's force jumps. That it
    does in a draw for one fit, and not for another whose surface lies a step away, is not typical
    of the recording, and the jump would drown all the rest.
    """
    rows = _force_errors(problem, fit, errors)
    most = _JUMP_RATIO * float(np.quantile(np.abs(rows), 0.99))
    return problem.whitener(np.clip(rows, -most, most))


def _force_errors(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> Matrix:
    clean = force_of(fit.model, problem.motion, fit.zeta, fit.theta)
    return np.array([force_of(fit.model, one, fit.zeta, fit.theta) - clean for one in errors])


def knowing_encoder(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> Problem:
    """Return the problem whose noise holds what encoder errors make of the force through the model.

    Where a mass or a stiff wall turns them into more than the sensor's own noise, they are a hump
    of the spectrum that no mixture of common colours describes.
    """
    return replace(
        problem, whitener=whiten.knowing(problem.whitener, input_floor(problem, fit, errors))
    )


def within_a_step(problem: Problem, fit: Fit, step: float, own: Matrix) -> Fit:
    """Return the fit with the surface where it fits best within an encoder's step of its place.

    Position and surface are known in steps: an encoder that cuts off what another one rounds reads
    half of one less. No effect is needed for that, however well a recording shows it. `own` is the
    fit's tangent space.
    """
    if step <= 0.0 or not fit.model.base.touches:
        return fit
    motion = problem.motion
    force, nearer = (
        force_of(fit.model, place, fit.zeta, fit.theta)
        for place in (motion, replace(motion, x=motion.x + step))
    )
    row = problem.whitener((nearer - force)[None, :])[0]
    free = row - own @ (own.T @ row)
    energy = float(free @ free)
    if energy <= 1e-8 * float(row @ row):
        return fit
    share = float(np.clip(free @ fit.residual / energy, -1.0, 1.0))
    return replace(fit, residual=fit.residual - share * free)
