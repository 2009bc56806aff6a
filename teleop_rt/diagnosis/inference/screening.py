"""Screening of each law on a grid of its shape, by the part of the residual that it explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Effect, Matrix, Vector
from teleop_rt.diagnosis.inference.coarse import Coarse
from teleop_rt.diagnosis.inference.composed import screen_composed
from teleop_rt.diagnosis.inference.starts import (
    Start,
    chi2_falls,
    extended,
    gain_of_slopes,
    points_of,
)
from teleop_rt.diagnosis.inference.swings import is_tone, localised, screen_swing, swings
from teleop_rt.diagnosis.models.fit import NOTHING, Fit, Problem
from teleop_rt.diagnosis.models.least_squares import signed_solution
from teleop_rt.diagnosis.models.model import JUMPS, CandidateModel
from teleop_rt.diagnosis.noise.saturated import orthonormal
from teleop_rt.diagnosis.noise.structure import jacobian, tangent_space

_SURFACES = 5  # from the fit's to the onset of force; a quarter of the way is within the descent
_MOVED_SURFACE = 0.01  # of the travel; a nearer surface is within the descent of a law
_NEEDS_JUMP_RATE = (*JUMPS, "filters_force")
"""Actions of effects that are screened at the rate which resolves the jumps of a contact."""


def screen(problem: Problem, fit: Fit, effects: tuple[Effect, ...]) -> list[Start]:
    """Return the best start of every law added to `fit`, best first.

    If the base finds the surface, laws without a gain are returned as well: an effect that shifts a
    contact loses by the jumps of the force until the surface moves with it.
    """
    slopes = jacobian(problem, fit)[len(fit.model.linear) :]
    own = tangent_space(problem, fit)
    # With an effect a parameter that its sign or bound holds may leave it.
    whole = orthonormal(np.concatenate([fit.columns, slopes])) if len(fit.columns) else own
    here: Vector | None = None
    starts: list[Start] = []
    for effect in effects:
        if effect.acts == "adds_force":
            starts += _screen_added(problem, fit, own, effect)
        elif swings(effect):
            starts += [screen_swing(problem, fit, own, e)
                       for e in localised(problem, fit, effect)]  # fmt: skip
        else:
            here = fit.force_on(problem.motion) if here is None else here
            starts += screen_composed(problem, fit, here, whole, slopes, effect)
    if fit.model.base.finds_surface:
        starts = _at_surfaces(problem, fit, slopes, starts)
    else:
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
    tones = tuple(e for e in effects if is_tone(e))
    quick = tuple(e for e in effects if e.acts in _NEEDS_JUMP_RATE and not swings(e))
    others = tuple(e for e in effects if e not in (*tones, *quick))
    starts = screen(problem, fit, tones)
    for rate, some in zip(lower, (quick, others), strict=True):
        starts += screen(*rate.around(problem, fit), some)
    return sorted(starts, key=lambda s: -s.gain)


def _screen_added(problem: Problem, fit: Fit, own: Matrix, effect: Effect) -> list[Start]:
    """Screen an additive effect by its part orthogonal to the fitted model."""
    found = []
    for local in localised(problem, fit, effect):
        signs = CandidateModel(NOTHING, (local,)).nonnegative
        points = points_of(problem, local)
        gains, _ = chi2_falls(problem.rows_of(local, points), own, fit.residual, signs)
        best = int(np.argmax(gains))
        zeta = np.concatenate([fit.zeta, points[best]])
        found.append(Start(local, zeta, float(gains[best]), extended(fit.model, local)))
    return found


def _at_surfaces(problem: Problem, fit: Fit, slopes: Matrix, starts: list[Start]) -> list[Start]:
    """Return the starts with another place of a stiffening body's surface, nearer to the onset.

    A line through the force of such a body ends inside it. The slopes at that surface may point to
    a shape from which a descent ends where the law is zero.
    """
    stiffening = [s for s in starts if s.effect.family == "stiffening"
                  and s.effect.acts == "adds_force"]  # fmt: skip
    shift = fit.model.shift(fit.zeta)
    if not stiffening or abs(shift) < _MOVED_SURFACE * problem.motion.scales["travel"]:
        return starts
    places = [fit.model.shifted(fit.zeta, z) for z in np.linspace(shift, 0.0, _SURFACES)[1:]]
    there = [problem.solve(fit.model, place) for place in places]
    without = fit.chi2 - gain_of_slopes(fit, slopes)
    others = [s for s in starts if not any(s is one for one in stiffening)]
    return others + [_at_best(problem, there, slopes, without, start) for start in stiffening]


def _at_best(
    problem: Problem, there: list[Fit], slopes: Matrix, without: float, start: Start
) -> Start:
    """Return the start with its best shape and surface, of the fits `there` without its effect.

    `without` is the chi-square to lower. The slopes of the nonlinear parameters stay free.
    """
    best, gain, shapes = None, 0.0, points_of(problem, start.effect)
    signs = CandidateModel(NOTHING, (start.effect,)).nonnegative
    for fit in there:
        rows = problem.rows_of(start.effect, shapes, fit.model.shift(fit.zeta))
        for shape, row in zip(shapes, rows, strict=True):
            found = without - _least_with(fit, row, signs, slopes)
            if found > gain:
                best, gain = np.concatenate([fit.zeta, shape]), found
    return replace(start, gain=max(gain, start.gain), other=best)


def _least_with(fit: Fit, added: Matrix, signs: NDArray[np.bool_], slopes: Matrix) -> float:
    """Return the chi-square of a fit with added rows, to first order by the slopes beyond these."""
    number = len(fit.columns) + len(added)
    rows = np.concatenate([fit.columns, added, slopes])
    target = fit.residual + fit.theta @ fit.columns
    products = rows @ np.concatenate([rows, target[None, :]]).T
    nonnegative = np.concatenate([fit.model.nonnegative, signs])
    within = np.append(np.arange(number), len(rows))
    theta = signed_solution(products[:number, within], nonnegative)
    left = products[:, -1] - products[:, :number] @ theta
    chi2 = float(target @ target - theta @ (products[:number, -1] + left[:number]))
    free = np.concatenate([theta != 0.0, np.ones(len(slopes), dtype=bool)])
    further = signed_solution(np.column_stack([products[np.ix_(free, free)], left[free]]),
                              np.zeros(np.count_nonzero(free), dtype=bool))  # fmt: skip
    return chi2 - float(left[free] @ further)
