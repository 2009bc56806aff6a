"""Screening of effects on position, time or the whole force, by full linear fits."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from teleop_rt.contact.effect import Effect, Matrix, Vector
from teleop_rt.diagnosis.criteria import SIGMAS
from teleop_rt.diagnosis.inference.starts import Start, extended, gain_of_slopes, points_of
from teleop_rt.diagnosis.models.axes import grid
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem, stiffer
from teleop_rt.diagnosis.models.model import (
    JUMPS,
    SURFACE,
    CandidateModel,
    Clamp,
    bounds,
    nonlinear_amplitude,
)
from teleop_rt.diagnosis.models.predict import force_of

_SOLVED = 8  # places of a law's grid that are solved, of those that promise most; 3 lost a pair
Place = tuple[Vector, Vector | None]
"""Nonlinear parameters, and a guess of the linear ones."""


def screen_composed(
    problem: Problem, fit: Fit, here: Vector, own: Matrix, slopes: Matrix, effect: Effect
) -> list[Start]:
    """Screen an effect on position, time or the whole force by full linear fits.

    They are made where the grid promises most. `here` is the force that the fit predicts, and
    `slopes` are the derivatives by the fit's nonlinear parameters. They stay free with and without
    the effect, because a fit between two jumps of a contact could still gain by them.
    """
    own_law = extended(fit.model, effect)
    best = Start(effect, fit.zeta, -np.inf, own_law)
    places: list[Place] = []
    for shape in points_of(problem, effect):
        for amplitude in _amplitudes(problem, fit, here, own, effect, shape):
            added = np.concatenate([amplitude, shape])
            guess = _guess_near(fit, effect, added, problem.motion.scales["force"])
            zetas = _with_surfaces(problem, fit, own_law, np.concatenate([fit.zeta, added]))
            places += [(zeta, guess) for zeta in zetas]
    without = fit.chi2 - gain_of_slopes(fit, slopes)
    models = _clamps(problem, fit, own_law)
    if len(models) == 1 or effect.family != "delay":
        places = _most_promising(problem, fit, here, own, own_law, places)
    for model, (zeta, guess) in product(models, places):
        trial = problem.solve(model, zeta, guess)
        gain = without - (trial.chi2 - gain_of_slopes(trial, slopes))
        if gain > best.gain:
            best = Start(effect, zeta, gain, model)
    return [best]


def _most_promising(
    problem: Problem,
    fit: Fit,
    here: Vector,
    own: Matrix,
    model: CandidateModel,
    places: list[Place],
) -> list[Place]:
    """Return the places at which the model with one more effect gains most, to first order.

    At each the change of the force is exact in the nonlinear parameters, and those of the fit
    adapt linearly (`own`). They do not where a late force took the damping to zero and the clamp
    off, nor without a guess of the linear parameters.
    """
    guessed = [(zeta, guess) for zeta, guess in places if guess is not None]
    if len(guessed) <= _SOLVED:
        return places
    change = [force_of(model, problem.motion, zeta, guess) - here for zeta, guess in guessed]
    rows = problem.whitener(np.array(change))
    free = rows - (rows @ own) @ own.T
    left = fit.residual - own @ (own.T @ fit.residual)
    gains = 2.0 * free @ left - np.einsum("ij,ij->i", free, free)
    return [places[i] for i in np.argsort(-gains)[:_SOLVED]]


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
    free = replace(fit.model, clamp="none")
    force = force_of(free, problem.motion, fit.zeta, fit.theta)
    noise = np.sqrt(np.mean(problem.whitener.density) / problem.force.size)
    inside = problem.motion.x + free.shift(fit.zeta) > 0.0
    pulls = bool(np.any(inside & (force < -SIGMAS * noise)))
    other: Clamp = "base" if model.clamp == "none" else "none"
    return [model, replace(model, clamp=other)] if pulls else [model]


def _amplitudes(
    problem: Problem, fit: Fit, here: Vector, own: Matrix, effect: Effect, shape: Vector
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
    zeta = np.concatenate([fit.zeta, [tiny], shape])
    there = force_of(extended(fit.model, effect), problem.motion, zeta, fit.theta)
    row = problem.whitener((there - here)[None, :] / tiny)[0]
    free = row - own @ (own.T @ row)
    linear = float(free @ fit.residual / max(float(free @ free), 1e-300))
    return [np.array([a]) for a in (*found, linear) if least <= a <= most and a != 0.0]


def _guess_near(fit: Fit, effect: Effect, zeta: Vector, strongest: float) -> Vector | None:
    """Return a guess of the linear parameters with the effect, None if the fit provides none.

    `strongest` is the recording's largest force. A fit without a force limit has biased parameters,
    which are no guess for the limited force.
    """
    if effect.acts == "limits_force":
        return None
    if effect.acts == "deflects":
        return stiffer(fit.model, fit.theta, effect, (float(zeta[0]), zeta[1:]), strongest)
    return fit.theta
