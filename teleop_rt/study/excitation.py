"""Which models one sinusoid excites, with and without an offset or an unknown force bias."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.estimation.bank import Bank
from teleop_rt.study.chapter4_plant import PenetrationMotion, Sine

Matrix = NDArray[np.float64]
MODELS = ("kelvin-voigt", "mass-spring-damper", "hunt-crossley")
EXCITED = 1e8
"""Beyond this condition number of the scaled normal matrix a model is not excited."""


def cases(
    means_m: Sequence[float] = (0.0, 0.005, 0.012),
    amplitudes_m: Sequence[float] = (0.001, 0.004, 0.008),
    frequencies_hz: Sequence[float] = (0.5, 3.0, 10.0),
    duration_s: float = 4.0,
) -> list[dict[str, Any]]:
    """Return every case; Hunt-Crossley has no logarithm where the motion leaves the material."""
    return [
        {"model": model, "mean_m": mean, "amplitude_m": amplitude, "frequency_hz": frequency,
         "bias": bias, "duration_s": duration_s}
        for model, mean, amplitude, frequency, bias in itertools.product(
            MODELS, means_m, amplitudes_m, frequencies_hz, (False, True)
        )
        if not (model == "hunt-crossley" and (bias or amplitude >= mean))
    ]  # fmt: skip


def evaluate(case: dict[str, Any]) -> dict[str, Any]:
    """Return the condition number of a case's scaled normal matrix; null where infinite.

    It is the bank's own, of a row that saw the whole motion, each regressor scaled to a mean
    square of one; `excited` is true if the bank's integral criterion would use it.
    """
    motion = Sine(
        case["frequency_hz"], case["mean_m"], case["amplitude_m"], case["duration_s"]
    ).samples()
    phi = regressors(case["model"], motion, bias=case["bias"])
    phi /= np.sqrt(np.mean(phi**2, axis=0))
    bank = Bank(["iec"], [phi.shape[1]])
    bank.run(phi[:, None, :], np.sum(phi, axis=1)[:, None])
    condition = bank.condition(0)
    return case | {
        "condition": condition,
        "excited": condition is not None and condition < EXCITED,
    }


def regressors(model: str, motion: PenetrationMotion, *, bias: bool) -> Matrix:
    """Return phi (samples, n) of (2.1), (2.3) or (2.6), a column of ones for a force bias last."""
    ones = np.ones_like(motion.x)
    if model == "hunt-crossley":
        columns = [ones, motion.v, np.log(motion.x / 5e-3)]
    else:
        columns = [motion.x, motion.v]
    if model == "mass-spring-damper":
        columns.append(motion.a)
    return np.column_stack([*columns, ones] if bias else columns)
