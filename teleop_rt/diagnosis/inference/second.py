"""Evidence for a second effect of any size that no form of the first law can produce."""

from __future__ import annotations

from dataclasses import replace
from math import log1p

import numpy as np

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.diagnosis.criteria import (
    CERTAIN_BIC,
    ENCODER_ENERGY_RATIO,
    FORM_DIRECTIONS,
    SECOND_SHARE,
    SIGMAS,
)
from teleop_rt.diagnosis.inference.pairs import fit_without
from teleop_rt.diagnosis.inference.swings import swings
from teleop_rt.diagnosis.inference.verdict import Ranked
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.encoder import errors_without_jumps
from teleop_rt.diagnosis.noise.structure import FREE_AIR, air_and_contact, power_in_time
from teleop_rt.diagnosis.samples.filters import running_rank
from teleop_rt.diagnosis.samples.motion import RecordedMotion

_TONE_BINS = 3  # bins on either side into which a tone leaks
_TONE_DIRECTIONS = 2 * (2 * _TONE_BINS + 1)  # sine and cosine of each of these bins
_NEIGHBOUR_BINS = 24  # bins on either side that give the typical power beside a tone
_TONE_RATIO = 10.0  # times the typical power beside it; a broader peak is no tone
_RINGING_S = 0.05  # s after a contact in which the band limit makes its residual ring
_TONE_CHI2 = 30.0
"""Chi-square above the largest that noise alone gives in any bin."""
_AIR_CHI2 = 100.0  # chi-square in free air above that of the noise
_AIR_SHARE = 0.5  # of a pair's gain that must lie in free air to count there


def both_needed(
    problem: Problem, pair: Ranked, singles: dict[str, Ranked], excess: float, floor: float
) -> bool:
    """Return whether both effects of a pair are needed, each given the other.

    The second must explain more than another form of the first law could: more than a share of the
    whole excess and than an unknown function would (see `_beats_unknown_function`), or a tone or
    free-air force that no form of the first law produces.
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
    if place is not None and best.tone_or_air_force:
        there = _tone_power(_spectrum(problem.target - best.fit.residual))[place]
        return bool(gain > SECOND_SHARE * there)
    # Only encoder errors along the pair may stand in for it: those at each touch are no bias.
    by_encoder = ENCODER_ENERGY_RATIO * min(floor, pair.encoder_energy_along)
    if gain > max(SECOND_SHARE * with_form(excess, best), by_encoder):
        # A single effect outside the pair that leaves less is the same claim with one name less.
        rival = min(singles.values(), key=lambda r: r.fit.bic)
        if all(_beats_unknown_function(pair, single, floor) for single in (best, rival)):
            return True
    if not (best.tone_or_air_force and _acts_in_air(pair.fit, best.fit)):
        return False
    in_air = _in_free_air(problem, best.fit)[0] - _in_free_air(problem, pair.fit)[0]
    return in_air > max(_AIR_CHI2, _AIR_SHARE * gain, by_encoder)


def with_form(excess: float, alone: Ranked) -> float:
    """Return the part of the excess of which another form of a single effect may take a share.

    That is all of it, but for a tone: a line has no other form, and its energy, which grows with
    the recording, would hide every other effect.
    """
    tone = len(alone.fit.names) == 1 and adds_tone(alone.fit.model.effects[0])
    return max(excess - alone.gain, 0.0) if tone else excess


def _beats_unknown_function(pair: Ranked, single: Ranked, floor: float) -> bool:
    """Return whether a pair is likelier than a single effect beside an unknown function.

    No law is exact. What its form misses is one function of the motion with a free size, of which
    a recording shows nu = `FORM_DIRECTIONS` values, so -2 log p of a remainder of energy E beyond
    the noise is nu log(1 + E / nu), as in `explanation`. A pair pays for the remainder that it
    leaves beyond the encoder's errors (`floor`), and for its parameters. The single effect pays for
    that remainder and for what the pair explains.
    """
    left = max(pair.left.excess - floor, 0.0)
    energies = (left + single.fit.chi2 - pair.fit.chi2, left)
    whole, rest = (
        FORM_DIRECTIONS * log1p(energy / (FORM_DIRECTIONS * pair.left.noise_per_direction))
        for energy in energies
    )
    parameters = (pair.fit.bic - pair.fit.chi2) - (single.fit.bic - single.fit.chi2)
    return whole - rest - parameters > CERTAIN_BIC


def _acts_in_air(pair: Fit, alone: Fit) -> bool:
    """Return whether a pair adds a force in free air to a fit."""
    added = [effect for effect in pair.model.effects if effect.name not in alone.names]
    return all(e.acts == "adds_force" and not e.only_in_contact for e in added)


def shows_tone_or_air_force(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> bool:
    """Return whether the residual contains a tone, or more than noise in free air.

    A tone is a narrow line, larger than the error of another form of the law at these frequencies
    and larger than the force that the encoder's `errors` cause. Lines of a fit with an oscillating
    effect do not count, because they may be its harmonics. Free air counts if all effects act in
    contact only.
    """
    if any(swings(effect) for effect in fit.model.effects):
        return False
    left = _tone_power(_spectrum(fit.residual))
    chance = 2.0 * (2 * _TONE_BINS + 1 + np.log(left.size) + _TONE_CHI2)
    force = _tone_power(_spectrum(problem.target - fit.residual))
    lines = (left > chance) & (left > SECOND_SHARE * force)
    if np.any(lines):
        lines &= left > _TONE_RATIO * _neighbour_power(left)
        rows = errors_without_jumps(problem, fit, errors)
        by_encoder = np.max([_tone_power(_spectrum(row)) for row in rows], axis=0)
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


def noise_beside_tone(problem: Problem, fit: Fit) -> float | None:
    """Return the energy of noise in each direction beside a fit's tone; None without a tone.

    A resonance of the rig raises the noise in a band that no colour of the noise model follows, and
    its largest bins look like tones against the model.
    """
    place = _bin_of_tone(problem, fit)
    if place is None:
        return None
    return float(_neighbour_power(_tone_power(_spectrum(fit.residual)))[place]) / _TONE_DIRECTIONS


def adds_tone(effect: Effect) -> bool:
    """Return whether an effect is a force of one frequency in time."""
    in_time = any(shape.unit == "Hz" for shape in effect.shapes)
    return in_time and swings(effect) and effect.acts == "adds_force"


def _spectrum(whitened: Vector) -> Vector:
    """Return the power of a whitened row in each bin."""
    bins = whitened.size // 2
    return np.asarray(whitened[:bins] ** 2 + whitened[bins:] ** 2, dtype=np.float64)


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
