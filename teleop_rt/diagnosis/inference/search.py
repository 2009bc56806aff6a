"""Search of single effects: a screening, then joint fits of the best candidates with the base."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Effect, Shape, Vector
from teleop_rt.diagnosis.inference.coarse import at_lower_rates
from teleop_rt.diagnosis.inference.laws import extended
from teleop_rt.diagnosis.inference.polishing import polished
from teleop_rt.diagnosis.inference.screening import screen_coarsely
from teleop_rt.diagnosis.inference.starts import Start
from teleop_rt.diagnosis.inference.swings import swings
from teleop_rt.diagnosis.models.axes import grid
from teleop_rt.diagnosis.models.base import Base
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import JUMPS, CandidateModel, Past
from teleop_rt.diagnosis.samples.preparation import UNPRESSED

_RECLAMPED = 5  # best fits that are tried with another clamp at zero force
_POLISHED = 12  # best fits whose contact is searched by steps (see `polished`)
_PROMISING_SHARE = 0.3  # of the best screened gain; a law below it is not fitted
_PROMISING_JUMP_SHARE = 0.02  # the same for effects that move a contact: most gain comes in the fit
_MOST_LAWS = 14  # laws with the largest screened gain that are fitted
_LIKELIEST_EFFECTS = 2  # effects of which all laws are fitted
_LIKELY_EFFECTS = 5  # effects of which all promising laws are fitted
_PASTS: tuple[Past, ...] = ("contacts", "rest")
_LARGEST_PAST_FORCE = 3.0  # times the largest force; an earlier contact was no stronger


def fit_base(problem: Problem, base: Base, near: Fit | None = None) -> Fit:
    """Return the better fit of the base alone, with or without a clamp at zero force.

    `near` is a fit with other weights, from whose parameters this one starts: equal weights show
    the jump of a contact, and weights of red noise add local minima far from it.
    """
    models = [CandidateModel(base)]
    if base.touches:
        models.append(CandidateModel(base, clamp="base"))
    start = np.array([c.shape.start if isinstance(c.shape, Shape) else 0.0
                      for c in models[0].coordinates]) if near is None else near.zeta  # fmt: skip
    fits = [polished(problem, problem.refine(model, start)) for model in models]
    return min(fits, key=lambda fit: fit.chi2)


def fit_start(problem: Problem, start: Start, evaluations: int = 15, beat: float = math.inf) -> Fit:
    """Return the joint fit of a model and the effect that the start adds to it.

    A model without the effect may have moved its surface to compensate, and chi-square has a local
    minimum there. The fit starts with the surface at the onset of force if that fits better.
    """
    model, zeta = start.model, start.zeta
    if model.base.finds_surface:
        at_onset = [model.shifted(other, 0.0) for other in (zeta, *_reshaped(problem, start))]
        places = [zeta, *at_onset]
        zeta = min(places, key=lambda place: problem.solve(model, place).chi2)
    starts = [zeta] if start.other is None else [zeta, start.other]
    fits = [problem.refine(model, place, evaluations, beat) for place in starts]
    return min(fits, key=lambda fit: fit.chi2)


def _reshaped(problem: Problem, start: Start) -> list[Vector]:
    """Return the start with the single shape of an added force at each screened value.

    The screening used the surface of the base alone. With the surface at the onset of force another
    shape fits best, and a descent from the wrong shape ends where the surface compensates for it.
    """
    shapes = start.effect.shapes
    if start.effect.acts != "adds_force" or len(shapes) != 1 or swings(start.effect):
        return []
    values = grid(shapes[0], problem.motion.scales)
    return [np.append(start.zeta[:-1], value) for value in values]


def best_by_name(fits: list[Fit]) -> list[Fit]:
    """Return the best law of each set of names, best first."""
    best: dict[tuple[str, ...], Fit] = {}
    for fit in fits:
        key = tuple(sorted(fit.names))
        if key not in best or fit.bic < best[key].bic:
            best[key] = fit
    return sorted(best.values(), key=lambda fit: fit.bic)


def search_singles(problem: Problem, base: Fit, effects: tuple[Effect, ...]) -> list[Fit]:
    """Return the fitted single-effect models, best first."""
    starts = screen_coarsely(problem, at_lower_rates(problem), base, effects)
    fits = laws = _promising(problem, base, starts, effects)
    if base.model.base.finds_surface:
        # The base was polished as well, so the fits are comparable.
        fits = [polished(problem, fit) if _jumps(fit) else fit for fit in fits]
        fits = best_by_name(fits)
        fits = [fit if _jumps(fit) else polished(problem, fit) for fit in fits[:_POLISHED]] + fits[
            _POLISHED:
        ]
    return _with_other_clamps_and_pasts(problem, base, best_by_name(fits), laws)


def _with_other_clamps_and_pasts(
    problem: Problem, base: Fit, fits: list[Fit], laws: list[Fit]
) -> list[Fit]:
    """Return the fits better than the base, best first, with other clamps and pasts tried.

    A fading memory may contain a contact from before the recording, and the likeliest law of an
    effect can change when that past is fitted.
    """
    fits = fits + [with_other_clamp(problem, fit) for fit in fits[:_RECLAMPED]]
    fits += [with_past(problem, fit) for fit in _fading(problem, [*laws, *fits])]
    return best_by_name([fit for fit in fits if fit.chi2 < base.chi2])


def _fading(problem: Problem, fits: list[Fit]) -> list[Fit]:
    """Return the best fits of laws that fade, among them the best one of each effect.

    Without its past a law may fit worse than all laws of another effect.
    """
    best: dict[tuple[str, str], Fit] = {}
    for fit in sorted((fit for fit in fits if fades(problem, fit)), key=lambda fit: fit.bic):
        best.setdefault((fit.names[0], fit.model.effects[0].law), fit)
    chosen = [*best.values()][:_RECLAMPED]
    names = {fit.names[0] for fit in chosen}
    return chosen + [fit for fit in best_by_name([*best.values()]) if fit.names[0] not in names]


def _promising(
    problem: Problem, base: Fit, starts: list[Start], effects: tuple[Effect, ...]
) -> list[Fit]:
    """Return fits of the most promising laws, and of one law of each other promising effect.

    With little excitation many effects explain the residual equally well, and each must be fitted.
    A biased base, or another law, can favour a wrong law of an effect: all laws of the likeliest
    ones are fitted, and the promising laws of some more, unless their descent is hopeless. One
    that extends a law is fitted from there, if that is likelier than the base.
    """
    if not starts:
        return []
    chosen = _chosen(problem, base, starts)
    fits = [fit_start(problem, s) for s in chosen]
    likely = best_by_name(fits)[:_LIKELY_EFFECTS]
    names = [fit.names[0] for fit in likely]
    every, some = names[:_LIKELIEST_EFFECTS], names[_LIKELIEST_EFFECTS:]
    for fit in likely[:_LIKELIEST_EFFECTS]:
        fits += extended(problem, fit, effects) if fit.bic < base.bic else []
    others = [s for s in starts if not any(s is one for one in chosen)]
    fits += [fit_start(problem, s) for s in others if s.effect.name in every]
    rest = [s for s in others if s.effect.name in some and _promises(s, starts[0])]
    return fits + [fit_start(problem, s, beat=likely[0].chi2) for s in rest]


def _promises(start: Start, best: Start) -> bool:
    """Return whether a law is worth a fit beside the best start.

    The screened gain of an effect that moves a contact, or gives way to the force, is small: its
    descent finds the rest.
    """
    descends = start.effect.acts in (*JUMPS, "deflects")
    least = _PROMISING_JUMP_SHARE if descends else _PROMISING_SHARE
    return start.gain > max(10.0, least * best.gain)


def _chosen(problem: Problem, base: Fit, starts: list[Start]) -> list[Start]:
    """Return the best of the promising starts, and one of each other effect that promises."""
    promising = [s for s in starts if _promises(s, starts[0])]
    chosen, left = promising[:_MOST_LAWS], promising[_MOST_LAWS:]
    if base.model.base.has_power:
        # A shift of the depth changes the base's power; at the old power its gain is small.
        left += [s for s in starts if not _promises(s, starts[0]) and _shifts_depth(s.effect)]
    for start in left:
        if start.effect.name not in {s.effect.name for s in chosen}:
            chosen.append(start)
    if base.model.base.has_power and base.model.base.finds_surface:
        chosen += _at_other_depths(problem, starts)
    return chosen


def _at_other_depths(problem: Problem, starts: list[Start]) -> list[Start]:
    """Return starts of the stiffening effects at two more values of their depth.

    The power and the surface of the base adapt to a stiffening body and hide it at its own depth.
    From other starts its stiffness, which cannot be negative, stays at 0.
    """
    found: list[Start] = []
    for start in (s for s in starts if s.effect.family == "stiffening" and s.effect.shapes):
        depths = grid(start.effect.shapes[-1], problem.motion.scales)
        found += [
            replace(start, zeta=np.append(start.zeta[:-1], depths[len(depths) // part]))
            for part in (2, 4)
        ]
    return found


def fades(problem: Problem, fit: Fit) -> bool:
    """Return whether an effect of the fit may still depend on the time before the recording.

    It may not if the recording begins with the tool off the body at its outermost position: the
    trial begins there, and a past would adapt the law to this recording alone.
    """
    x = problem.motion.x
    nearly = UNPRESSED * float(np.max(x))
    if x[0] < nearly and x[0] - float(np.min(x)) < nearly:
        return False
    return fit.model.past == "none" and any(effect.fades for effect in fit.model.effects)


def with_past(problem: Problem, fit: Fit) -> Fit:
    """Return the fit after earlier contacts, or after a rest if that is likelier.

    Earlier contacts are not fitted if they need more than `_LARGEST_PAST_FORCE`: a memory that
    fades before the first counted sample does not determine its past.
    """
    found, rested = (
        problem.refine(replace(fit.model, past=past), fit.zeta, evaluations=8) for past in _PASTS
    )
    made, less = (one.force_on(problem.motion) for one in (found, found.elsewhere))
    most = _LARGEST_PAST_FORCE * problem.motion.scales["force"]
    best = found if float(np.max(np.abs(made - less))) < most else fit
    return min(best, rested, key=lambda one: one.bic)


def _jumps(fit: Fit) -> bool:
    """Return whether an effect of the fit moves a contact, beside the surface itself."""
    return any(c.owner >= 0 and fit.model.moves_contact(c) for c in fit.model.coordinates)


def _shifts_depth(effect: Effect) -> bool:
    return effect.acts in {"moves_position", "deflects"} and not swings(effect)


def with_other_clamp(problem: Problem, fit: Fit) -> Fit:
    """Return the best fit with another clamp at zero force, which an effect may have hidden."""
    model = fit.model
    others = [
        problem.refine(replace(model, clamp=clamp), fit.zeta, evaluations=6)
        for clamp in model.clamps
        if clamp != model.clamp
    ]
    return min(others, key=lambda other: other.chi2, default=fit)
