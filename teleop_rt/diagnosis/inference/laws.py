"""Fits of a set of effects with other laws of its members."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Amplitude, Effect, Scale, Shape
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import in_units


def by_other_laws(problem: Problem, fit: Fit, effects: tuple[Effect, ...]) -> list[Fit]:
    """Return fits with other laws of each member, with every clamp.

    The screening starts from a first effect that is not at its final parameters, so it may prefer
    a wrong law or clamp of the second.
    """
    scales, fits = problem.motion.scales, []
    places = [(c.owner, c.shape.name) for c in fit.model.coordinates]
    known = dict(zip(places, fit.zeta.tolist(), strict=True))
    clamps = fit.model.clamps
    for member, effect in enumerate(fit.model.effects):
        for law in effects:
            if law.name != effect.name or law.law == effect.law:
                continue
            if law.extends not in {None, effect.law}:
                continue
            members = (*fit.model.effects[:member], law, *fit.model.effects[member + 1 :])
            for clamp in clamps:
                model = replace(fit.model, effects=members, clamp=clamp)
                zeta = [
                    known.get((c.owner, c.shape.name), _start(c.shape, scales))
                    for c in model.coordinates
                ]
                fits.append(problem.refine(model, np.array(zeta)))
    return fits


def extended(problem: Problem, fit: Fit, effects: tuple[Effect, ...]) -> list[Fit]:
    """Return fits with the laws that extend a member's law, from its parameters."""
    return by_other_laws(problem, fit, tuple(e for e in effects if e.extends is not None))


def _start(shape: Shape | Amplitude, scales: Mapping[Scale, float]) -> float:
    return in_units(shape.start, shape, scales) if isinstance(shape, Shape) else 0.0
