"""Detectable sizes: the smallest size of each effect that a recording would have shown.

An effect of amplitude A changes the whitened force by A c, of which A c_perp lies beyond the part
base's own parameters can make. Its gain in chi-square is then (A |c_perp| + z)^2, z being the noise
along c_perp, and it is detected where that passes the threshold of a certain effect. The stated
size is the one at which this happens in 95 of 100 recordings, at the shape that shows least: its
power (Fisher information of the amplitude after projection, Kay 1998, ch. 6), not its threshold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from teleop_rt.config.parameter_words import reached_by
from teleop_rt.contact.effect import Effect, Matrix, Shape, Vector
from teleop_rt.diagnosis.answers.answer import deepest, fill
from teleop_rt.diagnosis.criteria import (
    CERTAIN_BIC,
    DOUBT_WEIGHT,
    ENCODER_ENERGY_RATIO,
    HIDDEN_SHARE,
)
from teleop_rt.diagnosis.models.axes import grid
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import bounds, nonlinear_amplitude, phases
from teleop_rt.diagnosis.models.predict import force_of
from teleop_rt.diagnosis.noise.encoder import force_of_a_step
from teleop_rt.diagnosis.noise.structure import lack_of_fit, tangent_space

POWER_SIGMAS = 1.645  # one-sided 95 % of a normal distribution
_SHAPES = 4  # values tried of each shape parameter, over its bounds
_HIGHEST_TONE = 0.4  # of the rate of samples [1]; at half of it every sample of a sine may be 0
_SMALL = 1e-4  # of its upper bound: the amplitude at which a force is linearised first
_ROUNDS, _NEAR = 6, 0.7  # of linearising at the size found; until it is that near to the last one
_UNSEEN = 1e-9  # of a column's length; a smaller part outside the base is a rounding error


def detectable(
    problem: Problem,
    base: Fit,
    floor: Matrix,
    effects: Sequence[Effect],
    units: tuple[str, str],
    step: float = 0.0,
    form_error: float = 0.0,
) -> list[dict[str, Any]]:
    """Return per effect, by its first law, the size that is detected with probability 0.95.

    `base` is the base, with the effects that are named beside it.

    `floor` are whitened force errors of the encoder (draws x values), `step` is its step [rig
    unit], within which the surface is free. `form_error` is the energy that the forms of the named
    laws may miss [chi-square]: a second effect must gain more, and any effect more than the
    noise hides. `size` is None where no size within the effect's bounds would. Effects whose size
    is no amplitude (lags, limits) are left out.
    """
    own = tangent_space(problem, base)
    shift = force_of_a_step(problem, base, step, own)
    left = lack_of_fit(problem, base, own)
    doubted = left.noise_per_direction * (1.0 + DOUBT_WEIGHT * left.doubt)
    hidden = HIDDEN_SHARE * problem.whitener.samples
    depth = deepest(problem, base)
    found = []
    for effect in {one.name: one for one in reversed(effects)}.values():
        if effect.acts != "adds_force" and not nonlinear_amplitude(effect):
            continue
        parameters = 1 + len(effect.shapes)
        odds = CERTAIN_BIC + parameters * float(np.log(problem.whitener.effective))
        least = max(doubted * odds, form_error, hidden)
        size_of = partial(
            _size, own=own, shift=shift, floor=floor, least=least, chance=left.noise_per_direction
        )
        sizes = list(_sizes(problem, base, effect, size_of))
        size, eta = max(sizes, key=lambda one: one[0], default=(np.inf, np.zeros(0)))
        most = np.inf
        if nonlinear_amplitude(effect):
            most = max(map(abs, bounds(effect.amplitude, problem.motion.scales)))
        free = [shape for shape in effect.shapes if not (shape.phase and phases(effect))]
        unit = fill(effect.amplitude.unit, units)
        shape = {s.name: float(v) for s, v in zip(free, eta, strict=False)}
        seen = float(size) if size < most else None
        reached = {} if seen is None else reached_by(unit, seen, shape, depth)
        found.append({"name": effect.name, "parameter": effect.amplitude.name, "size": seen,
                      "unit": unit, "shape": shape, **reached})  # fmt: skip
    return sorted(found, key=lambda one: str(one["name"]))


def _size(
    columns: Matrix, *, own: Matrix, shift: Vector, floor: Matrix, least: float, chance: float
) -> float:
    """Return the amplitude at which whitened columns (1 or 2 x values) are detected at 0.95.

    For two columns (the phases of one effect), the direction that is harder to detect counts. The
    part that a `shift` of the surface by up to one step explains is not detected.
    """
    beyond = columns - (columns @ own) @ own.T
    _, lengths, directions = np.linalg.svd(beyond, full_matrices=False)
    if lengths[-1] <= _UNSEEN * float(np.linalg.norm(columns)):
        return float(np.inf)
    along = float(np.mean((floor @ directions[-1]) ** 2)) if floor.size else 0.0
    threshold = np.sqrt(max(least, ENCODER_ENERGY_RATIO * along))
    wanted = float(threshold + POWER_SIGMAS * np.sqrt(chance + along))
    left = _beside(abs(float(shift @ directions[-1])), float(shift @ shift), wanted)
    return left / float(lengths[-1])


def _beside(along: float, energy: float, wanted: float) -> float:
    """Return the length of which `wanted` is left when a shift has taken its part.

    The shift has this `energy`, and so much `along` the direction of the length.
    """
    if along == 0.0:
        return wanted
    free = wanted / np.sqrt(max(1.0 - along**2 / energy, 1e-12))
    if free * along <= energy:
        return float(free)
    return float(along + np.sqrt(max(along**2 - energy + wanted**2, 0.0)))


def _sizes(
    problem: Problem, base: Fit, effect: Effect, size_of: Callable[[Matrix], float]
) -> Iterator[tuple[float, Vector]]:
    """Yield the detectable size and the shape parameters, over their bounds.

    A force that is nonlinear in the amplitude is taken at the size itself: one that moves a contact
    makes jumps of single samples there, which a smaller amplitude would multiply.
    """
    scales = problem.motion.scales
    free = [shape for shape in effect.shapes if not (shape.phase and phases(effect))]
    values = [grid(_sampled(shape, problem.motion.dt), scales) for shape in free]
    most = max(map(abs, bounds(effect.amplitude, scales)))
    for place in product(*values):
        eta = np.array(place, dtype=np.float64)
        if effect.acts == "adds_force":
            yield size_of(problem.rows_of(effect, [eta])[0]), eta
            continue
        size = amplitude = _SMALL * most
        for _ in range(_ROUNDS):
            size = size_of(_row_of_unit(problem, base, effect, amplitude, eta))
            if size > most or _NEAR < size / amplitude < 1.0 / _NEAR:
                break
            amplitude = size
        yield size, eta


def _sampled(shape: Shape, dt: float) -> Shape:
    """Return the shape with few points; a frequency ends below half the rate of samples."""
    upper = min(shape.upper, _HIGHEST_TONE / dt) if shape.unit == "Hz" else shape.upper
    return replace(shape, upper=upper, points=min(max(shape.points, 2), _SHAPES))


def _row_of_unit(
    problem: Problem, base: Fit, effect: Effect, amplitude: float, eta: Vector
) -> Matrix:
    """Return the whitened force (1 x values) of an amplitude, over that amplitude."""
    model = replace(base.model, effects=(*base.model.effects, effect))
    zeta = np.concatenate([base.zeta, [amplitude], eta])
    with_it = force_of(model, problem.motion, zeta, base.theta)
    without = base.force_on(problem.motion)
    return problem.whitener(((with_it - without) / amplitude)[None, :])
