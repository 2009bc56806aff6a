"""3.6 million x 12 least squares, against numpy.linalg.lstsq."""

from __future__ import annotations

import numpy as np

from teleop_rt.estimation.batch import least_squares
from teleop_rt_dev.bench.measure import Row, interleave, ratios, row, seconds

SAMPLES, PARAMETERS = 3_600_000, 12
ROUNDS = 5  # at most: lstsq takes seconds, and the bench is to stay under two minutes


def run(rounds: int) -> list[Row]:
    rng = np.random.default_rng(0)
    phi = rng.normal(size=(SAMPLES, PARAMETERS))
    # Correlated columns of unlike size, as positions, velocities and accelerations are.
    phi[:, 1:] += 0.8 * phi[:, :-1]
    phi *= np.logspace(-3, 3, PARAMETERS)
    theta = rng.normal(size=PARAMETERS)
    y = phi @ theta + rng.normal(size=SAMPLES)
    found, exact = least_squares(phi, y), np.linalg.lstsq(phi, y, rcond=None)[0]
    deviation = float(np.max(np.abs(found - exact) / np.abs(exact)))
    # lstsq takes seconds: fewer rounds than elsewhere keep this bench under two minutes.
    times = interleave(
        min(rounds, ROUNDS),
        [
            lambda: seconds(lambda: least_squares(phi, y)),
            lambda: seconds(lambda: np.linalg.lstsq(phi, y, rcond=None)),
        ],
    )
    return [
        row("least_squares, 3.6 million x 12", "s", [t[0] for t in times]),
        row("numpy.linalg.lstsq", "s", [t[1] for t in times]),
        row("lstsq / least_squares", "ratio", ratios(times, 1, 0), ">= 5"),
        row("largest deviation from lstsq", "relative", [deviation], "<= 1e-8"),
    ]
