"""Preparation of a recording for fits: surface, motion, usable samples, and a first noise."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.criteria import SIGMAS
from teleop_rt.diagnosis.models.base import Base
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.predict import slip_of
from teleop_rt.diagnosis.models.simulate import run_step
from teleop_rt.diagnosis.noise import whiten
from teleop_rt.diagnosis.samples import steps
from teleop_rt.diagnosis.samples.converter import without_steps
from teleop_rt.diagnosis.samples.lost_contact import FEWEST_FREE_SAMPLES, without_contact
from teleop_rt.diagnosis.samples.motion import motion_of, position_noise, settling
from teleop_rt.diagnosis.samples.onset import Surface
from teleop_rt.diagnosis.samples.outliers import outliers
from teleop_rt.diagnosis.samples.smoothing import (
    HALF_WINDOWS_S,
    half_window,
    moves_in_steps,
    narrowest,
    too_quick,
)
from teleop_rt.diagnosis.samples.surface import refuse_unlearnable, refuse_untouched, surface_of
from teleop_rt.recordings.filters import running_rank
from teleop_rt.recordings.recording import Recording, short_gaps
from teleop_rt.recordings.rows import force_noise, robust_deviation, stretches, without_lone

Samples = Literal["usual", "away from touches", "from the start", "without an odd beginning"]
"""The samples that an answer uses."""
_IMPACT_SPEED = 0.02  # of the speed scale; a larger jump of the tip is an impact
_IMPACT_RATIO = 1.5  # of the error elsewhere: 1.2 to 1.4 at closings without, 2.0 with an impact
_IMPACT_SAMPLES = 3  # left out on either side: filters of the sensor spread an impact
_FADING_PART = 5  # part of a recording (a fifth) in which memories of earlier contact fade
_SETTLED_STEP = 1e-3  # of a step, of which a filter misses no more when it has settled
_FEWEST_OF_A_CUBIC = 2  # samples on either side that determine a cubic
_ABOUT_OUTLIER = 11  # samples, most of them in use: beside a touch a residual has jumps of its own
_FEWEST_OUTLIERS = 3  # that the force shows; fewer may be chance
UNPRESSED = 0.01  # of the largest penetration; below it the body is not yet pressed


def pose(
    recording: Recording, base: Base, surface: float | Surface | None, *, fresh: bool = False
) -> tuple[Problem, Base]:
    """Return the problem, and the base with its surface free if no surface is given for sure.

    A recording that begins in contact is used from its first release, unless the body is assumed
    to be `fresh` (never pressed before). Raises RecordingError if no sample is usable.
    """
    guess, given = (surface, None) if isinstance(surface, Surface) else (None, surface)
    if given is not None or not base.touches:
        return problem_of(recording, base, given or 0.0, fresh=fresh), base
    guess = guess or surface_of(recording)
    if guess.fixed:
        return problem_of(recording, base, guess.position, fresh=fresh), base
    return problem_of(recording, base, guess.position, guess.within, fresh=fresh), replace(
        base, finds_surface=True
    )


def pose_again(recording: Recording, base: Base, surface: float | None, found: Problem) -> Problem:
    """Return the problem of another recording of the same object as `found`.

    An estimated surface is kept if the onset of force in this recording is near it. A base that
    finds its surface does so where `surface` was given and contradicted, too.
    """
    if not base.finds_surface:
        place = surface_of(recording).position if surface is None and base.touches else surface
        return problem_of(recording, base, place or 0.0)
    guess = surface_of(recording)
    if not guess.fixed and abs(guess.position - found.surface) < _surface_tolerance(found):
        guess = guess._replace(position=found.surface)
    return problem_of(recording, base, guess.position, guess.within)


def problem_of(
    recording: Recording,
    base: Base,
    surface: float,
    within: float = 0.0,
    *,
    fresh: bool = False,
) -> Problem:
    """Return motion, force and a first, white, noise model, with the surface at a position.

    `within` is how far that may be off [rig unit]; for `fresh` see `pose`.
    """
    in_steps = moves_in_steps(recording.position, recording.force, recording.dt)
    half = half_window(recording.position, recording.dt, 2 if base.has_mass else 1)
    half = narrowest(recording.dt) if in_steps else half
    calm = without_lone(recording.force)
    motion = motion_of(recording.position, calm, recording.dt, surface, half, touches=base.touches)
    motion = replace(motion, scales={**motion.scales, "onset": within})
    noise = max(force_noise(recording.force, recording.force_step), 1e-9 * motion.scales["force"])
    # There the local polynomial looks to one side only, and its derivatives are a guess.
    mask = recording.mask.copy()
    mask[: 2 * half] = mask[-2 * half :] = 0.0
    if not in_steps:
        mask *= 1.0 - too_quick(recording.position, recording.dt, half)
    if base.touches and not fresh:
        mask[: _unknown_history(motion.x)] = 0.0
    mask *= 1.0 - outliers(recording.force, motion.x, noise, recording.dt)
    if base.touches:
        refuse_unlearnable(recording, motion.x, position_noise(recording.position, recording.dt))
        shortest = 1 if in_steps else FEWEST_FREE_SAMPLES
        mask *= 1.0 - without_contact(recording.force, motion.x, motion.v, noise, shortest)
    resolution = position_noise(recording.position, recording.dt)
    mask *= 1.0 - _beside_gaps(recording, motion.a, resolution, 2 * half)
    whitener = whiten.white(mask, noise, recording.dt)
    settled = settling(recording.position, recording.dt)
    little_moves = min(half, max(_FEWEST_OF_A_CUBIC, round(HALF_WINDOWS_S[0] / recording.dt)))
    force = without_steps(recording.force, little_moves, recording.force_step)
    problem = Problem(motion, force, whitener, surface, resolution, settled, recording.force_step)
    if in_steps:
        problem = _within_band(problem, calm, noise)
    if not base.touches:
        return problem
    problem = without_edges(problem, [0.0])
    refuse_untouched(recording, problem.whitener.mask * touches(motion.x))
    return problem


def _within_band(problem: Problem, force: Vector, noise: float) -> Problem:
    """Return the problem below the frequency at which the samples show a motion in steps.

    Position and force pass the same low-pass, which a law that is smooth over its few milliseconds
    commutes with; samples near a touch or a gap are left out. `force` is without outliers.
    """
    motion, dt = problem.motion, problem.motion.dt
    x, v, a, force = (steps.low_passed(row, dt) for row in (motion.x, motion.v, motion.a, force))
    mask = steps.beside(problem.whitener.mask, dt)
    return replace(
        problem,
        motion=replace(motion, x=x, v=v, a=a),
        force=force,
        whitener=whiten.white(mask, noise, dt, steps.band_hz(dt)),
        settling=max(problem.settling, steps.reach(dt)),
    )


def _beside_gaps(recording: Recording, a: Vector, resolution: float, reach: int) -> Vector:
    """Return 1 where derivatives reach, by as many samples, into a gap that hides how it bends.

    A gap is bridged by a straight line, a short one by a cubic. The bridge is as good as samples if
    the usual motion deviates from it by no more than the encoder noise.
    """
    found = np.zeros(a.size)
    # Not the deviation: beside gaps the acceleration is spoilt itself.
    bends = robust_deviation(np.diff(a, 2)) / recording.dt**2
    by_cubic = short_gaps(recording.mask)
    for first, past in stretches(recording.mask == 0.0):
        half = 0.5 * (past - first + 1) * recording.dt
        sag = float(np.std(a)) * half**2 / 2.0
        if (first, past) in by_cubic:
            sag = bends * (half * (half + recording.dt)) ** 2 / 24.0
        if sag > resolution:
            found[max(first - reach, 0) : past + reach] = 1.0
    return found


def without_edges(problem: Problem, shifts: Iterable[float]) -> Problem:
    """Return the problem without the samples at the surface, for each shift of it.

    Noise decides on which side of the surface these samples lie, and a damper's force jumps there.
    A filter of the force spreads the jump over the samples around it.
    """
    mask, about = problem.whitener.mask.copy(), problem.settling
    for shift in shifts:
        x = problem.motion.x + shift
        mask[np.abs(x) < SIGMAS * problem.resolution] = 0.0
        for crossed in np.flatnonzero(np.diff(touches(x))) + 1:
            mask[max(crossed - about, 0) : crossed + about] = 0.0
    return problem.keeping(mask)


def lone_samples(recording: Recording, problem: Problem, fit: Fit) -> Vector:
    """Return 1 for the outliers of the force, and for those that stand out of a fit's residual.

    A quick force hides some, as does another one close by. They are searched only where the force
    itself shows others: without any, an outlier of a residual is an impact, or an effect.
    """
    motion, dt, force = problem.motion, problem.motion.dt, recording.force
    noise = force_noise(force, recording.force_step)
    seen = outliers(force, motion.x, noise, dt)
    by_steps = recording.force_step > noise  # then a residual is made of single readings
    if by_steps or len(stretches(seen > 0.0)) < _FEWEST_OUTLIERS:
        return seen
    residual = force - fit.force_on(motion)
    places = np.arange(residual.size)
    used = running_rank(problem.whitener.mask, _ABOUT_OUTLIER, 0.5) > 0.0
    while True:
        good = seen == 0.0
        beside = np.interp(places, places[good], residual[good])
        more = outliers(beside, motion.x, noise, dt) * used * good
        if not np.any(more):
            return seen
        seen = np.maximum(seen, more)


def without_lone_samples(recording: Recording, problem: Problem, fit: Fit) -> Problem:
    """Return the problem without the outliers that it has beside a fit."""
    mask = problem.whitener.mask * (1.0 - lone_samples(recording, problem, fit))
    return problem.keeping(mask)


def without_impacts(problem: Problem, fits: Iterable[Fit]) -> Problem:
    """Return the problem without the samples at which one of the fits closes a play with an impact.

    The tip's velocity jumps there. The force of mass and damper passes between two samples, or the
    sensor spreads it over several; a recording does not show which. A play about a rest closes at
    two places alone, and these are left out only if the fit leaves more there than elsewhere.
    """
    mask = problem.whitener.mask.copy()
    for fit in fits:
        plays = [e for e in fit.model.effects if e.family == "lost motion"]
        if not plays:
            continue
        closing = _closings(problem, fit)
        if any(play.state_size for play in plays) or _leaves_more(problem, fit, closing):
            mask[closing] = 0.0
    return problem.keeping(mask)


def without_start(problem: Problem, fit: Fit) -> Problem:
    """Return the problem without the first samples, while a filter of the force settles in a fit.

    Simulated, it starts at rest; a recording of a held body may begin while the channel follows a
    motion. One of a contact is used from free air on.
    """
    if fit.model.base.touches:
        return problem
    mask = problem.whitener.mask.copy()
    step = np.ones(mask.size // _FADING_PART)
    step[0] = 0.0
    course = Course.of(fit.model, problem.motion, fit.zeta)
    for effect, (_, eta) in zip(fit.model.effects, course.parameters, strict=True):
        if effect.acts == "filters_force" and effect.family == "delay":
            answer = run_step(effect, step, step, step, step, problem.motion.dt, eta)
            unsettled = np.flatnonzero(np.abs(answer - 1.0) > _SETTLED_STEP)
            mask[: unsettled[-1] + 1] = 0.0
    return problem.keeping(mask)


def _leaves_more(problem: Problem, fit: Fit, closing: NDArray[np.bool_]) -> bool:
    """Return whether the residual of a fit is clearly larger at some samples than elsewhere."""
    left, used = problem.residual(fit), problem.whitener.mask > 0.0
    there, elsewhere = (left[used & some] for some in (closing, ~closing))
    if not (there.size and elsewhere.size):
        return False
    return bool(np.std(there) > _IMPACT_RATIO * np.std(elsewhere))


def _closings(problem: Problem, fit: Fit) -> NDArray[np.bool_]:
    """Return the samples around each closing of a fit's plays."""
    slip = slip_of(fit.model, problem.motion, fit.zeta, fit.theta)
    least = _IMPACT_SPEED * problem.motion.scales["speed"]
    # Within the play the slip changes with the drive's speed, without an impact.
    ends = np.diff(slip > least) & (np.abs(np.diff(slip)) > least)
    closing = np.zeros(slip.size, dtype=bool)
    for place in np.flatnonzero(ends):
        closing[max(place - _IMPACT_SAMPLES, 0) : place + _IMPACT_SAMPLES + 2] = True
    return closing


def _unknown_history(x: Vector) -> int:
    """Return the number of first samples whose force may depend on an unknown earlier contact.

    The history of a material with memory is known from the first sample in free air or with hardly
    any penetration, within the first third. Without such a sample, a fifth of the recording is left
    for memories to fade and for the deepest penetration to be reached.
    """
    free = np.flatnonzero(x[: x.size // 3] < UNPRESSED * np.max(x))
    return int(free[0]) if free.size else x.size // _FADING_PART


def _surface_tolerance(found: Problem) -> float:
    """Return the largest difference [rig unit] between two onsets of the same surface."""
    return 0.1 * found.motion.scales["travel"]
