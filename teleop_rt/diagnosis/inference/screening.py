"""Screening of each law on a grid of its shape, by the part of the residual that it explains."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from teleop_rt.contact.effect import Effect, Matrix
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
    starts: list[Start] = []
    for effect in effects:
        if effect.acts == "adds_force":
            added = _screen_added(problem, fit, own, effect)
            if effect.family == "stiffening" and fit.model.base.finds_surface:
                added = [_at_surfaces(problem, fit, slopes, start) for start in added]
            starts += added
        elif swings(effect):
            starts += [screen_swing(problem, fit, own, e)
                       for e in localised(problem, fit, effect)]  # fmt: skip
        else:
            starts += screen_composed(problem, fit, whole, slopes, effect)
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


def _at_surfaces(problem: Problem, fit: Fit, slopes: Matrix, start: Start) -> Start:
    """Return the start with another place of a stiffening body's surface, nearer to the onset.

    A line through the force of such a body ends inside it. The slopes at that surface may point to
    a shape from which a descent ends where the law is zero.
    """
    shift = start.model.shift(start.zeta)
    if abs(shift) < _MOVED_SURFACE * problem.motion.scales["travel"]:
        return start
    without = fit.chi2 - gain_of_slopes(fit, slopes)
    best, gain = None, 0.0
    shapes = points_of(problem, start.effect)
    for place, shape in product(np.linspace(shift, 0.0, _SURFACES)[1:], shapes):
        zeta = start.model.shifted(np.concatenate([fit.zeta, shape]), float(place))
        trial = problem.solve(start.model, zeta)
        found = without - (trial.chi2 - gain_of_slopes(trial, slopes))
        if found > gain:
            best, gain = zeta, found
    return replace(start, gain=max(gain, start.gain), other=best)
