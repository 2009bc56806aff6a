"""Tones and forces in free air in a residual, which no other form of an effect's law makes."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.diagnosis.criteria import ENCODER_ENERGY_RATIO, SECOND_SHARE, SIGMAS
from teleop_rt.diagnosis.inference.swings import swings
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.encoder import errors_without_jumps
from teleop_rt.diagnosis.noise.structure import FREE_AIR, air_and_contact, power_in_time
from teleop_rt.diagnosis.noise.whiten import power_of
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.recordings.filters import running_rank

_TONE_BINS = 3  # bins on either side into which a tone leaks
_TONE_DIRECTIONS = 2 * (2 * _TONE_BINS + 1)  # sine and cosine of each of these bins
_NEIGHBOUR_BINS = 24  # bins on either side that give the typical power beside a tone
_TONE_RATIO = 10.0  # times the typical power beside it; a broader peak is no tone
_RINGING_S = 0.05  # s after a contact in which the band limit makes its residual ring
_TONE_CHI2 = 30.0
"""Chi-square above the largest that noise alone gives in any bin."""
_AIR_CHI2 = 100.0  # chi-square in free air above that of the noise


def shows_tone_or_air_force(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> bool:
    """Return whether the residual contains a tone, or more than noise in free air.

    A tone is a narrow line, larger than the error of another form of the law at these frequencies
    and larger than the force that the encoder's `errors` cause. Lines of a fit with an oscillating
    effect do not count, because they may be its harmonics. Free air counts if all effects act in
    contact only.
    """
    if any(swings(effect) for effect in fit.model.effects):
        return False
    left = _tone_power(power_of(fit.residual))
    chance = 2.0 * (2 * _TONE_BINS + 1 + np.log(left.size) + _TONE_CHI2)
    force = _tone_power(power_of(problem.target - fit.residual))
    lines = (left > chance) & (left > SECOND_SHARE * force)
    if np.any(lines):
        lines &= left > _TONE_RATIO * _neighbour_power(left)
        rows = errors_without_jumps(problem, fit, errors)
        by_encoder = np.max([_tone_power(power_of(row)) for row in rows], axis=0)
        if np.any(lines & (left > ENCODER_ENERGY_RATIO * by_encoder)):
            return True
    materials = all(effect.only_in_contact for effect in fit.model.effects)
    if not materials:
        return False
    beyond, chance = _in_free_air(problem, fit)
    return beyond > _AIR_CHI2 + SIGMAS * chance


def _in_free_air(problem: Problem, fit: Fit) -> tuple[float, float]:
    """Return the chi-square of a residual in free air above the noise, and its deviation.

    Both are 0 without enough free air. Samples near a contact are left out, because the band limit
    makes its residual ring. Coloured noise has fewer independent values per second than white.
    """
    beside = max(1, round(_RINGING_S / problem.motion.dt))
    inside = air_and_contact(problem)[0].astype(np.float64)
    air = running_rank(np.pad(inside, beside), 2 * beside + 1, 0.0)[beside:-beside] > 0.0
    if not fit.model.base.touches or np.count_nonzero(air) < FREE_AIR * air.size:
        return 0.0, 0.0
    density = problem.whitener.density
    noise = 2.0 * float(np.sum(density)) / problem.force.size**2
    independent = 2.0 * float(np.sum(density) ** 2 / np.sum(density**2)) * float(np.mean(air))
    left = float(np.mean(power_in_time(problem, fit.residual)[air]))
    return independent * (left / noise - 1.0), float(np.sqrt(2.0 * independent))


def noise_beside_tone(problem: Problem, fit: Fit) -> float | None:
    """Return the energy of noise in each direction beside a fit's tone; None without a tone.

    A resonance of the rig raises the noise in a band that no colour of the noise model follows, and
    its largest bins look like tones against the model.
    """
    place = _bin_of_tone(problem, fit)
    if place is None:
        return None
    return float(_neighbour_power(_tone_power(power_of(fit.residual)))[place]) / _TONE_DIRECTIONS


def _bin_of_tone(problem: Problem, fit: Fit) -> int | None:
    """Return the bin of a fit's tone in time; None unless exactly one effect is a tone."""
    tones = [
        float(value)
        for value, c in zip(fit.zeta, fit.model.coordinates, strict=True)
        if c.owner >= 0 and c.shape.unit == "Hz" and adds_tone(fit.model.effects[c.owner])
    ]
    if len(tones) != 1:
        return None
    place = round(tones[0] * problem.motion.dt * problem.force.size)
    return min(place, problem.whitener.bins - 1)


def adds_tone(effect: Effect) -> bool:
    """Return whether an effect is a force of one frequency in time."""
    in_time = any(shape.unit == "Hz" for shape in effect.shapes)
    return in_time and swings(effect) and effect.acts == "adds_force"


def _tone_power(power: Vector) -> Vector:
    """Return the power summed over each bin and its neighbours, into which a tone leaks."""
    return np.convolve(power, np.ones(2 * _TONE_BINS + 1), mode="same")


def _neighbour_power(about: Vector) -> Vector:
    """Return the median power beside each bin, of the side where it is larger."""
    padded = np.pad(about, _NEIGHBOUR_BINS, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOUR_BINS + 1)
    below, above = (
        windows[:, : _NEIGHBOUR_BINS - 2 * _TONE_BINS],
        windows[:, _NEIGHBOUR_BINS + 2 * _TONE_BINS + 1 :],
    )
    return np.maximum(np.median(below, axis=1), np.median(above, axis=1))
