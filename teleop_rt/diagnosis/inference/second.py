"""Evidence for a second effect of any size that no form of the first law can produce."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.diagnosis.criteria import (
    CERTAIN_BIC,
    ENCODER_TIMES,
    SECOND_OF_LEFTOVER,
    SECOND_SHARE,
    SIGMAS,
)
from teleop_rt.diagnosis.inference.pairs import fit_without
from teleop_rt.diagnosis.inference.screening import swings
from teleop_rt.diagnosis.inference.verdict import Ranked
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.encoder import errors_without_jumps
from teleop_rt.diagnosis.noise.structure import FREE_AIR, NEAR_SURFACE, power_in_time
from teleop_rt.diagnosis.samples.motion import Motion

_ABOUT, _BESIDE = 3, 24
_SHARP = 10.0  # times what lies beside it; a line is that narrow
_RINGS_S = 0.05  # s, for which a contact's force rings on within the band
_BEYOND_CHANCE = 30.0
"""Of chi-square, above what the loudest of all bins has by chance."""
_FAR_BEYOND = 100.0  # of chi-square in free air, beyond what noise puts there
_MOST = 0.5  # of a pair's gain that must lie in free air to count there


def both_needed(
    problem: Problem, pair: Ranked, singles: dict[str, Ranked], excess: float, floor: float
) -> bool:
    """Return whether each of the two is certain given the other, and the second deserves a name.

    It is where it explains more than another form of the first's law may leave: a share of the
    whole excess, or of what the first does where the second shows, in a line or in free air.
    """
    alone = [singles[name] for name in pair.fit.names if name in singles]
    if len(alone) < len(pair.fit.names):
        alone += [
            replace(pair, fit=fit_without(problem, pair.fit, 1 - i), gain=0.0, delta_bic=0.0)
            for i, name in enumerate(pair.fit.names)
            if name not in singles
        ]
    best = min(alone, key=lambda r: r.fit.bic)
    if not all(r.fit.bic - pair.fit.bic > CERTAIN_BIC for r in alone):
        return False
    gain = best.fit.chi2 - pair.fit.chi2
    place = _bin_of_tone(problem, pair.fit)
    if place is not None and best.apart:
        there = _about(_spectrum(problem.target - best.fit.residual))[place]
        return bool(gain > SECOND_SHARE * there)
    leftover = max(best.left.excess, 0.0)
    if gain > max(SECOND_SHARE * excess, ENCODER_TIMES * floor, SECOND_OF_LEFTOVER * leftover):
        return True
    if not (best.apart and _acts_in_air(pair.fit, best.fit)):
        return False
    in_air = _in_free_air(problem, best.fit)[0] - _in_free_air(problem, pair.fit)[0]
    return in_air > max(_FAR_BEYOND, _MOST * gain, ENCODER_TIMES * floor)


def _acts_in_air(pair: Fit, alone: Fit) -> bool:
    """Return whether a pair adds a force in free air to a fit."""
    added = [effect for effect in pair.model.effects if effect.name not in alone.names]
    return all(e.acts == "adds_force" and not e.only_in_contact for e in added)


def shows_apart(problem: Problem, fit: Fit, errors: list[Motion]) -> bool:
    """Return whether the residual contains a tone, or more than noise in free air.

    A tone is narrow, and more than another form of the law would leave of the force at these
    frequencies, and than the fit makes of the encoder's `errors`; of an effect that swings it would
    be a harmonic. In free air a material does nothing.
    """
    if any(swings(effect) for effect in fit.model.effects):
        return False
    left = _about(_spectrum(fit.residual))
    chance = 2.0 * (2 * _ABOUT + 1 + np.log(left.size) + _BEYOND_CHANCE)
    force = _about(_spectrum(problem.target - fit.residual))
    lines = (left > chance) & (left > SECOND_SHARE * force)
    if np.any(lines):
        lines &= left > _SHARP * _beside(left)
        rows = errors_without_jumps(problem, fit, errors)
        by_encoder = np.max([_about(_spectrum(row)) for row in rows], axis=0)
        if np.any(lines & (left > ENCODER_TIMES * by_encoder)):
            return True
    materials = all(effect.only_in_contact for effect in fit.model.effects)
    if not materials:
        return False
    beyond, chance = _in_free_air(problem, fit)
    return beyond > _FAR_BEYOND + SIGMAS * chance


def _in_free_air(problem: Problem, fit: Fit) -> tuple[float, float]:
    """Return the chi-square of a residual in free air beyond the noise's, and its deviation.

    Both 0 without enough free air. What the contact leaves rings on beside it, within the band. The
    more coloured the noise is, the fewer independent values a stretch of it holds.
    """
    margin = NEAR_SURFACE * problem.motion.scales["travel"]
    air = (problem.whitener.mask > 0.0) & (problem.motion.x < -margin)
    air = scipy.ndimage.binary_erosion(air, iterations=max(1, round(_RINGS_S / problem.motion.dt)))
    if not fit.model.base.touches or np.count_nonzero(air) < FREE_AIR * air.size:
        return 0.0, 0.0
    density = problem.whitener.density
    noise = 2.0 * float(np.sum(density)) / problem.force.size**2
    independent = 2.0 * float(np.sum(density) ** 2 / np.sum(density**2)) * float(np.mean(air))
    left = float(np.mean(power_in_time(problem, fit.residual)[air]))
    return independent * (left / noise - 1.0), float(np.sqrt(2.0 * independent))


def _bin_of_tone(problem: Problem, pair: Fit) -> int | None:
    """Return the bin of a pair's tone in time; None where none of the two, or both, are one."""
    tones = [
        float(value)
        for value, c in zip(pair.zeta, pair.model.coordinates, strict=True)
        if c.owner >= 0 and c.shape.unit == "Hz" and _adds_tone(pair.model.effects[c.owner])
    ]
    if len(tones) != 1:
        return None
    place = round(tones[0] * problem.motion.dt * problem.force.size)
    return min(place, problem.whitener.bins - 1)


def _adds_tone(effect: Effect) -> bool:
    return swings(effect) and effect.acts == "adds_force"


def _spectrum(whitened: Vector) -> Vector:
    """Return the power of a whitened row in each bin."""
    bins = whitened.size // 2
    return np.asarray(whitened[:bins] ** 2 + whitened[bins:] ** 2, dtype=np.float64)


def _about(power: Vector) -> Vector:
    """Return the power in each bin and those about it, into which a tone leaks."""
    return np.convolve(power, np.ones(2 * _ABOUT + 1), mode="same")


def _beside(about: Vector) -> Vector:
    """Return the power that is typical on either side of each bin, of the louder side."""
    padded = np.pad(about, _BESIDE, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _BESIDE + 1)
    below, above = windows[:, : _BESIDE - 2 * _ABOUT], windows[:, _BESIDE + 2 * _ABOUT + 1 :]
    return np.maximum(np.median(below, axis=1), np.median(above, axis=1))
