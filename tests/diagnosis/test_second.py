"""A second effect is named where no other form of the first one's law could make what it shows."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.foreign_plants import foreign
from teleop_rt_dev.diagnosis.motions import rich
from teleop_rt_dev.diagnosis.plants import make

Array = NDArray[np.float64]
EVERY = 10


def stiffening(seed: int) -> tuple[Array, Array, Array]:
    """Return time, penetration, and the force of a body that densifies: not a power of depth."""
    rng = np.random.default_rng(seed)
    x = rich(rng, 5e-3)[::EVERY]
    t = np.arange(x.size) * 1e-3
    depth = np.maximum(x, 0.0)
    force = 2500.0 * depth / (1.0 - depth / 0.012) + np.where(x > 0.0, 8.0 * np.gradient(x, t), 0.0)
    return t, x, force + 0.02 * rng.standard_normal(t.size)


def best(t: Array, x: Array, force: Array) -> set[str]:
    found = diagnose(from_arrays("two", t, x, force), surface=0.0).answer["class"]
    return set(found[0]) if found else set()


@pytest.mark.parametrize("seed", [1, 2])
def test_hum_beside_a_much_larger_effect_is_named(seed: int) -> None:
    t, x, force = stiffening(seed)
    hum = 0.03 * np.sin(2.0 * np.pi * 50.0 * t + 1.0)
    assert best(t, x, force + hum) == {"nonlinear_stiffening", "periodic_disturbance"}


@pytest.mark.parametrize("seed", [1, 2])
def test_a_bias_that_free_air_shows_is_named_beside_a_much_larger_effect(seed: int) -> None:
    t, x, force = stiffening(seed)
    assert best(t, x, force + 0.05) == {"nonlinear_stiffening", "force_bias"}


@pytest.mark.parametrize("seed", [1, 2])
def test_the_residual_of_another_form_of_the_law_is_no_second_effect(seed: int) -> None:
    assert best(*stiffening(seed)) == {"nonlinear_stiffening"}


def test_a_second_effect_is_searched_with_each_of_its_laws() -> None:
    """Beside a delay that is not yet where it belongs, another law of adhesion showed more."""
    record = make(1341903219, ("adhesion", "channel_delay"), "foam", size=0.108, noise=0.0034)
    assert best(record.t, record.position, record.force) == {"adhesion", "channel_delay"}


def test_backlash_under_a_mass_is_named() -> None:
    """Its impacts last less than a sample, and drowned the rest of the recording."""
    record = foreign(1088047660, ("backlash",))
    recording = from_arrays("play", record.t, record.position, record.force)
    assert diagnose(recording, record.base).answer["class"] == [["backlash"]]
