"""Layout of a row of the bank: columns of its settings and of its packed state.

One row of state is one vector, so that a kernel walks over memory it owns. n <= MAX_PARAMETERS
parameters are in use, the first of each vector and the upper left of each matrix.
"""

from __future__ import annotations

MAX_PARAMETERS = 8
"""Room for the parameters of a row: a model's own, its effects' and a free offset."""

Whole = int | None
"""WHOLE compiles all that a bank can do, None only direct regressions by plain `rls`.

Kernels test it against None, which numba decides before it compiles: an omitted part costs no
compile time, and most trials need none of it.
"""
WHOLE = 1  # any number: its type alone counts

RLS, SPRLS, NI_SPRLS, GN_VFF_RLS, IEC = range(5)
WARMING_UP, ESTIMATED, HELD, RESTARTED = range(4)
STATUS_NAMES = ("warming up", "estimated", "held", "restarted")

# Columns of a row's settings.
(
    SOLVER,
    FORGETTING,
    PRIOR,
    CEILING,
    BETA,
    GAMMA,
    NOISE_VARIANCE,
    RHO,
    ALPHA,
    LAMBDA_MIN,
    LAMBDA_MAX,
    DELTA_START,
    BLOCK,
    WARM_UP,
    ONE_SIDED,
    INTERCEPT,
    SHIFTED,
    VARIANCE_AT,
    N_SETTINGS,
) = range(19)
NO_INTERCEPT = -1
"""Column INTERCEPT is the place of a constant's regressor, SHIFTED that of one whose origin is
arbitrary, so that the constant takes it up."""
UNKNOWN_VARIANCE = -1
"""Column VARIANCE_AT is where a row's state holds theta's covariance per unit of noise."""
LEAST_SCORE_BLOCKS = 16
"""Blocks of scores before their spread is believed."""

# Scalars at the head of a row's state.
(
    LAMBDA,
    DELTA,
    MEAN_SQUARE,
    COUNT,
    RESTARTS,
    STATUS,
    ERROR,
    READY,
    BLOCK_COUNT,
    BLOCKS,
    REJECTED,
    GRADIENT_RESTARTS,
    SINCE_RESTART,
    CROSSED,
    N_SCALARS,
) = range(15)

# Vectors of MAX_PARAMETERS: estimate, its gradient by lambda (or the right-hand side of `iec`),
# gain, scratch, sums of scores and of squared regressors in a block, their powers over blocks, the
# mean square of each regressor, and the sensitivity d theta / d u to an error u in y that stays the
# same, lever times u at each sample (for `iec` the sum that makes it).
THETA = 16
PSI, GAIN, SCRATCH, SCORE, INFO, SCORE_POWER, INFO_POWER, EXCITATION, SENSITIVITY = (
    THETA + MAX_PARAMETERS * i for i in range(1, 10)
)
# Matrices of MAX_PARAMETERS x MAX_PARAMETERS: P (normal matrix for `iec`), M = dP/d lambda (inverse
# for `iec`), and C, the covariance of theta per unit of noise variance, propagated through the gain
# in use.
COVARIANCE = SENSITIVITY + MAX_PARAMETERS
GRADIENT = COVARIANCE + MAX_PARAMETERS * MAX_PARAMETERS
PROPAGATED = GRADIENT + MAX_PARAMETERS * MAX_PARAMETERS
ROW_SIZE = PROPAGATED + MAX_PARAMETERS * MAX_PARAMETERS
