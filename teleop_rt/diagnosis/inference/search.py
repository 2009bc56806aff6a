"""Candidates: each effect screened first, the promising ones fitted jointly with the base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Effect, Shape, Vector
from teleop_rt.diagnosis.inference.coarse import at_lower_rates
from teleop_rt.diagnosis.inference.screening import Start, look, swings, with_surface
from teleop_rt.diagnosis.models.base import Base
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem, grid
from teleop_rt.diagnosis.models.model import JUMPS, Model, bounds
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.samples.preparation import UNPRESSED

_RECLAMPED = 5  # of the best fits, tried with the force otherwise cut at zero
_POLISHED = 12  # of the best fits, brought to their place among a contact's jumps
_STEPS = (3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4)  # of a parameter's range, tried one after the other
_MOST_STEPS = 8  # in one direction, each as long as the last or twice
_GAPS = 6  # between samples on either side of the surface
_MOST_PATTERNS = 6  # rounds of steps; the valley of surface and effect is followed no farther
_WORTH_MORE = 0.03  # of chi-square, by which a round must lower it for another
_SHARE, _MOVING_SHARE = 0.3, 0.02
_MOST = 14  # laws fitted, of those that promise most
_LIKELY = 2  # effects of which all laws are fitted
_HARDEST = 3.0  # times the largest force; no past that nobody saw pressed harder


def fit_base(problem: Problem, base: Base, near: Fit | None = None) -> Fit:
    """Fit the base alone, with and without a clamp at zero force; the better one is returned.

    From where it was fitted `near` to, with other weights: a contact's jump is found under even
    ones, and from afar the weights of red noise hide it behind others.
    """
    models = [Model(base)]
    if base.touches:
        models.append(Model(base, clamped=True))
    start = np.array([c.shape.start if isinstance(c.shape, Shape) else 0.0
                      for c in models[0].coordinates]) if near is None else near.zeta  # fmt: skip
    fits = [polished(problem, problem.refine(model, start)) for model in models]
    return min(fits, key=lambda fit: fit.chi2)


def fit_start(problem: Problem, start: Start, evaluations: int = 15) -> Fit:
    """Fit a model and the effect that the start adds to it together.

    A model that lacked the effect may have moved its surface to make up for it, and chi-square
    has a minimum there: where the onset of force fits better, the fit starts there.
    """
    model, zeta = start.model, start.zeta
    if model.base.finds_surface:
        at_onset = [model.shifted(other, 0.0) for other in (zeta, *_reshaped(problem, start))]
        places = [zeta, *at_onset]
        zeta = min(places, key=lambda place: problem.solve(model, place).chi2)
    return problem.refine(model, zeta, evaluations)


def _reshaped(problem: Problem, start: Start) -> list[Vector]:
    """Return the start with the one shape of an added force at each value that was screened.

    It was screened beside a surface that the base alone had bent, and at the onset of force another
    value fits: from the wrong one a descent ends in a valley where the surface makes up for it.
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
    fits = laws = _promising(problem, base, look(problem, at_lower_rates(problem), base, effects))
    if base.model.base.finds_surface:
        # The base was brought to its place among the jumps, and so must they be to be compared.
        fits = [polished(problem, fit) if _jumps(fit) else fit for fit in fits]
        fits = best_by_name(fits)
        fits = [fit if _jumps(fit) else polished(problem, fit) for fit in fits[:_POLISHED]] + fits[
            _POLISHED:
        ]
    return _otherwise_begun(problem, base, best_by_name(fits), laws)


def glance(problem: Problem, base: Fit, effects: tuple[Effect, ...], most: int) -> list[Fit]:
    """Return the `most` promising single-effect models, fitted at a lower rate: near their places.

    Good enough for what is weighed and refined by another noise.
    """
    lower = at_lower_rates(problem)
    near, there = lower[0].around(problem, base)
    laws = _promising(near, there, look(problem, lower, base, effects))
    fits = best_by_name(laws)[:_RECLAMPED]
    if base.model.base.finds_surface:
        fits = [polished(near, fit) for fit in fits]
    return _otherwise_begun(near, there, fits, laws)[:most]


def _otherwise_begun(problem: Problem, base: Fit, fits: list[Fit], laws: list[Fit]) -> list[Fit]:
    """Return the fits better than the base, best first, the likeliest otherwise clamped or begun.

    Memories that fade may begin with what came before the recording: which law of an effect is the
    likeliest shows with that alone.
    """
    fits = fits + [otherwise_clamped(problem, fit) for fit in fits[:_RECLAMPED]]
    fading = sorted((fit for fit in (*laws, *fits) if fades(problem, fit)), key=lambda fit: fit.bic)
    begun: dict[tuple[str, str], Fit] = {}
    for fit in fading:
        begun.setdefault((fit.names[0], fit.model.effects[0].law), fit)
    fits += [with_past(problem, fit) for fit in [*begun.values()][:_RECLAMPED]]
    return best_by_name([fit for fit in fits if fit.chi2 < base.chi2])


def _promising(problem: Problem, base: Fit, starts: list[Start]) -> list[Fit]:
    """Return fits of the most promising laws, and of one more law of each effect left out by them.

    If a motion shows little, many explain it equally well, and none of them may be lost. Of the
    likeliest effects all laws are fitted: where the base lies askew, a wrong one may promise most.
    """
    if not starts:
        return []

    def promises(start: Start) -> bool:
        # What moves a contact is seen through the jumps of a force, and gains most by its descent.
        least = _MOVING_SHARE if start.effect.acts in JUMPS else _SHARE
        return start.gain > max(10.0, least * starts[0].gain)

    promising = [s for s in starts if promises(s)]
    chosen = promising[:_MOST]
    left = promising[_MOST:]
    if base.model.base.has_power:
        # A shift of the depth bends the power, and at the base's own the screen sees little of it.
        left += [s for s in starts if not promises(s) and _bends_depth(s.effect)]
    for start in left:
        if start.effect.name not in {s.effect.name for s in chosen}:
            chosen.append(start)
    if base.model.base.has_power and base.model.base.finds_surface:
        chosen += _at_other_depths(problem, starts)
    fits = [fit_start(problem, s) for s in chosen]
    likely = [fit.names[0] for fit in best_by_name(fits)[:_LIKELY]]
    others = [s for s in starts if not any(s is c for c in chosen) and s.effect.name in likely]
    return [*fits, *(fit_start(problem, start) for start in others)]


def _at_other_depths(problem: Problem, starts: list[Start]) -> list[Start]:
    """Return starts of what stiffens with depth at two more places of its shape.

    A power and a surface that were bent after such a body promise little of it at its own depth,
    and its stiffness, which cannot be negative, stays at 0 wherever else they begin.
    """
    found: list[Start] = []
    for start in (s for s in starts if s.effect.family == "stiffening" and s.effect.shapes):
        depths = grid(start.effect.shapes[-1], problem.motion.scales)
        found += [
            replace(start, zeta=np.append(start.zeta[:-1], depths[len(depths) // part]))
            for part in (2, 4)
        ]
    return found


def polished(problem: Problem, fit: Fit) -> Fit:
    """Return the fit with the parameters that move a contact in place or time searched by steps.

    A damper's force jumps at a contact, so chi-square is rough in where that lies: sample by sample
    one goes to the other side. Descent along a slope stops at the first of these (on a recording
    without noise at 17 times the least chi-square), and a rival with more parameters then wins.
    Steps of one parameter after the other, then on along the way that they made together (Hooke
    and Jeeves' pattern search): surface and what moves it lie in a valley.
    """
    for _ in range(_MOST_PATTERNS):
        before, fit = fit, _stepped(problem, fit)
        if fit.chi2 >= before.chi2:
            break
        there = _further(problem, fit, fit.zeta - before.zeta)
        if there.chi2 > (1.0 - _WORTH_MORE) * fit.chi2:
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
            fit = _walked(problem, fit, along, 1.0)
            if taken_along:
                there = with_surface(problem, fit, fit.model, fit.zeta + along)
                fit = _walked(problem, fit, there - fit.zeta, 1.0)
    return fit


def _between_samples(problem: Problem, fit: Fit) -> Fit:
    """Return the fit with the surface in the best of the nearest gaps between two samples.

    Which samples lie beyond it changes at each, and the force's jumps with them; in a gap nothing
    jumps. A gap may be narrower than any step.
    """
    shift = fit.model.shift(fit.zeta)
    depth = Course.of(fit.model, problem.motion, fit.zeta).moved.x
    near = np.unique(depth[problem.whitener.mask > 0.0])
    here = int(np.searchsorted(near, 0.0))
    around = near[max(here - _GAPS, 0) : here + _GAPS]
    best = fit
    for middle in 0.5 * (around[1:] + around[:-1]):
        zeta = fit.model.shifted(fit.zeta, shift - middle)
        best = min(best, problem.solve(fit.model, zeta, fit.theta), key=lambda f: f.chi2)
    return best


def _further(problem: Problem, fit: Fit, way: Vector) -> Fit:
    """Return the fit gone on along a way, ever faster."""
    return _walked(problem, fit, way, 2.0) if np.count_nonzero(way) > 1 else fit


def _walked(problem: Problem, fit: Fit, step: Vector, growth: float) -> Fit:
    """Return the fit after as many steps as lower chi-square, each `growth` times the last."""
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


def fades(problem: Problem, fit: Fit) -> bool:
    """Return whether an effect of the fit may still depend on the time before the recording.

    Not where the recording begins with the tool at its outermost place, off the body: there the
    trial begins, and a past would only bend the law to what holds of this recording alone.
    """
    x = problem.motion.x
    nearly = UNPRESSED * float(np.max(x))
    if x[0] < nearly and x[0] - float(np.min(x)) < nearly:
        return False
    return not fit.model.past and any(effect.fades for effect in fit.model.effects)


def with_past(problem: Problem, fit: Fit) -> Fit:
    """Return the fit with what came before the recording free.

    As it is where that would have to be a force beyond all that the recording holds: of a memory
    that fades before the first sample that counts, any past could be made up.
    """
    found = problem.refine(replace(fit.model, past=True), fit.zeta, evaluations=8)
    made, less = (
        force_of(one.model, problem.motion, one.zeta, one.theta) for one in (found, found.elsewhere)
    )
    most = _HARDEST * problem.motion.scales["force"]
    return found if float(np.max(np.abs(made - less))) < most else fit


def _jumps(fit: Fit) -> bool:
    """Return whether an effect of the fit moves a contact, beside the surface itself."""
    return any(c.owner >= 0 and fit.model.moves_contact(c) for c in fit.model.coordinates)


def _bends_depth(effect: Effect) -> bool:
    return effect.acts in {"moves_position", "deflects"} and not swings(effect)


def otherwise_clamped(problem: Problem, fit: Fit) -> Fit:
    """Return the fit with the force otherwise cut at zero: an effect may have hidden how it is."""
    model = fit.model
    own = model.clamped, model.clamped_with_effects
    others = [
        problem.refine(
            replace(model, clamped=clamped, clamped_with_effects=whole), fit.zeta, evaluations=6
        )
        for clamped, whole in model.clamps
        if (clamped, whole) != own
    ]
    return min(others, key=lambda other: other.chi2, default=fit)
