"""Screening of each law on a grid of its shape, by the part of the residual that it explains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.diagnosis.criteria import SIGMAS
from teleop_rt.diagnosis.inference.coarse import Coarse
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import NOTHING, Fit, Problem, grid, stiffer
from teleop_rt.diagnosis.models.least_squares import explained
from teleop_rt.diagnosis.models.model import (
    JUMPS,
    SURFACE,
    CandidateModel,
    bounds,
    nonlinear_amplitude,
    phases,
)
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.models.simulate import rate_of, run_step
from teleop_rt.diagnosis.noise.saturated import orthonormal
from teleop_rt.diagnosis.noise.structure import jacobian, tangent_space
from teleop_rt.diagnosis.noise.whiten import Matrix
from teleop_rt.diagnosis.samples.motion import RecordedMotion

_SOLVED = 8  # places of a law's grid that are solved, of those that promise most; 3 lost a pair
_SWUNG = 5  # periods of an oscillation; of more, the likeliest are screened
_TONES = 3  # strongest lines of the residual that are screened
_SPANNED = 1e-8  # of a row's energy; a smaller part outside the model is a rounding error
_SURFACES = 5  # from the fit's to the onset of force; a quarter of the way is within the descent
_MOVED_SURFACE = 0.01  # of the travel; a nearer surface is within the descent of a law
_NEEDS_JUMP_RATE = (*JUMPS, "filters_force")
"""Actions of effects that are screened at the rate which resolves the jumps of a contact."""

Place = tuple[Vector, Vector | None]
"""Nonlinear parameters, and a guess of the linear ones."""


@dataclass(frozen=True)
class Start:
    """The start of a fit with one more effect, and the screened fall of chi-square.

    `model` is the fit's with the effect, `zeta` are all its nonlinear parameters; `other` are those
    of a second place from which the fit is tried.
    """

    effect: Effect
    zeta: Vector
    gain: float
    model: CandidateModel
    other: Vector | None = None


def screen(problem: Problem, fit: Fit, effects: tuple[Effect, ...]) -> list[Start]:
    """Return the best start of every law added to `fit`, best first.

    If the base finds the surface, laws without a gain are returned as well: an effect that shifts a
    contact loses by the jumps of the force until the surface moves with it.
    """
    slopes = jacobian(problem, fit)[len(fit.model.linear) :]
    own = tangent_space(problem, fit)
    # With an effect a parameter that its sign or bound holds may leave it.
    whole = orthonormal(np.concatenate([fit.columns, slopes])) if len(fit.columns) else own
    starts: list[Start] = []
    for effect in effects:
        if effect.acts == "adds_force":
            added = _screen_added(problem, fit, own, effect)
            if effect.family == "stiffening" and fit.model.base.finds_surface:
                added = [_at_surfaces(problem, fit, slopes, start) for start in added]
            starts += added
        elif swings(effect):
            starts += [_screen_swing(problem, fit, own, e)
                       for e in _localised(problem, fit, effect)]  # fmt: skip
        else:
            starts += _screen_composed(problem, fit, whole, slopes, effect)
    if not fit.model.base.finds_surface:
        starts = [s for s in starts if s.gain > 0.0]
    return sorted((s for s in starts if np.isfinite(s.gain)), key=lambda s: -s.gain)


def screen_coarsely(
    problem: Problem, lower: tuple[Coarse, Coarse], fit: Fit, effects: tuple[Effect, ...]
) -> list[Start]:
    """Return the best start of every law, screened at the lowest rate that suffices, best first.

    Effects that move a contact or delay its jumps need the higher of the `lower` rates, and tones
    need the full rate, because a tone may lie above a lower band. An oscillation along the stroke
    is screened by derivatives, which have no jumps at any rate.
    """
    effects = tuple(e for e in effects if e.extends is None)
    tones = tuple(e for e in effects if _is_tone(e))
    quick = tuple(e for e in effects if e.acts in _NEEDS_JUMP_RATE and not swings(e))
    others = tuple(e for e in effects if e not in (*tones, *quick))
    starts = screen(problem, fit, tones)
    for rate, some in zip(lower, (quick, others), strict=True):
        starts += screen(*rate.around(problem, fit), some)
    return sorted(starts, key=lambda s: -s.gain)


def _is_tone(effect: Effect) -> bool:
    return any(shape.points == 0 for shape in effect.shapes)


def swings(effect: Effect) -> bool:
    """Return whether the effect oscillates in time or along the stroke, with a phase."""
    return any(shape.phase for shape in effect.shapes)


def _localised(problem: Problem, fit: Fit, effect: Effect) -> list[Effect]:
    """Return the declaration of a tone, narrowed to each of the strongest lines of the residual."""
    if not _is_tone(effect):
        return [effect]
    bins = problem.whitener.bins
    resolution = 1.0 / (problem.motion.dt * problem.force.size)
    power = fit.residual[:bins] ** 2 + fit.residual[bins:] ** 2
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


def _grid(problem: Problem, effect: Effect) -> list[Vector]:
    """Return the grid of the effect's nonlinear parameters without its amplitude."""
    searched = [shape for shape in effect.shapes if not (shape.phase and phases(effect))]
    axes = [grid(shape, problem.motion.scales) for shape in searched]
    return [np.array(point) for point in product(*axes)]


def _screen_added(problem: Problem, fit: Fit, own: Matrix, effect: Effect) -> list[Start]:
    """Screen an additive effect by its part orthogonal to the fitted model."""
    found = []
    for local in _localised(problem, fit, effect):
        signs = np.array(
            [p.nonnegative for p in CandidateModel(NOTHING, (local,)).linear], dtype=bool
        )
        points = _grid(problem, local)
        gains, _ = _gains(problem.rows_of(local, points), own, fit.residual, signs)
        best = int(np.argmax(gains))
        zeta = np.concatenate([fit.zeta, points[best]])
        found.append(Start(local, zeta, float(gains[best]), extended(fit.model, local)))
    return found


def _at_surfaces(problem: Problem, fit: Fit, slopes: Matrix, start: Start) -> Start:
    """Return the start with another place of a stiffening body's surface, nearer to the onset.

    A line through the force of such a body ends inside it. The slopes at that surface may point to
    a shape from which a descent ends where the law is zero.
    """
    shift = start.model.shift(start.zeta)
    if abs(shift) < _MOVED_SURFACE * problem.motion.scales["travel"]:
        return start
    without = fit.chi2 - _gain_of_slopes(fit, slopes)
    best, gain = None, 0.0
    shapes = _grid(problem, start.effect)
    for place, shape in product(np.linspace(shift, 0.0, _SURFACES)[1:], shapes):
        zeta = start.model.shifted(np.concatenate([fit.zeta, shape]), float(place))
        trial = problem.solve(start.model, zeta)
        found = without - (trial.chi2 - _gain_of_slopes(trial, slopes))
        if found > gain:
            best, gain = zeta, found
    return replace(start, gain=max(gain, start.gain), other=best)


def _gains(
    rows: NDArray[np.float64], own: Matrix, residual: Vector, nonnegative: NDArray[np.bool_]
) -> tuple[Vector, Matrix]:
    """Return the fall of chi-square by the rows of each point beyond `own`, and their factors.

    `rows` are points x rows x values. The fall is 0 where the model spans a row, or a factor has
    the wrong sign.
    """
    free = rows - (rows @ own) @ own.T
    gram = free @ free.transpose(0, 2, 1)
    energy = np.diagonal(gram, axis1=1, axis2=2)
    scale = np.sqrt(np.maximum(energy, 1e-300))
    inverse = np.linalg.pinv(gram / (scale[:, :, None] * scale[:, None, :]), 1e-10, hermitian=True)
    right = (free @ residual) / scale
    theta = np.einsum("pij,pj->pi", inverse, right)
    spanned = np.any(energy < _SPANNED * np.einsum("pij,pij->pi", rows, rows), axis=1)
    wrong = np.any(nonnegative & (theta < 0.0), axis=1)
    return np.where(spanned | wrong, 0.0, np.sum(right * theta, axis=1)), theta / scale


def _screen_composed(
    problem: Problem, fit: Fit, own: Matrix, slopes: Matrix, effect: Effect
) -> list[Start]:
    """Screen an effect on position, time or the whole force by full linear fits.

    They are made where the grid promises most. `slopes` are the derivatives by the fit's nonlinear
    parameters. They stay free with and without the effect, because a fit between two jumps of a
    contact could still gain by them.
    """
    own_law = extended(fit.model, effect)
    best = Start(effect, fit.zeta, -np.inf, own_law)
    places: list[Place] = []
    for shape in _grid(problem, effect):
        for amplitude in _amplitudes(problem, fit, own, effect, shape):
            added = np.concatenate([amplitude, shape])
            guess = _guess_near(fit, effect, added)
            zetas = _with_surfaces(problem, fit, own_law, np.concatenate([fit.zeta, added]))
            places += [(zeta, guess) for zeta in zetas]
    without = fit.chi2 - _gain_of_slopes(fit, slopes)
    models = _clamps(problem, fit, own_law)
    if len(models) == 1 or effect.family != "delay":
        places = _most_promising(problem, fit, own, own_law, places)
    for model, (zeta, guess) in product(models, places):
        trial = problem.solve(model, zeta, guess)
        gain = without - (trial.chi2 - _gain_of_slopes(trial, slopes))
        if gain > best.gain:
            best = Start(effect, zeta, gain, model)
    return [best]


def _most_promising(
    problem: Problem, fit: Fit, own: Matrix, model: CandidateModel, places: list[Place]
) -> list[Place]:
    """Return the places at which the model with one more effect gains most, to first order.

    At each the change of the force is exact in the nonlinear parameters, and those of the fit
    adapt linearly (`own`). They do not where a late force took the damping to zero and the clamp
    off, nor without a guess of the linear parameters.
    """
    guessed = [(zeta, guess) for zeta, guess in places if guess is not None]
    if len(guessed) <= _SOLVED:
        return places
    here = force_of(fit.model, problem.motion, fit.zeta, fit.theta)
    change = [force_of(model, problem.motion, zeta, guess) - here for zeta, guess in guessed]
    rows = problem.whitener(np.array(change))
    free = rows - (rows @ own) @ own.T
    left = fit.residual - own @ (own.T @ fit.residual)
    gains = 2.0 * free @ left - np.einsum("ij,ij->i", free, free)
    return [places[i] for i in np.argsort(-gains)[:_SOLVED]]


def _gain_of_slopes(fit: Fit, slopes: Matrix) -> float:
    """Return the fall of chi-square predicted by a fit's slopes, with free linear parameters."""
    if not slopes.shape[0]:
        return 0.0
    return explained(np.concatenate([fit.free_columns, slopes]), fit.residual)


def _with_surfaces(problem: Problem, fit: Fit, model: CandidateModel, zeta: Vector) -> list[Vector]:
    """Return the nonlinear parameters with each surface to try.

    An effect that moves the position moves the surface by the same amount: the base without it
    found the moved surface. An effect that shifts time is also tried with the surface at the onset
    of force.
    """
    effect = model.effects[-1]
    if not model.base.finds_surface or effect.acts not in JUMPS:
        return [zeta]
    if effect.acts == "moves_position":
        return [with_surface(problem, fit, model, zeta)]
    return [zeta, model.shifted(zeta, 0.0)]


def with_surface(problem: Problem, fit: Fit, model: CandidateModel, zeta: Vector) -> Vector:
    """Return the nonlinear parameters with the surface moved by the mean shift of the contact.

    The shift is relative to `fit`.
    """
    there = Course.of(model, problem.motion, zeta).moved.x
    here = Course.of(fit.model, problem.motion, fit.zeta).moved.x
    moved = float(np.mean((there - here)[here > 0.0])) if np.any(here > 0.0) else 0.0
    limits = bounds(SURFACE, problem.motion.scales)
    return model.shifted(zeta, float(np.clip(model.shift(zeta) - moved, *limits)))


def _clamps(problem: Problem, fit: Fit, model: CandidateModel) -> list[CandidateModel]:
    """Return the model, and also its other clamp if the base's force pulls in contact.

    A base without the effect may compensate by its clamp: a contact that never pulls appears to
    pull if its force is read late.
    """
    if fit.model.effects:
        return [model]
    free = replace(fit.model, clamped=False)
    force = force_of(free, problem.motion, fit.zeta, fit.theta)
    noise = np.sqrt(np.mean(problem.whitener.density) / problem.force.size)
    inside = problem.motion.x + free.shift(fit.zeta) > 0.0
    pulls = bool(np.any(inside & (force < -SIGMAS * noise)))
    return [model, replace(model, clamped=not model.clamped)] if pulls else [model]


def _amplitudes(
    problem: Problem, fit: Fit, own: Matrix, effect: Effect, shape: Vector
) -> list[Vector]:
    """Return the amplitudes to screen: a grid, and the least-squares value by the derivative.

    The derivative finds amplitudes far below the grid's smallest step, such as a surface that
    creeps by a hundredth of its bound.
    """
    if not nonlinear_amplitude(effect):
        return [np.zeros(0)]
    found = grid(effect.amplitude, problem.motion.scales)
    least, most = bounds(effect.amplitude, problem.motion.scales)
    tiny = 1e-3 * most
    ends = [
        force_of(model, problem.motion, np.concatenate([fit.zeta, *zeta]), fit.theta)
        for model, zeta in ((fit.model, ()), (extended(fit.model, effect), ([tiny], shape)))
    ]
    row = problem.whitener((ends[1] - ends[0])[None, :] / tiny)[0]
    free = row - own @ (own.T @ row)
    linear = float(free @ fit.residual / max(float(free @ free), 1e-300))
    return [np.array([a]) for a in (*found, linear) if least <= a <= most and a != 0.0]


def _guess_near(fit: Fit, effect: Effect, zeta: Vector) -> Vector | None:
    """Return a guess of the linear parameters with the effect, None if the fit provides none.

    A fit without a force limit has biased parameters, which are no guess for the limited force.
    """
    if effect.acts == "limits_force":
        return None
    return stiffer(fit.model, fit.theta, zeta[0]) if effect.acts == "deflects" else fit.theta


def _screen_swing(problem: Problem, fit: Fit, own: Matrix, effect: Effect) -> Start:
    """Screen a small oscillation of the position by its two derivatives, in time or stroke."""
    model = extended(fit.model, effect)
    small = 1e-3 * problem.motion.scales["travel"]
    period = _likely_periods(problem, fit, own, effect)
    largest = bounds(effect.amplitude, problem.motion.scales)[1]
    still = force_of(fit.model, problem.motion, fit.zeta, fit.theta)
    moved = np.empty((len(period), 2, still.size))
    for i, j in np.ndindex(moved.shape[:2]):
        zeta = np.concatenate([fit.zeta, [small, period[i], 0.5 * np.pi * j]])
        moved[i, j] = force_of(model, problem.motion, zeta, fit.theta) - still
    signs = np.zeros(2, dtype=bool)
    gains, theta = _gains(problem.whitener(moved), own, fit.residual, signs)
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
    still = force_of(fit.model, motion, fit.zeta, fit.theta)
    change = np.zeros((len(periods), 2, still.size))
    swung = motion.made((effect, "swung"), lambda: _swung(motion, effect, periods))
    for name, moved in zip("xva", swung, strict=True):
        row = getattr(motion, name)
        step = 1e-3 * float(np.max(np.abs(row)))
        beside = force_of(fit.model, replace(motion, **{name: row + step}), fit.zeta, fit.theta)
        change += (beside - still) / step * moved
    gains, _ = _gains(problem.whitener(change), own, fit.residual, np.zeros(2, dtype=bool))
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


def extended(model: CandidateModel, effect: Effect) -> CandidateModel:
    """Return the model with one more effect."""
    return replace(model, effects=(*model.effects, effect))
