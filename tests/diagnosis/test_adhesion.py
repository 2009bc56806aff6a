"""Adhesion by a neck that is stretched and breaks, and on a soft sphere."""

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


def soft_sphere(depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the force [N] on a ball of 20 um by Johnson, Kendall and Roberts (1971).

    25 MPa of reduced modulus and 0.13 N/m of adhesion energy: it pulls off at 12 uN.
    """
    radius, modulus, energy = 2e-5, 2.5e7, 0.13
    contact = np.linspace(1e-8, 3e-5, 60_000)
    pulled = np.sqrt(2.0 * np.pi * energy * contact / modulus)
    depths = contact**2 / radius - pulled
    forces = 4.0 * modulus * contact**3 / (3.0 * radius)
    forces -= np.sqrt(8.0 * np.pi * energy * modulus * contact**3)
    stable = slice(int(np.argmin(depths)), None)
    force, held = np.interp(depth, depths[stable], forces[stable]), False
    for i, at in enumerate(depth.tolist()):
        held = at > 0.0 or (held and at > depths[stable][0])
        force[i] *= held
    return force


def test_a_soft_sphere_that_adheres_is_adhesion_with_its_pull_off_force() -> None:
    t = DT * np.arange(6000)
    depth = 2.2e-6 * np.sin(2 * np.pi * 0.31 * t - 1.2) + 1e-6 * np.sin(2 * np.pi * 0.83 * t)
    noise = 3e-7 * np.random.default_rng(6).standard_normal(t.size)
    recording = from_arrays("ball", t, depth, soft_sphere(depth) + noise)
    answer = diagnose(recording, "hunt-crossley", surface=0.0).answer
    assert answer["class"] == [["adhesion"]]
    found = answer["effects"][0]["parameters"]["pull_off_force"]["value"]
    assert abs(found / (1.5 * np.pi * 2e-5 * 0.13) - 1.0) < 0.05
    assert answer["error"]["after_over_floor"] < 1.1


@pytest.mark.parametrize("tail", ["a magnet's", "van der Waals'"])
def test_an_attraction_that_acts_before_the_touch_is_adhesion(tail: str) -> None:
    """It has no memory: it pulls as much on approach as on withdrawal, so no bridge fits it."""
    t = np.arange(0.0, 12.0, DT)
    x = 4e-3 * np.sin(2 * np.pi * 0.47 * t - 1.0) + 1.5e-3 * np.sin(2 * np.pi * 1.3 * t)
    gap = np.maximum(-x, 0.0)
    pull = np.exp(-gap / 1e-3) if tail == "a magnet's" else (1.0 + gap / 6e-4) ** -2
    v = np.gradient(x, DT)
    force = np.where(x > 0.0, 900.0 * x + np.where(v > 0.0, 12.0, 4.0) * v, 0.0) - 0.5 * pull
    force += NOISE_N * np.random.default_rng(11).standard_normal(t.size)
    answer = diagnose(from_arrays("magnet", t, x, force), "kelvin-voigt").answer
    (named,) = answer["class"]
    assert {*named} == {"direction_dependent_damping", "adhesion"}
    assert answer["error"]["after_over_floor"] < 1.05
    (adhesion,) = (e for e in answer["effects"] if e["name"] == "adhesion")
    assert adhesion["parameters"]["pull_off_force"]["value"] == pytest.approx(0.5, rel=0.05)
