"""Notes beside an answer, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.criteria import NAMED_SHARE, REDRAWN_NOISE_RATIO
from teleop_rt.diagnosis.inference.explanation import highest_probability
from teleop_rt.diagnosis.models.base import Base, base_of
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.samples.free import FREE
from teleop_rt.diagnosis.samples.held import HELD, HELD_ABOUT, LEFT
from teleop_rt.diagnosis.samples.implausible import doubtful_unit
from teleop_rt.diagnosis.samples.preparation import Samples
from teleop_rt.diagnosis.samples.smoothing import half_window, moves_in_steps, too_quick
from teleop_rt.diagnosis.samples.surface import onset_far_from, surface_of
from teleop_rt.recordings.recording import Recording
from teleop_rt.recordings.rows import stretches

STEPS_OF_MOTION = (
    "steps of the motion: the velocity jumps between two samples, as it does when the link jitters"
    " or loses packets. The samples do not show the motion in between, so a model is judged on the"
    " slower part of the force only: below 50 Hz, or a twentieth of the rate"
)
_MODELS = {"before": "the base", "after": "the model with the effects"}
_FOREIGN = 0.5
"""Of the force's deviation; a larger error suggests that the recording is of another object."""
_ROUNDED = 1e-3  # of a probability, as the answer states it
_LEAST_OF_TIME = 0.1
"""Of the base's mean square; a law of wrong form may cause a smaller dependence on time."""
_NEARLY_WHOLE = 0.98  # of a recording; a smaller part is not all of it but for its rounding
_LOST_CONTACT_S = 0.03  # s; a touch, and the settling of a filter after it, are shorter
_LOST_CONTACT_RATIO = 10.0  # of the residual there to its deviation elsewhere
_LETS_GO = {"relaxation", "hysteresis"}
"""Families of effects by which a body keeps a dent for a while, and releases the tool early."""
_RESTS_ON = {
    "away from touches": (
        "20 ms around each touch and release were left out: there the force is slightly early or"
        " late against every model, as with filters in both channels or unevenly taken samples;"
        " effects that act only there are not detected"
    ),
    "from the start": (
        "the recording starts in contact, and an earlier contact may act until the first release;"
        " the reported effect appears only there, and is valid if the body was not pressed before:"
        " start in free air to confirm it"
    ),
    "without an odd beginning": (
        "the recording starts in contact, and until the first release the force differs from that"
        " of the rest: an earlier contact may act there, so this part was not used; start in free"
        " air to include it"
    ),
}


def of_part(from_s: float, length_s: float, whole_s: float) -> list[str]:
    """Return the note that only a part of a long recording was judged."""
    if length_s > _NEARLY_WHOLE * whole_s:
        return []
    note = (
        f"only the busiest {length_s:.1f} s of {whole_s:.1f} s were judged, from {from_s:.1f} s on:"
        " sizes, deviations and errors are of that part, and an effect that acts only elsewhere is"
        " not seen; cut other parts out of the file and diagnose them, too"
    )
    return [note]


def _of_surface(base: Base, recording: Recording, surface: float | None) -> list[str]:
    """Return the note on the assumed surface, or on a given one that the recording contradicts."""
    if not base.touches:
        return []
    if surface is not None:
        return _of_contradicted_surface(base, recording, surface)
    if recording.surface is not None:
        return []
    note = ""
    if not base.finds_surface:
        note = (
            "no surface is given, and the recording does not contradict 0: the surface was assumed"
            " at 0 of the axis; give another with --surface"
        )
    elif not surface_of(recording).clear:
        note = (
            "no surface is given, and no approach shows it clearly: it is a parameter of the base,"
            " which hides an offset of position or force; give it with --surface"
        )
    return [note] if note else []


def _of_contradicted_surface(base: Base, recording: Recording, surface: float) -> list[str]:
    """Return the note on a given surface far from where the force of every approach begins."""
    seen = onset_far_from(surface, recording)
    if seen is None:
        return []
    unit = recording.units[0]
    begins = (
        f"the force begins at {seen.position:.4g} {unit}, and the given surface is {surface:.4g}"
        f" {unit}"
    )
    if base.finds_surface:
        return [f"{begins}, with which the base predicts worse: it was found instead; correct it"]
    found = "if that is a mistake, names and parameters rest on it; give another --surface, or none"
    return [f"{begins}: {found}"]


def _of_other_contact(base: Base, stated: str, surface: float | None) -> list[str]:
    """Return the note on a base that was exchanged: a body is fixed, or left, or there is none."""
    if base.touches == base_of(stated).touches:
        return []
    if base.moves_mass and not base.touches and not base_of(stated).has_mass:
        return [FREE.format(base=base.name, stated=stated)]
    held = HELD if surface is None else HELD_ABOUT
    return [(LEFT if base.touches else held).format(base=base.name, stated=stated)]


def notes_of(
    answer: dict[str, Any],
    base: Base,
    stated: str,
    recording: Recording,
    surface: float | None,
    samples: Samples,
) -> list[str]:
    """Return the notes of an answer: assumptions, limits of its validity, and next steps.

    `stated` is the base and `surface` the place that the caller gave, None without one.
    """
    found = _of_other_contact(base, stated, surface) + _of_surface(base, recording, surface)
    stiffness = answer["base"]["parameters"].get("k", {"value": None})["value"]
    if stiffness is not None and not base.has_power:
        travel = float(np.ptp(recording.position))
        found += filter(None, [doubtful_unit(recording.units[0], travel, stiffness)])
    if samples in _RESTS_ON:
        found.append(_RESTS_ON[samples])
    if moves_in_steps(recording.position, recording.force, recording.dt):
        found.append(STEPS_OF_MOTION)
    else:
        half = half_window(recording.position, recording.dt, 2 if base.has_mass else 1)
        found += _of_quick_motion(too_quick(recording.position, recording.dt, half), recording)
    found += _of_possible(answer) + _of_what_is_left(answer) + _of_predictor(answer)
    return found + _of_errors(answer)


def _of_quick_motion(quick: Vector, recording: Recording) -> list[str]:
    """Return the note on moments left out, whose velocity the position does not show.

    Over a gap the position is a bridge, whose bends are none of the motion.
    """
    dt = recording.dt
    moments = [m for m in stretches(quick > 0.0) if not _missing(recording, *m)]
    if not moments:
        return []
    first, seconds = moments[0][0] * dt, dt * sum(past - first for first, past in moments)
    return [
        (
            f"{seconds:.2g} s of the motion were left out ({len(moments)} moments, the first at"
            f" {first:.2f} s): there the velocity changes faster than the encoder shows, as when a"
            " limiter stops the tool; effects that act only there are not detected"
        )
    ]


def _missing(recording: Recording, first: int, past: int) -> bool:
    """Return whether a sample of the stretch is missing in the recording."""
    return bool(np.any(recording.mask[first:past] == 0.0))


def _of_possible(answer: dict[str, Any]) -> list[str]:
    """Return the note on effects that only some of the possible sets contain."""
    certain = {name for names in answer["class"] for name in names}
    possible = {name: p for name, p in answer["probability"].items() if name not in certain}
    if not possible:
        return []
    names = " and ".join(f"{name} (probability {p:.2f})" for name, p in sorted(possible.items()))
    return [f"{names} may act as well: the set without them is not excluded"]


def _of_what_is_left(answer: dict[str, Any]) -> list[str]:
    """Return the notes on a structure that no named effect explains."""
    if answer["verdict"] not in {"partial", "unexplained"}:
        return []
    deviations = (
        "the deviations of parameters are those of a complete model: the missing part may"
        " move them by more"
    )
    if _explains_most(answer):
        return [deviations]
    share = (
        "the named effects explain less than 95 % of the structure above the noise; the errors"
        " are those of the set chosen to predict, named or not: see the residual against"
        " position, velocity and time on the page of --out, and its draft of a law for"
        " --effects FILE"
    )
    return [share, deviations]


def _of_predictor(answer: dict[str, Any]) -> list[str]:
    """Return the note on errors of another set than the named one."""
    if answer["verdict"] not in {"named", "class"}:
        return []
    predictor, named = answer["predictor"], {effect["name"] for effect in answer["effects"]}
    if not predictor or set(predictor) == named:
        return []
    return [f"the errors are those of the set that predicts best: {' + '.join(predictor)}"]


def _explains_most(answer: dict[str, Any]) -> bool:
    """Return whether the effects explain as much as those of a named set."""
    return sum(effect["explains"] or 0.0 for effect in answer["effects"]) >= NAMED_SHARE


def _of_errors(answer: dict[str, Any]) -> list[str]:
    """Return the notes on errors that are undefined, or larger than the answer promises."""
    found, error = list[str](), answer["error"]
    unpredicted = [word for key, word in _MODELS.items() if error["std_normalised"][key] is None]
    if unpredicted:
        found.append(
            f"the force on the {error['on']} cannot be predicted by {' or '.join(unpredicted)}:"
            " parameters fitted to one part of the recording do not hold in the rest; record more"
            " of the same motion, or choose another base"
        )
    missed, before = (error["std_normalised"][key] for key in ("after", "before"))
    if missed is not None and missed > (before or np.inf):
        found.append(
            f"the answer does not predict: its error on the {error['on']} is larger than that of"
            " the base; do not render it"
        )
    if error["on"] == "held-out record" and (missed or 0.0) > _FOREIGN:
        found.append(
            f"the error on the held-out record is {missed:.2g} times the deviation of its force:"
            " check it: is it of the same object, and in the same units?"
        )
        return found
    return found + _of_ratio(answer, error["after_over_floor"] or 0.0)


def _of_ratio(answer: dict[str, Any], ratio: float) -> list[str]:
    """Return the note on an error that is larger than that of noise, though nothing is left."""
    verdict = answer["verdict"]
    left = verdict == "unexplained" or (verdict == "partial" and not _explains_most(answer))
    if left or ratio <= REDRAWN_NOISE_RATIO:
        return []
    cause = f"the held-out error is {ratio:.2g} times that of noise alone"
    if verdict == "no_missing_effect":
        return [
            (
                f"{cause}: a slow effect may be missing that cannot be distinguished from slow"
                " noise; make a longer recording, or one with more free air, to separate them"
            )
        ]
    form = (
        "the effect may have another form, or a further one may be missing; record another motion"
        " to separate them"
    )
    highest = highest_probability(ratio)
    if abs(max(answer["probability"].values(), default=0.0) - highest) > _ROUNDED:
        return [f"{cause}: {form}"]  # the error does not bound this probability
    share = f"of answers that leave as much, {100.0 * highest:.0f} % hold the right names"
    return [f"{cause}; {share}: {form}"]


def of_dropout(first_s: float, past_s: float) -> str:
    """Return the note of a stretch in which the force sensor dropped out."""
    return (
        f"from {first_s:.3f} to {past_s:.3f} s the force error of any model is ten times larger"
        " than usual, and counts as a gap: did the sensor drop out? Check its connection"
    )


def of_lost_contact(problem: Problem, fit: Fit, recording: Recording, start: float) -> list[str]:
    """Return the note on stretches beyond the surface that were left out, and contradict the fit.

    They show the force of free air (see `lost_contact`); `start` is the time of the first sample
    [s]. Where the model has no force either, nothing contradicts it. A base without a surface has
    no contact to lose.
    """
    if not fit.model.base.touches:
        return []
    motion, used = problem.motion, problem.whitener.mask > 0.0
    off = np.abs(problem.residual(fit))
    least = _LOST_CONTACT_RATIO * float(np.sqrt(np.mean(off[used] ** 2)))
    inside = touches(motion.x + fit.model.shift(fit.zeta))
    lost = [
        (first, past)
        for first, past in stretches(inside & ~used)
        if (past - first) * motion.dt >= _LOST_CONTACT_S
        and np.median(off[first:past]) > least
        and np.any(used[:first])
        and not _missing(recording, first, past)
    ]
    if not lost:
        return []
    seconds = motion.dt * sum(past - first for first, past in lost)
    lets_go = any(effect.family in _LETS_GO for effect in fit.model.effects)
    why = (
        "a body that relaxes lets go of the tool on its way out, as that of the effects found; if"
        " they come on the way in, check the connection of the force sensor"
        if lets_go
        else "the tool lost the body there, or the force channel stood still; check its connection"
    )
    note = (
        f"{seconds:.2g} s beyond the surface show the force of free air, and were left out"
        f" (in {len(lost)} of the touches, first at {start + lost[0][0] * motion.dt:.2f} s): {why}"
    )
    return [note]


def of_time(shares: Mapping[str, float] | None) -> list[str]:
    """Return the note on the residual's dependence on time, if its share is large."""
    share = (shares or {}).get("time", 0.0)
    if share < _LEAST_OF_TIME:
        return []
    text = (
        f"{100.0 * share:.0f} % of the base's residual depends on the time since the recording"
        " began; that carries over to no other recording, so no law of time is drafted: record the"
        " same motion twice to see whether it repeats"
    )
    return [text]
