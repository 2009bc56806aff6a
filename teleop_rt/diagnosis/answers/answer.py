"""Parameters with standard deviations and units, and the shares of effects, for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from teleop_rt.config.parameter_words import reached_by
from teleop_rt.contact.effect import Effect, Matrix
from teleop_rt.diagnosis.answers.shares import shares_of_members
from teleop_rt.diagnosis.inference.one_more import without
from teleop_rt.diagnosis.inference.ranked import Ranked, explains, slack_of
from teleop_rt.diagnosis.inference.verdict import Judgement
from teleop_rt.diagnosis.models.axes import Axes
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import phases
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.noise.structure import jacobian, tangent_space

CANDIDATES_SHOWN = 15
"""Candidates in the answer; those behind the fifteenth were never close in any recording."""
_AT_BOUND = 1e-4  # of the range of a parameter: nearer, its printed digits are the bound's


def fill(unit: str, units: tuple[str, str]) -> str:
    """Return a unit with the rig's own in the placeholders."""
    return unit.replace("{x}", units[0]).replace("{f}", units[1])


def finite(value: float) -> float | None:
    """Return the number for JSON: null where it is not finite."""
    return float(value) if np.isfinite(value) else None


def covariance(problem: Problem, fit: Fit, floor: Matrix) -> Matrix:
    """Return the covariance of (theta, zeta): from the noise, and from the encoder's errors.

    Directions that the data do not determine come out as infinite variance.
    """
    rows = jacobian(problem, fit)
    if rows.shape[0] == 0:
        return np.zeros((0, 0))
    scale = np.linalg.norm(rows, axis=1)
    live = scale > 0.0
    scale = np.where(live, scale, 1.0)
    unit = rows / scale[:, None]
    values, vectors = np.linalg.eigh(unit @ unit.T)
    determined = values > 1e-12
    inverse = (vectors[:, determined] / values[determined]) @ vectors[:, determined].T
    shifts = inverse @ (unit @ floor.T)
    total = inverse + shifts @ shifts.T / floor.shape[0]
    loose = np.sum(vectors[:, ~determined] ** 2, axis=1) > 1e-6
    total[np.diag_indices_from(total)] += np.where(loose | ~live, np.inf, 0.0)
    found: Matrix = total / np.outer(scale, scale)
    return found


def entry(value: float, variance: float, unit: str) -> dict[str, Any]:
    """Return a parameter with its standard deviation."""
    deviation = float(np.sqrt(variance)) if variance >= 0.0 else float("nan")
    return {"value": finite(value), "std": finite(deviation), "unit": unit}


def _nonlinear(fit: Fit, place: int, problem: Problem, spread: Matrix, unit: str) -> dict[str, Any]:
    """Return a nonlinear parameter with its standard deviation; one at its bound is marked.

    `spread` is the covariance of (theta, zeta).
    """
    row = len(fit.model.linear) + place
    one = entry(float(fit.zeta[place]), float(spread[row, row]), unit)
    where = float(Axes.of(fit.model, problem.motion.scales).place(fit.zeta)[place])
    return one if _AT_BOUND < where < 1.0 - _AT_BOUND else one | {"note": "at its bound"}


def base_entry(fit: Fit, problem: Problem, floor: Matrix, units: tuple[str, str]) -> dict[str, Any]:
    """Return the base as it was fitted; a parameter not significantly above zero is marked."""
    spread = covariance(problem, fit, floor)
    found: dict[str, Any] = {}
    for i, linear in enumerate(fit.model.linear):
        if linear.owner >= 0:
            continue
        one = entry(float(fit.theta[i]), float(spread[i, i]), fill(linear.unit, units))
        deviation = one["std"]
        if linear.nonnegative and (deviation is None or fit.theta[i] < 2.0 * deviation):
            one["note"] = "not identified"
        found[linear.name] = one
    place = 0
    if fit.model.base.has_power:
        found["n"] = _nonlinear(fit, place, problem, spread, "1")
        for name in ("k", "b"):
            _add_reached(found, name, ["n"], fit, problem)
        place += 1
    if fit.model.base.finds_surface:
        surface = {"value": finite(problem.surface - fit.model.shift(fit.zeta))}
        found["surface"] = _nonlinear(fit, place, problem, spread, units[0]) | surface
    return {
        "model": fit.model.base.name,
        "clamped": fit.model.clamp != "none",
        "clamped_with_effects": fit.model.clamp in {"body", "elastic"},
        "clamped_without_damping": fit.model.clamp == "elastic",
        "parameters": found,
    }


def parameters_of_effect(
    problem: Problem, fit: Fit, member: int, spread: Matrix, units: tuple[str, str]
) -> dict[str, Any]:
    """Return amplitude and shape parameters of one effect of the fit."""
    found, effect = dict[str, Any](), fit.model.effects[member]
    linear = [i for i, item in enumerate(fit.model.linear) if item.owner == member]
    unit = fill(effect.amplitude.unit, units)
    if phases(effect):
        sine, cosine = (float(fit.theta[i]) for i in linear)
        block = spread[np.ix_(linear, linear)]
        size = float(np.hypot(sine, cosine))
        along = np.array([sine, cosine]) / max(size, 1e-300)
        across = np.array([-cosine, sine]) / max(size**2, 1e-300)
        found[effect.amplitude.name] = entry(size, float(along @ block @ along), unit)
        angle = next(shape for shape in effect.shapes if shape.phase)
        found[angle.name] = entry(
            float(np.arctan2(cosine, sine)), float(across @ block @ across), angle.unit
        )
    elif linear:
        i = linear[0]
        found[effect.amplitude.name] = entry(float(fit.theta[i]), float(spread[i, i]), unit)
    for j, coordinate in enumerate(fit.model.coordinates):
        if coordinate.owner == member:
            shape = coordinate.shape
            found[shape.name] = _nonlinear(fit, j, problem, spread, fill(shape.unit, units))
    _add_reached(
        found, effect.amplitude.name, [shape.name for shape in effect.shapes], fit, problem
    )
    return found


def deepest(problem: Problem, fit: Fit) -> float:
    """Return the largest depth beyond the fitted surface [rig unit]."""
    return float(np.max(problem.motion.x)) + fit.model.shift(fit.zeta)


def _add_reached(
    found: dict[str, Any], size: str, shapes: Sequence[str], fit: Fit, problem: Problem
) -> None:
    """Add to the size of a power law its value at the largest depth."""
    one, exponents = found.get(size), {n: found[n]["value"] for n in shapes if n in found}
    if one is not None and None not in {one["value"], *exponents.values()}:
        one |= reached_by(one["unit"], one["value"], exponents, deepest(problem, fit))


def _with_figures(sentence: str, parameters: dict[str, Any]) -> str:
    """Return an effect's sentence with its figures, in SI as the parameters beside it."""
    return sentence.format(**{
        f"{sign}{name}": "unknown"
        if one["value"] is None
        else f"{factor * one['value']:.4g} {one['unit']}".removesuffix(" 1")
        for name, one in parameters.items()
        for sign, factor in (("", 1.0), ("-", -1.0))
    })  # fmt: skip


def effect_entry(
    effect: Effect,
    parameters: dict[str, Any],
    explains: float | None = None,
    absorbed: float | None = None,
) -> dict[str, Any]:
    """Return an effect that was found; see `FoundEffect` for its keys."""
    amount = parameters.get(effect.amplitude.name, {}).get("value") or 0.0
    template = effect.turned if effect.turned and amount < 0.0 else effect.sentence
    return {
        "name": effect.name,
        "law": effect.law,
        "family": effect.family,
        "belongs_to": effect.belongs_to,
        "parameters": parameters,
        "explains": None if explains is None else round(explains, 4),
        "absorbed_by_base": absorbed,
        "compensation": effect.compensation,
        "sentence": _with_figures(template, parameters),
        "template": template,
    }


def effects_of(
    problem: Problem, base: Fit, judgement: Judgement, floor: Matrix, units: tuple[str, str]
) -> list[dict[str, Any]]:
    """Return the fitted effects of the best set, by the share that each explains, largest first.

    The shares add up to that of the set.
    """
    if not judgement.sets:
        return []
    best = judgement.sets[0]
    spread = covariance(problem, best.fit, floor)
    whole = share_explained(best, judgement)
    shares = shares_of_members(problem, base, best.fit)
    found = [
        effect_entry(
            effect,
            parameters_of_effect(problem, best.fit, i, spread, units),
            whole * shares[i],
            _absorbed(problem, base, best.fit, i),
        )
        for i, effect in enumerate(best.fit.model.effects)
    ]
    # Which member of a set is fitted first may hang on a rounding error.
    return sorted(found, key=lambda effect: -effect["explains"])


def candidates_of(candidates: Sequence[Ranked], judgement: Judgement) -> list[dict[str, Any]]:
    """Return the best candidates, best first, with gain and explained share of each."""
    return [
        {
            "effects": list(ranked.fit.names),
            "laws": [effect.law for effect in ranked.fit.model.effects],
            "belongs_to": list(dict.fromkeys(e.belongs_to for e in ranked.fit.model.effects)),
            "delta_bic": round(ranked.delta_bic, 1),
            "explains": round(share_explained(ranked, judgement), 4),
        }
        for ranked in candidates[:CANDIDATES_SHOWN]
    ]


def share_explained(ranked: Ranked, judgement: Judgement) -> float:
    """Return the share [0 to 1] of the excess that a set explains, as answer and page show it.

    For a set that is named or in the class, a residual within noise and encoder errors counts as
    explained.
    """
    named = [set(one.fit.names) for one in judgement.sets]
    chosen = set(ranked.fit.names) in named and judgement.verdict != "partial"
    slack = slack_of(ranked, judgement.floor) if chosen else 0.0
    return explains(ranked, judgement.excess, slack)


def _absorbed(problem: Problem, base: Fit, best: Fit, member: int) -> float | None:
    """Return the share of an effect's energy that the base's parameters alone can explain.

    Its energy is that of the force with it less the force without it, all else equal.
    """
    alone = tangent_space(problem, base)
    less, zeta = without(best, member)
    theta = best.theta[[i for i, item in enumerate(best.model.linear) if item.owner != member]]
    rest = force_of(less, problem.motion, zeta, theta)
    signal = problem.whitener(best.force_on(problem.motion) - rest)
    energy = float(signal @ signal)
    if energy <= 0.0 or alone.shape[1] == 0:
        return None
    return round(float(np.sum((signal @ alone) ** 2)) / energy, 4)
