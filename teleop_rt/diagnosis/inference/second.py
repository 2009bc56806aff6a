"""Evidence for one more effect, of any size, beside the errors of each law's form.

No law is exact: a friction may depend on the depth, a relaxation may have more arms. The error of a
law's form is its own force times a smooth function of position, speed or time, or a delayed part of
it. It has a free size, up to the largest of `_FORM_SIZES`, and its coefficients are
integrated out (a discrepancy of Kennedy and O'Hagan 2001, in the directions of the law). A second
effect is needed if it is likelier than all these.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.diagnosis.criteria import (
    CERTAIN_BIC,
    DOUBT_WEIGHT,
    ENCODER_ENERGY_RATIO,
    SECOND_SHARE,
    SIGMAS,
)
from teleop_rt.diagnosis.inference.one_more import fit_without, without
from teleop_rt.diagnosis.inference.ranked import Ranked
from teleop_rt.diagnosis.inference.tones import adds_tone
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.models.simulate import first_order
from teleop_rt.diagnosis.noise.structure import tangent_space

_FORM_SIZES = (0.03, 0.1, 0.3)
"""Force that the form of a law misses, as shares of the law's own, the likeliest of which counts:
published laws of one physics (Dahl, Bouc and Wen, Maxwell slip) differ by a tenth."""
_REST_LEFT = 0.02
"""Share of the structure beside its best part that a set leaves if its last effect is no form
error: partners that imitate form errors leave 0.2 to 0.9 of it, effects that are there 0.03 or
less."""
_NEARLY_NOTHING = 0.1
"""The same share for a small effect beside a large one, whose form leaves a part: half of the
residual of partners that imitate form errors. Chance must be smaller than their residual."""
_SHORTEST_MEMORY = 5.0  # samples; a shorter delay shows nothing beside the noise
_LONGEST_MEMORY = 1.0 / 3.0  # of the recording; a longer one is a drift
_MEMORIES = 5  # time constants between the two, a few of them in each decade
_NEAR = 0.1  # of the largest speed or depth, within which a law starts or turns over


def parts_of(fit: Fit) -> list[frozenset[str]]:
    """Return the names of a fit's effects without each one in turn."""
    return [frozenset(fit.names) - {name} for name in fit.names]


def all_needed(
    problem: Problem,
    longer: Ranked,
    shorter: Mapping[frozenset[str], Ranked],
    excess: float,
    floor: float,
) -> bool:
    """Return whether every effect of a set is needed, given the others.

    The set must be likelier than its best part, and than the best set of all with one effect less,
    beside the errors of each law's form; and gain more than encoder errors (`floor`) along it can.
    `excess` is the energy of the base's residual above the noise, but for a tone's.
    """
    alone = [
        shorter[part]
        if part in shorter
        else replace(longer, fit=fit_without(problem, longer.fit, i), gain=0.0, delta_bic=0.0)
        for i, part in enumerate(parts_of(longer.fit))
    ]
    best = min(alone, key=lambda r: r.fit.bic)
    if not all(r.fit.bic - longer.fit.bic > CERTAIN_BIC for r in alone):
        return False
    # Only encoder errors along the set may stand in for it: those at each touch are no bias.
    by_encoder = ENCODER_ENERGY_RATIO * min(floor, longer.encoder_energy_along)
    if best.fit.chi2 - longer.fit.chi2 <= by_encoder:
        return False
    # A shorter set outside it that leaves less is the same claim with one name less.
    rival = min(shorter.values(), key=lambda r: r.fit.bic)
    if rival is best and _takes_the_rest(longer, best):
        return True
    # The form of the first law may leave as much as this, but a partner does not take that.
    small = not best.tone_or_air_force and _rest(best) < SECOND_SHARE * excess
    if small and not takes_nearly_all(longer, best):
        return False
    left = _Remainder.of(problem, longer, best, excess, floor)
    rivals = (best.fit,) if rival.fit is best.fit else (best.fit, rival.fit)
    # The form of one law may explain all, and the set leave a part to the unknown.
    return all(
        one.criterion(problem, fit) - one.criterion(problem, longer.fit) > CERTAIN_BIC
        for one in (left, left.without_unknown())
        for fit in rivals
    )


def extension_needed(
    problem: Problem,
    longer: Ranked,
    simpler: Ranked,
    shorter: Mapping[frozenset[str], Ranked],
    excess: float,
    floor: float,
) -> bool:
    """Return whether a set is needed over the one with a special case of one of its effects.

    It is if it is likelier beside the form errors of its laws, and gains more than another form of
    that special case could (`SECOND_SHARE` of this one's gain beside the other members).
    `excess` and `floor` are those of `all_needed`.
    """
    common = [
        shorter[part]
        for part in parts_of(longer.fit)
        if part in shorter and part < frozenset(simpler.fit.names)
    ]
    if not common:
        return False
    own = common[0].fit.chi2 - simpler.fit.chi2
    if simpler.fit.chi2 - longer.fit.chi2 < SECOND_SHARE * own:
        return False
    alone = min(shorter.values(), key=lambda r: r.fit.bic)
    left = _Remainder.of(problem, longer, alone, excess, floor)
    gain = left.criterion(problem, simpler.fit) - left.criterion(problem, longer.fit)
    return gain > CERTAIN_BIC


def _takes_the_rest(longer: Ranked, alone: Ranked) -> bool:
    """Return whether a set leaves next to nothing of the structure beside its best part."""
    most = longer.left.excess + SIGMAS * longer.left.deviation
    return most < _REST_LEFT * alone.left.excess


def _rest(ranked: Ranked) -> float:
    """Return the energy that a set leaves above the noise, in structure or in all values."""
    return max(ranked.left.excess, _beyond_noise(ranked.fit))


def takes_nearly_all(longer: Ranked, alone: Ranked) -> bool:
    """Return whether a set explains nine tenths of its best part's residual, beside chance.

    It must in the structure or in all values, where chance is small enough to show it, and leave
    clearly more in neither.
    """
    shown = False
    for first, rest, deviation in (
        (alone.left.excess, longer.left.excess, longer.left.deviation),
        (
            _beyond_noise(alone.fit),
            _beyond_noise(longer.fit),
            math.sqrt(2.0 * longer.fit.effective),
        ),
    ):
        most, chance = _NEARLY_NOTHING * first, SIGMAS * deviation
        if chance < 2.0 * most and rest - chance >= most:
            return False
        shown = shown or chance < 2.0 * most
    return shown


def _beyond_noise(fit: Fit) -> float:
    """Return the energy that a fit leaves in all values above that of the noise."""
    return fit.chi2 - fit.effective


@dataclass(frozen=True)
class _Remainder:
    """The remainder of a set: noise, and an unknown function that has no form of its laws.

    The unknown function makes every gain less certain (quasi-likelihood), but for that of a tone.
    `inside` and `outside` are variances per direction, within the `directions` of the flexible
    description and beyond it: 1 is that of the noise model, and `noise` the largest that its doubt
    allows.
    """

    directions: Matrix
    noise: float
    inside: float
    outside: float

    @classmethod
    def of(
        cls, problem: Problem, longer: Ranked, alone: Ranked, excess: float, floor: float
    ) -> _Remainder:
        """Return it with the level of the noise that its `doubt` allows.

        The encoder's errors (`floor`) are no unknown function. Within the description it is no
        smaller than a share of the `excess`, because no law is known better, and acts where the
        effect `alone` does.
        """
        left = longer.left
        noise = left.noise_per_direction * (1.0 + DOUBT_WEIGHT * left.doubt)
        per_direction = noise / left.noise_per_direction / max(left.rank, 1)
        unknown = max(left.excess - floor, 0.0) * per_direction
        inside = noise + max(unknown, SECOND_SHARE * excess * per_direction)
        added = [e for e in longer.fit.model.effects if e.name not in alone.fit.names]
        outside = noise if any(map(adds_tone, added)) else noise + unknown
        in_contact = all(effect.only_in_contact for effect in alone.fit.model.effects)
        flexible = problem.flexible_in_contact if in_contact else problem.flexible
        return cls(flexible.directions, noise, inside, outside)

    def without_unknown(self) -> _Remainder:
        """Return the remainder of noise alone."""
        return replace(self, inside=self.noise, outside=self.noise)

    def _weighed(self, rows: Matrix) -> Matrix:
        within: Matrix = (rows @ self.directions) @ self.directions.T
        found: Matrix = within / np.sqrt(self.inside) + (rows - within) / np.sqrt(self.outside)
        return found

    def criterion(self, problem: Problem, fit: Fit) -> float:
        """Return -2 log p of a fit with the form errors of its laws integrated out [chi-square].

        It contains Schwarz's penalty of the fit's parameters.
        """
        own, forms = tangent_space(problem, fit), _form_errors(problem, fit)
        forms -= (forms @ own) @ own.T
        weighed = self._weighed(np.vstack([forms, fit.residual]))
        rows, residual = weighed[:-1], weighed[-1]  # no rows where every amplitude is 0
        gram, along = np.inner(rows, rows), np.inner(rows, residual)
        gains = [0.0]
        for size in _FORM_SIZES:
            spread = np.eye(len(gram)) + size**2 * gram
            taken = size**2 * float(along @ np.linalg.solve(spread, along))
            gains.append(taken - float(np.linalg.slogdet(spread)[1]))
        return float(residual @ residual) - max(gains) + (fit.bic - fit.chi2)


def _form_errors(problem: Problem, fit: Fit) -> Matrix:
    """Return the form errors of all effects, whitened (rows x values of a whitened force).

    The rows of one effect share the energy of its force.
    """
    motion, found = problem.motion, []
    whole = force_of(fit.model, motion, fit.zeta, fit.theta)
    owners = [linear.owner for linear in fit.model.linear]
    for member in range(len(fit.model.effects)):
        model, zeta = without(fit, member)
        theta = fit.theta[[i for i, owner in enumerate(owners) if owner != member]]
        force = whole - force_of(model, motion, zeta, theta)
        rows = problem.whitener(np.array([force, *_other_forms(problem, force)]))
        sizes = np.linalg.norm(rows, axis=1)
        live = np.flatnonzero(sizes[1:] > 0.0) + 1
        share = sizes[0] / np.sqrt(max(live.size, 1))
        found.append(rows[live] * (share / sizes[live])[:, None])
    return np.concatenate(found)


def _other_forms(problem: Problem, force: Vector) -> list[Vector]:
    """Return a law's force [rig's force] times functions of position, speed and time, and delayed.

    A factor of 1 counts where the amplitude enters nonlinearly, as that of a backlash.
    """
    motion, used = problem.motion, problem.whitener.mask > 0.0
    t = np.linspace(-1.0, 1.0, force.size)
    low, high = float(np.min(motion.x[used])), float(np.max(motion.x[used]))
    fastest = float(np.max(np.abs(motion.v[used])))
    x = np.clip((2.0 * motion.x - low - high) / max(high - low, 1e-300), -1.0, 1.0)
    v = np.clip(motion.v / max(fastest, 1e-300), -1.0, 1.0)
    depth = np.abs(motion.x) / motion.scales["travel"]
    factors = [
        np.ones_like(x),
        x,
        x**2,
        v,
        np.abs(v),
        t,
        t**2,
        np.exp(-np.abs(v) / _NEAR),
        np.exp(-depth / _NEAR),
    ]
    longest = max(_LONGEST_MEMORY * force.size, _SHORTEST_MEMORY)
    kept = np.exp(-1.0 / np.geomspace(_SHORTEST_MEMORY, longest, _MEMORIES))
    delayed = [first_order(force, k, 1.0 - k, float(force[0])) - force for k in kept.tolist()]
    return [*(force * factor for factor in factors), *delayed]
