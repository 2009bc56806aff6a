"""Fits of a set of effects with other laws of its members."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from teleop_rt.contact.effect import Amplitude, Effect, Scale, Shape, Vector
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import HOPELESS, Fit, Problem
from teleop_rt.diagnosis.models.model import CandidateModel, in_units


def friction_beside_delay(
    problem: Problem, fits: list[Fit], effects: tuple[Effect, ...]
) -> list[Fit]:
    """Return fits of each law of the frictions among the fits, beside a delay of the force.

    Of a force that is read late, a law with presliding explains most, and no delay gains beside it.
    A fit whose force is ahead is left out: a lead stands in for a friction's damping.
    """
    delays = [effect for effect in effects if effect.acts == "shifts_time" and not effect.extends]
    found: list[Fit] = []
    for fit in fits:
        families = {effect.family for effect in fit.model.effects}
        if "friction" not in families or "delay" in families:
            continue
        for delay, model in product(delays, [fit.model, *_with_other_laws(fit.model, effects)]):
            late = replace(model, effects=(*model.effects, delay))
            best = min((one.chi2 for one in found), default=fit.chi2)
            found.append(problem.refine(late, _start_near(problem, fit, late), beat=best))
    return [one for one in found if Course.of(one.model, problem.motion, one.zeta).lag > 0.0]


def by_other_laws(problem: Problem, fit: Fit, effects: tuple[Effect, ...]) -> list[Fit]:
    """Return fits with other laws of each member, with every clamp.

    The screening starts from a first effect that is not at its final parameters, so it may prefer
    a wrong law or clamp of the second. No other clamp saves a law that fits far worse.
    """
    fits = []
    for model in _with_other_laws(fit.model, effects):
        start = _start_near(problem, fit, model)
        found = problem.refine(model, start, beat=fit.chi2)
        fits.append(found)
        if found.chi2 < HOPELESS * fit.chi2:
            others = [replace(model, clamp=c) for c in model.clamps if c != model.clamp]
            fits += [problem.refine(other, start, beat=fit.chi2) for other in others]
    return fits


def _with_other_laws(
    model: CandidateModel, effects: tuple[Effect, ...]
) -> Iterator[CandidateModel]:
    """Give the model with each other law of each member."""
    for member, effect in enumerate(model.effects):
        for law in effects:
            if law.name != effect.name or law.law == effect.law:
                continue
            if law.extends in {None, effect.law}:
                members = (*model.effects[:member], law, *model.effects[member + 1 :])
                other = replace(model, effects=members)
                yield other if model.clamp in other.clamps else replace(other, clamp="none")


def extended(problem: Problem, fit: Fit, effects: tuple[Effect, ...]) -> list[Fit]:
    """Return fits with the laws that extend a member's law, from its parameters."""
    return by_other_laws(problem, fit, tuple(e for e in effects if e.extends is not None))


def _start_near(problem: Problem, fit: Fit, model: CandidateModel) -> Vector:
    """Return the nonlinear parameters of a model: those it shares with a fit, and starts."""
    places = [(c.owner, c.shape.name) for c in fit.model.coordinates]
    known = dict(zip(places, fit.zeta.tolist(), strict=True))
    scales = problem.motion.scales
    return np.array(
        [known.get((c.owner, c.shape.name), _start(c.shape, scales)) for c in model.coordinates]
    )


def _start(shape: Shape | Amplitude, scales: Mapping[Scale, float]) -> float:
    return in_units(shape.start, shape, scales) if isinstance(shape, Shape) else 0.0
