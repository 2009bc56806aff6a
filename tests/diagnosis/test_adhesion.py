"""Adhesion by a neck, whose pull rises from nothing as it is stretched, and then breaks."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

DT, REACH_M, PULL_N, NOISE_N = 2e-3, 6e-4, 1.2, 0.02


def pulled(shape: str) -> dict[str, object]:
    """Diagnose taps on a body that holds the tool by a neck as it withdraws."""
    t = np.arange(0.0, 10.0, DT)
    x = 3e-3 * np.sin(2 * np.pi * 0.6 * t - 1.0) + 6e-4 * np.sin(2 * np.pi * 2.3 * t)
    force = np.where(x > 0.0, 1500.0 * x + 10.0 * np.gradient(x, DT), 0.0)
    held, stretch = False, np.zeros(t.size)
    for i, depth in enumerate(x.tolist()):
        held = depth > 0.0 or (held and depth > -REACH_M)
        stretch[i] = -depth / REACH_M if held and depth < 0.0 else 0.0
    force -= PULL_N * neck(stretch, shape)
    force += NOISE_N * np.random.default_rng(4).standard_normal(t.size)
    return diagnose(from_arrays("neck", t, x, force), surface=0.0).answer


def neck(stretch: NDArray[np.float64], shape: str) -> NDArray[np.float64]:
    """Return the pull of a spring that snaps, or of a liquid bridge that thins out."""
    return stretch if shape == "snaps" else np.sin(np.pi * stretch)


@pytest.mark.parametrize(("shape", "most"), [("snaps", 2.0), ("thins", 1.2)])
def test_a_neck_that_is_stretched_and_breaks_is_adhesion_and_nothing_else(
    shape: str, most: float
) -> None:
    """A fold that breaks the neck a sample late errs by the whole pull there, where it snaps."""
    answer = pulled(shape)
    assert answer["class"] == [["adhesion"]]
    assert answer["error"]["after_over_floor"] < most
    error = answer["error"]["std_normalised"]
    assert error["after"] < 0.3 * error["before"]  # it pulls in free air alone
