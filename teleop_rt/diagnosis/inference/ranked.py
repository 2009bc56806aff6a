"""Fitted candidate sets, and the share of the base's residual that each explains."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from teleop_rt.contact.effect import Family
from teleop_rt.diagnosis.criteria import (
    BEYOND_ENCODER_DRAWS,
    CERTAIN_BIC,
    DOUBT_WEIGHT,
    ENCODER_ENERGY_RATIO,
    NAMED_SHARE,
    SIGMAS,
)
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.noise.structure import LackOfFit


@dataclass(frozen=True)
class Ranked:
    """A candidate set with its gain over the base and the structure in its residual `left`.

    `air_mismatch` is the difference between the residuals in contact and in free air, as a share of
    the base's residual. `lacks_named_property` states that an effect fits as well without the
    property in its name, such as a damping by direction that is equal in both directions, and
    `at_bound` names the effects with a shape at a bound that is not its ideal one.
    `tone_or_air_force` states that the residual contains a tone or a force in free air, which no
    form of the law produces.

    Energies [chi-square]: `encoder_energy_along` is that of encoder errors in the directions that
    the set adds to the base; `encoder_misfits` those of the errors outside the fit, one per draw
    (only the best fits have them); `noise_per_direction` that of noise in each added direction,
    None for a set whose shape was searched.
    """

    fit: Fit
    gain: float
    delta_bic: float
    left: LackOfFit
    air_mismatch: float = 0.0
    lacks_named_property: bool = False
    at_bound: frozenset[str] = frozenset()
    encoder_energy_along: float = inf
    encoder_misfits: tuple[float, ...] = ()
    tone_or_air_force: bool = False
    noise_per_direction: float | None = None


def excess_of(base: LackOfFit, best: Ranked | None) -> float:
    """Return the energy of the base's residual above the noise."""
    by_candidate = best.gain + max(best.left.excess, 0.0) if best else 0.0
    return max(base.excess, by_candidate)


def explains(ranked: Ranked, excess: float, slack: float = 0.0) -> float:
    """Return the share of the excess that a set explains, of 0 to 1.

    `slack` is the residual energy that counts as explained (see `slack_of`).
    """
    if excess <= 0.0:
        return 0.0
    return float(min(1.0, max(0.0, 1.0 - max(ranked.left.excess - slack, 0.0) / excess)))


def slack_of(ranked: Ranked, floor: float) -> float:
    """Return the residual energy of a set that chance and encoder errors (`floor`) account for."""
    return SIGMAS / 2.0 * ranked.left.deviation + floor


def adequate(ranked: Ranked, excess: float, most: float, floor: float) -> bool:
    """Return whether a set explains 95 % of the excess, up to noise and encoder errors.

    `most` is the largest gain of any set; this set must gain as much. `floor` is the energy of the
    encoder errors, which no effect explains. A set that passes more of these errors to the force
    than the base does may leave that much more, if it gains well beyond it.
    """
    share = (1.0 - NAMED_SHARE) * excess
    left = max(ranked.left.excess, most - ranked.gain)
    return left <= share + slack_of(ranked, floor) and ranked.air_mismatch <= 1.0 - NAMED_SHARE


def leaves_structure(left: LackOfFit, floor: float) -> bool:
    """Return whether a residual has structure above chance and above the encoder errors."""
    return left.excess > SIGMAS * left.deviation + ENCODER_ENERGY_RATIO * floor


def certain(ranked: Ranked, floor: float, *, exceeds_noise: bool = False) -> bool:
    """Return whether a single effect is beyond chance and twice (in force) above the input floor.

    The level of red noise is uncertain, so the gain is divided by a factor, except if the base's
    residual `exceeds_noise` of any level. Only encoder errors along the effect count: errors at
    each touch have no component along a bias. A few draws do not distinguish an effect from the
    encoder if it gains less than it leaves to the encoder, unless the draws have almost no
    component along it: errors of a mass produce no drift.
    """
    penalty = ranked.gain - ranked.delta_bic
    chance = (
        ranked.left.noise_per_direction
        if ranked.noise_per_direction is None
        else ranked.noise_per_direction
    )
    gain = ranked.gain / (chance if exceeds_noise else scaled_by_doubt(ranked, chance))
    beyond = ENCODER_ENERGY_RATIO * min(floor, ranked.encoder_energy_along)
    if ranked.gain < BEYOND_ENCODER_DRAWS * ranked.encoder_energy_along and not leaves_structure(
        ranked.left, floor
    ):
        beyond = max(beyond, min(floor, ranked.left.excess))
    return gain - penalty > CERTAIN_BIC and ranked.gain > beyond


def scaled_by_doubt(ranked: Ranked, difference: float) -> float:
    """Return a difference of chi-square, scaled up by the uncertainty of the noise level."""
    return difference * (1.0 + DOUBT_WEIGHT * ranked.left.doubt)


def family_of(ranked: Ranked) -> Family:
    """Return the family of the set's first effect."""
    return ranked.fit.model.effects[0].family
