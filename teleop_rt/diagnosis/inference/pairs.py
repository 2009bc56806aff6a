"""A second effect: searched on top of the best single ones, kept only where it is needed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import WITHOUT_CONTACT, Amplitude, Effect, Scale, Shape, Vector
from teleop_rt.diagnosis.criteria import CERTAIN_BIC
from teleop_rt.diagnosis.inference.coarse import Coarse, at_lower_rates
from teleop_rt.diagnosis.inference.screening import Start, look
from teleop_rt.diagnosis.inference.search import (
    best_by_name,
    fades,
    fit_start,
    otherwise_clamped,
    with_past,
)
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import Model

FIRSTS = 5  # single effects on which a second is sought
MOST = 0.2  # of the best gain; a first that explains less leads to no pair
SECONDS = 12  # pairs that are fitted, of those that promise most
_EXCHANGED = 3  # fits in the place of each member, which may be there for the other's shape
_RUBS = {"coulomb_friction", "stribeck_friction", "hysteresis"}
_NESTED = (
    {"coulomb_friction", "stribeck_friction"},
    {"stress_relaxation", "fractional_relaxation"},
)


def search_pairs(
    problem: Problem,
    base: Fit,
    singles: list[Fit],
    effects: tuple[Effect, ...],
) -> list[Fit]:
    """Return fitted pairs, best first.

    Sought on top of the single effects that explain most of what the best of them does: the other
    member of a pair is found there, also where it is too small to show alone.
    """
    starts = _starts(problem, at_lower_rates(problem), base, singles, effects)
    fits = [fit_start(problem, start, evaluations=10) for start in starts]
    fits = best_by_name(fits)
    fits += [otherwise_clamped(problem, fit) for fit in fits[:2]]
    fits += by_other_laws(problem, fits[0], effects) if fits else []
    fits += [with_past(problem, fit) for fit in best_by_name(fits)[:2] if fades(problem, fit)]
    return best_by_name(fits)


def glance_at_pairs(
    problem: Problem, base: Fit, singles: list[Fit], effects: tuple[Effect, ...]
) -> list[Fit]:
    """Return pairs fitted at a lower rate, best first: for what they leave, not as candidates."""
    lower = at_lower_rates(problem)
    starts = _starts(problem, lower, base, singles, effects)
    near, _ = lower[0].around(problem, min(singles, key=lambda fit: fit.chi2))
    return best_by_name([fit_start(near, start, evaluations=10) for start in starts])


def _starts(
    problem: Problem,
    lower: tuple[Coarse, Coarse],
    base: Fit,
    singles: list[Fit],
    effects: tuple[Effect, ...],
) -> list[Start]:
    """Return where the likeliest pairs start, on top of the single effects that explain most."""
    found: list[tuple[float, str, Start]] = []
    least = min(fit.chi2 for fit in singles)
    firsts = [f for f in singles if f.chi2 - least <= (1.0 - MOST) * (base.chi2 - least)]
    for first in firsts[:FIRSTS]:
        others = tuple(e for e in effects if not same_physics(e, first.model.effects[0]))
        seconds = look(problem, lower, first, others)[:8]
        found += [(first.chi2 - s.gain, first.names[0], s) for s in seconds]
    found.sort(key=lambda item: item[0])
    chosen: dict[tuple[str, ...], Start] = {}
    for _, first_name, start in found:
        chosen.setdefault((first_name, start.effect.name, start.effect.law), start)
    return list(chosen.values())[:SECONDS]


def by_other_laws(problem: Problem, pair: Fit, effects: tuple[Effect, ...]) -> list[Fit]:
    """Return the pair with other laws of its members, each with a contact that pulls and one not.

    Beside a first effect that is not yet where it belongs, the law that shows most may be another
    one's, and so may the clamp.
    """
    scales, fits = problem.motion.scales, []
    places = [(c.owner, c.shape.name) for c in pair.model.coordinates]
    known = dict(zip(places, pair.zeta.tolist(), strict=True))
    clamps = pair.model.clamps
    for member, effect in enumerate(pair.model.effects):
        for law in effects:
            if law.name != effect.name or law.law == effect.law:
                continue
            members = (*pair.model.effects[:member], law, *pair.model.effects[member + 1 :])
            for clamped, whole in clamps:
                model = replace(
                    pair.model, effects=members, clamped=clamped, clamped_with_effects=whole
                )
                zeta = [
                    known.get((c.owner, c.shape.name), _start(c.shape, scales))
                    for c in model.coordinates
                ]
                fits.append(problem.refine(model, np.array(zeta)))
    return fits


def _start(shape: Shape | Amplitude, scales: Mapping[Scale, float]) -> float:
    return shape.start * scales[shape.relative_to] if isinstance(shape, Shape) else 0.0


def exchanged(problem: Problem, pair: Fit, effects: tuple[Effect, ...]) -> list[Fit]:
    """Return fitted pairs that hold one member of a pair, and another one in the other's place.

    Sought from where the pair has brought the member that stays: alone it may be bent so far that
    the right companion does not show.
    """
    lower, fits = at_lower_rates(problem), []
    for member in range(len(pair.names)):
        kept = problem.solve(*without(pair, member))
        others = tuple(
            e
            for e in effects
            if e.name != pair.names[member] and not same_physics(e, kept.model.effects[0])
        )
        starts = look(problem, lower, kept, others)[:_EXCHANGED]
        fits += [fit_start(problem, start, evaluations=10) for start in starts]
    return best_by_name(fits)


def alike(problem: Problem, best: Fit, effects: tuple[Effect, ...]) -> Fit | None:
    """Return the fit of the set that a single effect's law is declared to be like, if to any.

    It starts at the law's own shape parameters. None where the set does not need all its members.
    """
    if len(best.names) != 1 or not best.model.effects[0].like:
        return None
    law = best.model.effects[0]
    known = {c.shape.name: z for c, z in zip(best.model.coordinates, best.zeta, strict=True)}
    members = tuple(
        e
        for name in law.like
        for e in effects
        if e.name == name and not e.like and {s.name for s in e.shapes} <= known.keys()
    )
    if len(members) != len(law.like):
        return None
    model = replace(best.model, effects=members)
    fit = problem.refine(model, np.array([known[c.shape.name] for c in model.coordinates]))
    needed = all(
        fit_without(problem, fit, member).bic - fit.bic > CERTAIN_BIC
        for member in range(len(members))
    )
    return fit if needed else None


def same_physics(one: Effect, other: Effect) -> bool:
    """Return whether two are one effect: itself, one law that contains the other, or friction.

    Where nothing is touched, a hysteresis on both sides is friction with a long presliding, and a
    pair of the two bends after the form of either.
    """
    names = {one.name, other.name}
    if len(names) == 1 or names in _NESTED:
        return True
    return WITHOUT_CONTACT in {one.law, other.law} and names <= _RUBS


def fit_without(problem: Problem, fit: Fit, member: int) -> Fit:
    """Return the fit's model without one member, refitted from the fit's parameters."""
    return problem.refine(*without(fit, member))


def without(fit: Fit, member: int) -> tuple[Model, Vector]:
    """Return the fit's model without one member, and the nonlinear parameters of the others."""
    kept = tuple(e for i, e in enumerate(fit.model.effects) if i != member)
    owners = [c.owner for c in fit.model.coordinates]
    zeta = fit.zeta[[i for i, owner in enumerate(owners) if owner != member]]
    return replace(fit.model, effects=kept), zeta
