"""Fits of a set of effects with other laws of its members."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Amplitude, Effect, Scale, Shape
from teleop_rt.diagnosis.models.fit import HOPELESS, Fit, Problem
from teleop_rt.diagnosis.models.model import CandidateModel, in_units


def by_other_laws(problem: Problem, fit: Fit, effects: tuple[Effect, ...]) -> list[Fit]:
    """Return fits with other laws of each member, with every clamp.

    The screening starts from a first effect that is not at its final parameters, so it may prefer
    a wrong law or clamp of the second. No other clamp saves a law that fits far worse.
    """
    scales, fits = problem.motion.scales, []
    places = [(c.owner, c.shape.name) for c in fit.model.coordinates]
    known = dict(zip(places, fit.zeta.tolist(), strict=True))
    for model in _with_other_laws(fit.model, effects):
        start = np.array(
            [known.get((c.owner, c.shape.name), _start(c.shape, scales)) for c in model.coordinates]
        )
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


def _start(shape: Shape | Amplitude, scales: Mapping[Scale, float]) -> float:
    return in_units(shape.start, shape, scales) if isinstance(shape, Shape) else 0.0
