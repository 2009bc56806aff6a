"""The view of the contact that explains a recording: left, fixed, or touched behind a weight."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects.return_spring import RETURN_SPRING
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.criteria import REDRAWN_NOISE_RATIO
from teleop_rt.diagnosis.inference.confirmed import Judged, confirmed
from teleop_rt.diagnosis.inference.rounds import Diagnosis, in_rounds
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.base import Base, base_of
from teleop_rt.diagnosis.samples.free import moves_freely
from teleop_rt.diagnosis.samples.held import (
    SURE_PULL,
    bilateral,
    is_held,
    is_left,
    may_be_held,
    unilateral,
)
from teleop_rt.diagnosis.samples.onset import Surface
from teleop_rt.diagnosis.samples.preparation import pose
from teleop_rt.diagnosis.samples.surface import (
    has_clear_onset,
    onset_far_from,
    surface_behind_weight,
)
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.recording import Recording

_LEAST_COMMON = 0.05  # of a judgement's samples, on which another view is compared
_LIKELIEST = 3  # candidates of which one shows the residual that a view of the contact may leave


_AIR_RATIO = 1.5  # of the error in contact, in free air; more is no free air
_AT_BOUND = 0.99  # of a surface's uncertainty; a fit beyond it is cut off by the bound
_EMPTY = 0.1  # of the force over the travel; a base with a softer spring has none
_FREE = ("mass-damper", "mass,spring,viscous,bias")  # bases of a drive that touches nothing
_TOUCHED = "mass,stiffness,damping"  # base of a drive, for whose free motion another one is stated
_WIDER = 3.0  # times the uncertainty whose bound a fit has reached


class View(NamedTuple):
    """A base, and its surface [rig unit], given for sure or guessed; None if unknown.

    `at_a_glance` it is dropped where its candidates all leave more, before it is confirmed. That
    compares different samples where surfaces lie far apart, or there is none. `if_pressed` it is
    tried only where the judgement so far has no sample in free air.
    """

    base: Base
    surface: float | Surface | None = None
    at_a_glance: bool = True
    if_pressed: bool = False


def judged(
    recording: Recording, base: Base, surface: float | None, effects: tuple[Effect, ...]
) -> Judged:
    """Return the confirmed judgement of the view of the contact that explains most.

    A later view counts only where the first one lacks an effect: with a wrong surface an effect
    only mends that.
    """
    views = _views(recording, base, surface)
    made = _first(recording, views, effects)
    while made.found.judgement.verdict != "no_missing_effect":
        if (view := next(views, None)) is None:
            break
        if view.if_pressed and _shows_air(made.found):
            continue
        with suppress(RecordingError):
            other = _judged(recording, view, effects, instead_of=made)
            if other is not made:
                made = _with_surface_free(recording, other, effects)
    return made


def _first(recording: Recording, views: Iterator[View], effects: tuple[Effect, ...]) -> Judged:
    """Return the judgement of the first view; of the next one where a drive only moves freely.

    Raises RecordingError if no sample is usable, as where a contact seems to have a wrong sign.
    """
    try:
        made = _judged(recording, next(views), effects)
    except RecordingError:
        free = next((view for view in views if not view.base.touches), None)
        if free is None or not moves_freely(recording):
            raise
        return _judged(recording, free, effects)
    return _with_surface_free(recording, made, effects)


def _with_surface_free(recording: Recording, made: Judged, effects: tuple[Effect, ...]) -> Judged:
    """Return the judgement whose surface lies at no bound, if that explains more.

    The bound of a surface is the uncertainty of an onset. A force that rises slowly hides its onset
    deep in the body.
    """
    while made.found.judgement.verdict != "no_missing_effect":
        if (view := _beyond_bound(made.found)) is None:
            break
        wider = _judged(recording, view, effects, instead_of=made)
        if wider is made:
            break
        made = wider
    return made


def _beyond_bound(found: Diagnosis) -> View | None:
    """Return the view of a surface about the bound at which the fit has it, None if at none.

    Where no set is named, the fit is that of the likeliest candidate.
    """
    tried = [] if found.judgement.sets else [ranked.fit for ranked in found.candidates]
    fit = min(tried, key=lambda one: one.bic, default=found.best)
    within = found.problem.motion.scales.get("onset", 0.0)
    if not fit.model.base.finds_surface:
        return None
    shift = fit.model.shift(fit.zeta)
    if abs(shift) < _AT_BOUND * within:
        return None
    guess = Surface(found.problem.surface - shift, fixed=False, within=_WIDER * within)
    return View(replace(fit.model.base, finds_surface=False), guess, at_a_glance=False)


def _judged(
    recording: Recording,
    view: View,
    effects: tuple[Effect, ...],
    instead_of: Judged | None = None,
) -> Judged:
    """Return the judgement of a view, or the one that it would replace where it explains no more.

    Raises RecordingError if the view leaves no sample to judge.
    """
    if instead_of is not None and not _may_explain(recording, view, instead_of):
        return instead_of
    posed = partial(pose, recording, view.base, view.surface)
    weighed = in_rounds(posed, recording, effects)
    glance = instead_of if view.at_a_glance else None
    if glance is not None and _least_left(weighed) >= _left_by(glance):
        return glance
    made = confirmed(recording, weighed, effects)
    return made if instead_of is None or _explains_more(made, instead_of) else instead_of


def _views(recording: Recording, base: Base, surface: float | None) -> Iterator[View]:
    """Give the views of the contact, likeliest first.

    If no surface is given, the body may be fixed to the tool, also under a load that keeps it
    pressed; its onset may hide behind a weight; or the drive may touch nothing. A body that pulls
    only a little is taken for one that the tool leaves first. A base without contact is that of
    contact where the tool leaves the body, or meets one. A surface that is given may be the rest
    of a body that is fixed to the tool, or a mistake: then the onset of force is used.
    """
    if surface is not None or recording.surface is not None:
        yield View(base, surface)
        if surface is not None and base.touches:
            yield from _views_beside(recording, base, surface)
        return
    touching = base if base.touches else unilateral(base)
    held = bilateral(base) if base.touches else base
    if touching is None:
        yield View(base)
        if not moves_freely(recording) and has_clear_onset(recording):
            touched = base_of(_TOUCHED if base.has_mass else "kelvin-voigt")
            yield View(touched, at_a_glance=False)
        return
    if base.touches:
        pulls = held is not None and is_held(recording)
        order = [held, base] if pulls and is_held(recording, SURE_PULL) else [base, held]
        order = order if pulls else [base]
    else:
        order = [touching] if is_left(recording) else [base, touching]
    yield from (View(one) for one in order if one is not None)
    if base.touches and held is not None and held not in order:
        yield View(held, at_a_glance=False, if_pressed=not may_be_held(recording))
    if base.touches and moves_freely(recording):
        yield from (View(base_of(name), at_a_glance=False) for name in _FREE)
    if (hidden := surface_behind_weight(recording)) is not None:
        yield View(touching, hidden)


def _views_beside(recording: Recording, base: Base, surface: float) -> Iterator[View]:
    """Give the views beside that of contact at a given surface."""
    about_rest = bilateral(base, about_rest=True)
    if about_rest is not None and is_held(recording, SURE_PULL):
        yield View(about_rest, surface)
    if onset_far_from(surface, recording) is not None:
        yield View(base, at_a_glance=False)


def _may_explain(recording: Recording, view: View, made: Judged) -> bool:
    """Return, at little cost, whether a view may explain the judgement's missing part.

    Where a set is named, another kind of base must leave less than that of the judgement without
    any effect, unless the judgement leaves much more in its free air.
    """
    alone = made.plain.base
    alike = view.base.touches == alone.model.base.touches
    if made.inconclusive or alike or view.if_pressed or _without_its_spring(made.found):
        return True
    if (_air_ratio(made.found) or 0.0) > _AIR_RATIO:
        return True
    problem, base = pose(recording, view.base, view.surface)
    left = held_out.deviation(problem, fit_base(problem, base))
    return left < held_out.deviation(made.plain.problem, alone)


def _shows_air(found: Diagnosis) -> bool:
    """Return whether the tool leaves the surface of an answer."""
    fit, used = found.predicts, found.problem.whitener.mask > 0.0
    depth = found.problem.motion.x + fit.model.shift(fit.zeta)
    return bool(np.any(~touches(depth[used])))


def _air_ratio(found: Diagnosis) -> float | None:
    """Return the error of an answer in free air over that in contact; None without free air."""
    problem, fit = found.problem, found.predicts
    air = ~touches(problem.motion.x) & (problem.whitener.mask > 0.0)
    if not (fit.model.base.touches and np.any(air)):
        return None
    return float(np.sqrt(problem.mean_square(fit, air))) / found.left_by(fit)


def _least_left(weighed: Diagnosis) -> float:
    """Return the least root mean square [rig's force] that a likely candidate leaves."""
    likeliest = [ranked.fit for ranked in weighed.candidates[:_LIKELIEST]]
    return min(weighed.left_by(fit) for fit in (weighed.base, *likeliest))


def _left_by(made: Judged) -> float:
    return made.found.left_by(made.found.predicts)


def _explains_more(other: Judged, made: Judged) -> bool:
    """Return whether another view errs clearly less, or no more and names fewer effects.

    Beside a judgement that names nothing complete, one that does must only err less. The errors are
    those of held-out blocks, on the samples in contact that both views use; of less than a
    twentieth of the first one's nothing follows. They differ by chance: an effect less is worth
    one parameter's term of the Bayesian information criterion. An effect that stands in for the
    base's own spring counts twice. A contact without free air, or whose air is none, does not
    replace a fixed body.
    """
    if not made.found.base.model.base.touches and other.found.base.model.base.touches:
        air = _air_ratio(other.found)
        if air is None or air > _AIR_RATIO:
            return False
    found = [one.blocks.predicted(one.found.predicts, 0.0) for one in (other, made)]
    used = [one.where > 0.0 for one in found]
    both = used[0] & used[1]
    n = np.count_nonzero(both)
    if n < _LEAST_COMMON * np.count_nonzero(used[1]):
        return False
    error, most = (float(np.sqrt(np.mean((f.problem.force - f.after)[both] ** 2))) for f in found)
    fewer = _terms(other.found) < _terms(made.found)
    names = made.inconclusive and other.found.judgement.verdict in {"named", "class"}
    no_more = 2.0 * n * np.log(error / most) <= np.log(n)
    return bool(
        REDRAWN_NOISE_RATIO * error < most or (fewer and no_more) or (names and error <= most)
    )


def _terms(found: Diagnosis) -> int:
    """Return the number of effects, one more where one of them is the base's own spring."""
    return len(found.predicts.names) + int(_without_its_spring(found))


def _without_its_spring(found: Diagnosis) -> bool:
    """Return whether another effect took the place of the base's spring, as where it also pulls.

    A spring of the rig may do so on one side alone.
    """
    fit, scales = found.best, found.problem.motion.scales
    stiffness = {one.name: value for one, value in zip(fit.model.linear, fit.theta, strict=True)}
    soft = stiffness.get("k", np.inf) < _EMPTY * scales["force"] / scales["travel"]
    return RETURN_SPRING in fit.names or (bool(fit.names) and soft)
