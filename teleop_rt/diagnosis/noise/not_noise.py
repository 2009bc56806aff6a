"""Residuals that have the spectrum of noise, but not its other properties.

A spectrum does not see phases. A force that depends on the place alone, a chatter that comes with
slow motion, a contact that is loose now and then, or a body that kicks passes for noise of that
colour. Noise does not repeat where the tool passes again, does not follow the motion, does not wait
for a speed, a place or a moment, and is about Gaussian.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.least_squares import explained
from teleop_rt.diagnosis.noise.encoder import converter_errors, force_errors
from teleop_rt.diagnosis.samples.motion import RecordedMotion

_PLACES = 400  # along the travel, at which the residual is compared with its own other half
_FEWEST_PLACES = 30  # passed in both halves; of fewer a correlation says little
_REPEATED = 0.7  # correlation of both halves: half of the variance repeats
_GROUPS = 6  # of samples, in the order of a quantity
_LEVEL_RATIO = 3.0  # of deviations between groups, beyond that of noise; sensors' grow by less
_CAUSES = (
    ("speed", "chatter, stick-slip or vibration of the drive"),
    ("position", "a stiffness that pulsates, or a track that shakes"),
    ("time since the last turn", "a play, a gear or a friction that each turn shakes"),
)
"""The quantities in whose order the level of a residual is compared, and causes of its change."""
_TURNED_SPEED = 0.05  # of the recording's; a reading's noise turns slower motion many times
_SKEWED, _SKEW_RATIO = 0.5, 2.0  # at least, and over that of draws; a row of pulses has 1 to 2
_PULSE_SIGMAS = 3.0  # of a residual, at which its values are cut: some rare samples are no row
_STROKES = 4  # of a window in which a residual may follow the motion: two cycles
_FEWEST_WINDOWS = 4  # of fewer, noise of a narrow band follows by chance
_FOLLOWING, _FOLLOWING_RATIO = 0.5, 4.0  # share of a window's power; odds over those of draws
_WINDOWS = 24  # of a recording, in each of which kurtosis is taken: two levels have 1, a tone 1.5
_BURST_S, _FEWEST_OF_WINDOW = 0.1, 8  # s and samples of a window whose power is taken
_BURST_RATIO = 1.5  # of mean to median power, over that of draws, at which bursts hold a third
_FLAT_RATIO = 0.8  # of kurtosis, over that of draws; of 180 noises none has less than 0.9
_NORMAL_KURTOSIS = 3.0  # draws with the spikes of encoder errors at turns have more
_BOTH_SIDES = np.array([-1.0, 1.0])
_LAGS = (1, 2, 4, 8, 16, 32, 64, 128)  # samples, over which changes are taken
_JUMPS_RATIO = 1.5  # the same of changes; of 180 noises none has 1.2
_JUMP_PARTS = 6  # of a recording, most of which show jumps
_LEAST_COLOURED = 0.1  # of the power of noise; less beside white noise is chance


class Signature(NamedTuple):
    """The properties that distinguish a residual from noise of its spectrum.

    `repeats` is the correlation of its halves by place, `levels` the largest deviation of a group
    of samples over the smallest, by each of `_CAUSES`, `skew` how far it lies to one side,
    without its sign, `bursts` the mean power of short windows over their median, and `follows` the
    share that a few cycles of the motion explain.
    """

    repeats: float
    levels: Vector
    skew: float
    bursts: float
    follows: float


def not_noise(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> list[str]:
    """Return the properties of a residual that noise does not have, as sentences for the user.

    They are compared with those of draws: noise of the same spectrum, and the errors of encoder
    (`errors`, at least one) and converter through the fit.
    """
    used = problem.whitener.mask > 0.0
    whose = "the residual beside the named effects" if fit.names else "the base's residual"
    rows = np.vstack((problem.residual(fit), _draws(problem, fit, errors)))
    seen, *drawn = (_signature(row, problem.motion, used) for row in rows)
    repeats, levels, skew, bursts, follows = (
        np.array(values) for values in zip(*drawn, strict=True)
    )
    found = []
    if seen.repeats > max(_REPEATED, float(np.max(repeats))):
        found.append(
            f"{whose} repeats with the position (correlation of both halves of the"
            f" recording {seen.repeats:.2f}): a force along the travel that no effect describes,"
            " such as a rough track, a friction at one place or a drive's own; record its map, or"
            " draft a law for --effects"
        )
    for ratio, most, cause in zip(seen.levels, np.max(levels, axis=0), _CAUSES, strict=True):
        if ratio > _LEVEL_RATIO * most:
            found.append(
                f"{whose} looks like noise, but its level changes with the {cause[0]},"
                f" by a factor of {ratio:.2g}: {cause[1]}, no sensor"
            )
    if seen.skew > max(_SKEWED, _SKEW_RATIO * float(np.max(skew))):
        found.append(
            f"{whose} has the spectrum of noise, but lies to one side: pulses of force"
            " at some moments, such as a muscle's, a valve's or a knock; the figure of the residual"
            " shows when"
        )
    if seen.bursts > _BURST_RATIO * float(np.max(bursts)):
        found.append(
            f"{whose} has the spectrum of noise, but comes in bursts (the mean power of"
            f" {_BURST_S:g} s is {seen.bursts:.2g} times the median): a frame that rings after a"
            " touch, a channel that stands still, or knocks; the figure of the residual shows when"
        )
    if seen.follows > _FOLLOWING and _odds(seen.follows) > _FOLLOWING_RATIO * _odds(max(follows)):
        found.append(
            f"{whose} has the spectrum of noise, but follows the motion for some cycles"
            f" ({seen.follows:.0%} of it is proportional to position and velocity there): the body,"
            " or a gain, changes in time, or something swings with the motion"
        )
    return found + _beside_white_noise(problem, rows, whose)


def _beside_white_noise(problem: Problem, rows: Matrix, whose: str) -> list[str]:
    """Return the properties, not those of noise, of a residual's part beside the sensor's noise.

    `rows` are the residual, which is `whose`, and the draws. White noise, which most sensors have,
    would hide them.
    """
    used = problem.whitener.mask > 0.0
    coloured, share = problem.whitener.coloured(rows)
    rows = coloured if share > _LEAST_COLOURED else rows
    flatness, *flat = (_flatness(row[used]) for row in rows)
    jumps = np.array([_jumps(row, used) for row in rows])
    found = []
    if flatness < _FLAT_RATIO * min(*flat, _NORMAL_KURTOSIS):
        found.append(
            f"{whose} looks like noise, but has an even amplitude: it jumps between two"
            " levels (check plugs and wires of the force sensor, and its mount for play), or is a"
            " tone whose frequency changes, as of a motor that runs up"
        )
    elif np.any(jumps[0] > _JUMPS_RATIO * np.max(jumps[1:], axis=0)):
        found.append(
            f"{whose} has the spectrum of noise, but jumps: a loose plug or wire, or a"
            " part that sticks and slips; the figure of the residual shows when"
        )
    return found


def _draws(problem: Problem, fit: Fit, errors: list[RecordedMotion]) -> Vector:
    """Return residuals (draws, samples) as noise, encoder and converter alone leave them."""
    rows = problem.whitener.unknown_noise(len(errors))
    rows += force_errors(problem, fit, errors)
    return np.asarray(rows + converter_errors(problem, fit, len(errors)))


def _signature(row: Vector, motion: RecordedMotion, used: NDArray[np.bool_]) -> Signature:
    rest = row[used] - np.mean(row[used])
    power = max(float(np.mean(rest**2)), 1e-300)
    ranked = (np.abs(motion.v[used]), motion.x[used], _since_turn(motion)[used])
    orders = [np.argsort(values, kind="stable") for values in ranked]
    return Signature(
        _repeats(rest, motion.x[used], motion.v[used]),
        np.array([_level_ratio(rest[order]) for order in orders]),
        _skew(rest, _PULSE_SIGMAS * float(np.sqrt(power))),
        _bursts(row - np.mean(row[used]), used, motion.dt),
        _follows(rest, motion.x[used], motion.v[used]),
    )


def _since_turn(motion: RecordedMotion) -> Vector:
    """Return the number of samples since the motion last turned, or since the beginning."""
    sides = np.where(
        np.abs(motion.v) > _TURNED_SPEED * motion.scales["speed"], np.sign(motion.v), 0.0
    )
    places = np.arange(sides.size)
    moving = np.maximum.accumulate(np.where(sides != 0.0, places, 0))
    turned = np.diff(sides[moving], prepend=sides[0]) != 0.0
    return np.asarray(places - np.maximum.accumulate(np.where(turned, places, 0)), dtype=np.float64)


def _skew(rest: Vector, most: float) -> float:
    row = np.clip(rest, -most, most)
    row -= np.mean(row)
    power = max(float(np.mean(row**2)), 1e-300)
    return abs(float(np.mean(row**3))) / math.pow(power, 1.5)


def _flatness(rest: Vector) -> float:
    """Return the median kurtosis of windows, which a slow change of the level leaves as it is."""
    return float(np.median([_kurtosis(window) for window in np.array_split(rest, _WINDOWS)]))


def _jumps(row: Vector, used: NDArray[np.bool_]) -> Vector:
    """Return the kurtosis of the changes over each of `_LAGS`, large where few values change.

    It is the median over parts of the recording, and large changes are cut: some rare ones, as
    where a heavy tool is struck, do not count.
    """
    found = []
    for lag in _LAGS:
        changes = (row[lag:] - row[:-lag])[used[lag:] & used[:-lag]]
        parts = (part for part in np.array_split(changes, _JUMP_PARTS) if np.any(part))
        cut = [np.clip(part, *_PULSE_SIGMAS * np.std(part) * _BOTH_SIDES) for part in parts]
        found.append(float(np.median([_kurtosis(part) for part in cut])) if cut else 0.0)
    return np.array(found)


def _kurtosis(row: Vector) -> float:
    rest = row - np.mean(row)
    return float(np.mean(rest**4)) / max(float(np.mean(rest**2)) ** 2, 1e-300)


def _bursts(row: Vector, used: NDArray[np.bool_], dt: float) -> float:
    """Return the mean power of short windows over their median; those half in use count."""
    length = max(_FEWEST_OF_WINDOW, round(_BURST_S / dt))
    whole = row.size // length * length
    power = (np.where(used, row, 0.0)[:whole] ** 2).reshape(-1, length).sum(axis=1)
    counts = used[:whole].reshape(-1, length).sum(axis=1)
    half = counts >= length / 2
    if not np.any(half):
        return 1.0
    mean_power = power[half] / counts[half]
    return float(np.mean(mean_power)) / max(float(np.median(mean_power)), 1e-300)


def _repeats(rest: Vector, x: Vector, v: Vector) -> float:
    """Return the correlation, over the places, of the means of the first and the second half.

    The passes in both directions count together or apart, whichever correlates more: a friction at
    one place changes its sign with them.
    """
    place = np.digitize(x, np.linspace(np.min(x), np.max(x), _PLACES + 1)[1:-1])
    return max(_halves_alike(rest, one) for one in (place, place + _PLACES * (v > 0.0)))


def _halves_alike(rest: Vector, place: NDArray[np.int64]) -> float:
    halves = np.array_split(np.arange(rest.size), 2)
    size = 2 * _PLACES
    sums = np.array([np.bincount(place[half], rest[half], size) for half in halves])
    counts = np.array([np.bincount(place[half], minlength=size) for half in halves])
    both = np.all(counts > 0, axis=0)
    if np.count_nonzero(both) < _FEWEST_PLACES:
        return 0.0
    means = sums[:, both] / counts[:, both]
    means -= np.mean(means, axis=1, keepdims=True)
    first, second = means
    scale = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(first @ second) / max(scale, 1e-300)


def _level_ratio(rest: Vector) -> float:
    """Return the largest deviation of a group of successive samples over the smallest."""
    levels = [float(np.sqrt(np.mean(group**2))) for group in np.array_split(rest, _GROUPS)]
    return max(levels) / max(min(levels), 1e-300)


def _follows(rest: Vector, x: Vector, v: Vector) -> float:
    """Return the median share of the power in a few cycles that position and velocity explain.

    Their coefficients are those of these cycles alone. 0 for a motion of too few cycles.
    """
    turns = 1 + np.flatnonzero(np.diff(np.sign(x - np.median(x))))[::_STROKES]
    if turns.size <= _FEWEST_WINDOWS:
        return 0.0
    shares = []
    for cut in map(slice, turns[:-1], turns[1:]):
        row = rest[cut] - np.mean(rest[cut])
        left = row @ row - explained(np.array([np.ones(row.size), x[cut], v[cut]]), row)
        shares.append(1.0 - left / max(float(row @ row), 1e-300))
    return float(np.median(shares))


def _odds(share: float) -> float:
    return share / max(1.0 - share, 1e-300)
