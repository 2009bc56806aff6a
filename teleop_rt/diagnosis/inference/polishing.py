"""Pattern search of the parameters that move a contact, where chi-square has steps."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.inference.composed import with_surface
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import bounds

_STEPS = (3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4)  # of a parameter's range, tried in this order
_MOST_STEPS = 8  # in one direction, each as long as the last one or twice as long
_SURFACE_GAPS = 6  # gaps between samples tried on either side of the surface
_MOST_PATTERNS = 6  # rounds of steps along the valley of surface and effect
_LEAST_ROUND_GAIN = 0.03  # of chi-square; a round that lowers it less is the last


def polished(problem: Problem, fit: Fit) -> Fit:
    """Return the fit after a pattern search of the parameters that move a contact.

    A damper's force jumps at a contact, so chi-square has a step wherever the contact passes a
    sample. Gradient descent stops at the first step (on a recording without noise at 17 times the
    least chi-square), and a rival with more parameters then wins. The search steps one parameter
    after the other, then extrapolates their joint step (Hooke and Jeeves), because surface and
    effect share a narrow valley.
    """
    for _ in range(_MOST_PATTERNS):
        before, fit = fit, _stepped(problem, fit)
        if fit.chi2 >= before.chi2:
            break
        there = _extrapolated(problem, fit, fit.zeta - before.zeta)
        if there.chi2 > (1.0 - _LEAST_ROUND_GAIN) * fit.chi2:
            return there
        fit = there
    return fit


def _stepped(problem: Problem, fit: Fit) -> Fit:
    """Return the fit after steps of each parameter that moves a contact."""
    if fit.model.base.finds_surface:
        fit = _between_samples(problem, fit)
    for place, coordinate in enumerate(fit.model.coordinates):
        if not fit.model.moves_contact(coordinate):
            continue
        taken_along = fit.model.base.finds_surface and coordinate.owner >= 0
        lower, upper = bounds(coordinate.shape, problem.motion.scales)
        for move in (sign * step * (upper - lower) for step in _STEPS for sign in (1.0, -1.0)):
            along = np.zeros(fit.zeta.size)
            along[place] = move
            fit = _line_search(problem, fit, along, 1.0)
            if taken_along:
                there = with_surface(problem, fit, fit.model, fit.zeta + along)
                fit = _line_search(problem, fit, there - fit.zeta, 1.0)
    return fit


def _between_samples(problem: Problem, fit: Fit) -> Fit:
    """Return the fit with the surface in the best of the nearest gaps between two samples.

    The force jumps whenever the surface passes a sample, and is smooth within a gap. A gap may be
    narrower than any of `_STEPS`.
    """
    shift = fit.model.shift(fit.zeta)
    depth = Course.of(fit.model, problem.motion, fit.zeta).moved.x
    near = np.unique(depth[problem.whitener.mask > 0.0])
    here = int(np.searchsorted(near, 0.0))
    around = near[max(here - _SURFACE_GAPS, 0) : here + _SURFACE_GAPS]
    best = fit
    for middle in 0.5 * (around[1:] + around[:-1]):
        zeta = fit.model.shifted(fit.zeta, shift - middle)
        best = min(best, problem.solve(fit.model, zeta, fit.theta), key=lambda f: f.chi2)
    return best


def _extrapolated(problem: Problem, fit: Fit, way: Vector) -> Fit:
    """Return the fit extrapolated along a joint step, with growing steps."""
    return _line_search(problem, fit, way, 2.0) if np.count_nonzero(way) > 1 else fit


def _line_search(problem: Problem, fit: Fit, step: Vector, growth: float) -> Fit:
    """Return the fit after all steps that lower chi-square, each `growth` times the last one."""
    limits = [bounds(c.shape, problem.motion.scales) for c in fit.model.coordinates]
    for _ in range(_MOST_STEPS):
        zeta = fit.zeta + step
        if not all(low <= z <= high for z, (low, high) in zip(zeta, limits, strict=True)):
            break
        trial = problem.solve(fit.model, zeta, fit.theta)
        if trial.chi2 >= fit.chi2:
            break
        fit, step = trial, growth * step
    return fit
