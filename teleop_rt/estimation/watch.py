"""The residual watch: it detects structure in the force that the model does not explain.

The residual of the selected row is averaged over blocks, which makes the noise of its
filter white, and each mean is divided by its floor: the error that the force's noise, the encoder
and the surface can cause, and a small share of the force range that no hand would miss. Noise alone
then has power below one and no memory; a missing effect has both power and memory from block to
block.
"""

from __future__ import annotations

import math

from teleop_rt.contact.effect import Vector
from teleop_rt.kernels.jit import kernel

(
    SUM,
    COUNT,
    BEFORE,
    HAS_BEFORE,
    POWER,
    PRODUCT,
    BLOCKS,
    RAISED,
    FORCE_1,
    FORCE_2,
    FORCE_3,
    FORCES,
    FAST_POWER,
    WATCHED,
    N_WATCH,
) = range(15)

NOISE_SAMPLES, LARGEST_POWER = 300.0, 9.0
"""Memory of the noise in samples, and the most that one square may be of its fast mean."""
BLOCK_S = 0.02
"""Length of a block, whose mean is one value for the residual's memory."""
MEMORY_S = 1.0
"""Memory of the mean over blocks."""
LEAST_S = 0.6
"""Contact that must have been seen before anything is said."""
RANGE_SHARE = 0.005
"""A residual below this share of the force range is not worth an effect."""
RAISE_POWER, CLEAR_POWER = 4.0, 2.0
"""A residual of twice its floor raises the alarm; below 1.4 of it, it is taken back."""
MEMORY_SHARE = 0.3
"""Correlation from block to block that noise does not reach."""
LEAST_BLOCKS = 50
"""Blocks that show the memory of a residual, a second in contact."""
MOST_WHITE = 0.45
"""Correlation from block to block of a white residual: 3.5 deviations of a mean over a second."""
LEAST_DOUBT = 0.05
"""Power of a residual that makes deviations doubtful: about 0.1 % of the force range."""
COLOURED = 1.5
"""Factor of the residual's filter on the variance of a block mean of white noise."""


def has_memory(watch: Vector) -> bool:
    """Return whether the last second's residual is correlated from block to block, as no noise is.

    Deviations of the parameters assume a white residual, and are too small long before the alarm
    is raised.
    """
    seen = watch[BLOCKS] >= LEAST_BLOCKS and watch[POWER] > LEAST_DOUBT
    return bool(seen and watch[PRODUCT] > MOST_WHITE * watch[POWER])


@kernel
def listen(watch: Vector, force: float) -> None:
    """Take one sample of the raw force: its third differences show only the noise.

    Large ones, caused by a contact, are clipped.
    """
    if watch[FORCES] >= 3.0:
        third = force - 3.0 * watch[FORCE_1] + 3.0 * watch[FORCE_2] - watch[FORCE_3]
        power = third * third / 20.0
        if watch[FORCES] > NOISE_SAMPLES:
            power = min(power, LARGEST_POWER * watch[FAST_POWER])
        memory = max(1.0 / (watch[FORCES] - 2.0), 1.0 / NOISE_SAMPLES)
        watch[FAST_POWER] += memory * (power - watch[FAST_POWER])
    watch[FORCES] += 1.0
    watch[FORCE_3] = watch[FORCE_2]
    watch[FORCE_2] = watch[FORCE_1]
    watch[FORCE_1] = force


@kernel
def end_stretch(watch: Vector) -> None:
    """End a stretch of contact: a block does not reach over a gap."""
    watch[SUM] = watch[COUNT] = watch[HAS_BEFORE] = 0.0


@kernel
def turn_to(watch: Vector, row: int) -> None:
    """Watch this row from now on; the alarm stands until there is enough to judge it by."""
    if watch[WATCHED] != row:
        watch[WATCHED] = row
        watch[POWER] = watch[PRODUCT] = watch[BLOCKS] = 0.0
        end_stretch(watch)


@kernel
def judge_residual(
    watch: Vector, residual: float, noise: float, by_position: float, span: float, dt: float
) -> None:
    """Take in one residual; raise or take back the alarm at the end of a block.

    `noise` is the force's as configured, `by_position` that by errors of encoder and surface in
    the force, `span` the range of the force so far.
    """
    watch[SUM] += residual
    watch[COUNT] += 1.0
    length = max(4.0, BLOCK_S / dt)
    if watch[COUNT] < length:
        return
    mean = watch[SUM] / watch[COUNT]
    variance = COLOURED * max(noise * noise, watch[FAST_POWER]) / watch[COUNT]
    share = RANGE_SHARE * span
    mean /= math.sqrt(variance + by_position * by_position + share * share)
    watch[SUM] = watch[COUNT] = 0.0
    watch[BLOCKS] += 1.0
    memory = max(1.0 / watch[BLOCKS], BLOCK_S / MEMORY_S)
    watch[POWER] += memory * (mean * mean - watch[POWER])
    if watch[HAS_BEFORE] > 0.0:
        watch[PRODUCT] += memory * (mean * watch[BEFORE] - watch[PRODUCT])
    watch[BEFORE] = mean
    watch[HAS_BEFORE] = 1.0
    if watch[BLOCKS] * BLOCK_S < LEAST_S:
        return
    if watch[POWER] < CLEAR_POWER:
        watch[RAISED] = 0.0
    elif watch[POWER] > RAISE_POWER and watch[PRODUCT] > MEMORY_SHARE * watch[POWER]:
        watch[RAISED] = 1.0
