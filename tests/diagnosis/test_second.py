"""A second effect is named where no other form of the first one's law could make what it shows."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.second import both_needed
from teleop_rt.diagnosis.inference.verdict import Ranked
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.noise.structure import LackOfFit
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


def test_hum_beside_a_much_larger_effect_is_named() -> None:
    t, x, force = stiffening(1)
    hum = 0.03 * np.sin(2.0 * np.pi * 50.0 * t + 1.0)
    assert best(t, x, force + hum) == {"nonlinear_stiffening", "periodic_disturbance"}


def test_a_bias_that_free_air_shows_is_named_beside_a_much_larger_effect() -> None:
    t, x, force = stiffening(2)
    assert best(t, x, force + 0.05) == {"nonlinear_stiffening", "force_bias"}


def test_the_residual_of_another_form_of_the_law_is_no_second_effect() -> None:
    assert best(*stiffening(2)) == {"nonlinear_stiffening"}


def neck(seed: int) -> tuple[Array, Array, Array]:
    """Return time, penetration, and force of a body whose neck of glue grows in 20 ms of contact.

    No law of the library grows: its pull is there at once.
    """
    rng = np.random.default_rng(seed)
    x, step, grown = rich(rng, 5e-3), 1e-4, 0.0
    force = np.where(x > 0.0, 2500.0 * x + 50.0 * np.gradient(x, step), 0.0)
    for i, depth in enumerate(x.tolist()):
        if depth > 0.0:
            grown += (1.0 - grown) * step / 0.02
        elif depth < -2.22e-3:
            grown = 0.0
        force[i] -= 1.5 * grown * np.exp(min(depth, 0.0) / 3.7e-4)
    t, x, force = (step * np.arange(x.size))[::40], x[::40], force[::40]
    return t, x, force + 0.05 * rng.standard_normal(t.size)


def test_what_the_form_of_an_adhesion_misses_at_each_touch_is_no_second_layer() -> None:
    """A layer beside it takes seven tenths of that."""
    assert best(*neck(5)) == {"adhesion"}


def fitted(chi2: float, left: float, *names: str) -> Ranked:
    """Return a set with its chi-square and the energy of the structure that it leaves."""
    effects = tuple(next(e for e in LIBRARY if e.name == name) for name in names)
    model = CandidateModel(base_of("kelvin-voigt"), effects)
    zeta = np.zeros(len(model.coordinates))
    fit = Fit(model, zeta, np.zeros(0), np.array([np.sqrt(chi2)]), np.zeros((0, 1)), 6500.0)
    return Ranked(fit, 14_500.0 - chi2, 14_500.0 - chi2, LackOfFit(left, 70))


@pytest.mark.parametrize(
    ("left", "encoder", "needed"),
    [
        (20.0, 0.0, True),
        (590.0, 0.0, False),  # half of what the first leaves: another form of it does that as well
        (290.0, 0.0, False),
        (290.0, 280.0, True),  # what is left comes from the encoder
    ],
)
def test_a_pair_pays_for_the_structure_that_it_leaves(
    left: float, encoder: float, needed: bool
) -> None:
    first, second = fitted(7780.0, 1190.0, "hysteresis"), fitted(9000.0, 2500.0, "second_layer")
    pair = fitted(6600.0, left, "hysteresis", "second_layer")
    singles = {r.fit.names[0]: r for r in (first, second)}
    nothing = cast(Problem, None)  # asked for tones and free air alone
    assert both_needed(nothing, pair, singles, 9700.0, encoder) is needed


def test_a_second_effect_is_searched_with_each_of_its_laws() -> None:
    """Beside a delay that is not yet where it belongs, another law of adhesion showed more."""
    record = make(1341903219, ("adhesion", "channel_delay"), "foam", size=0.108, noise=0.0034)
    assert best(record.t, record.position, record.force) == {"adhesion", "channel_delay"}


def test_backlash_under_a_mass_is_named() -> None:
    """Its impacts last less than a sample, and drowned the rest of the recording."""
    record = foreign(1088047660, ("backlash",))
    recording = from_arrays("play", record.t, record.position, record.force)
    assert diagnose(recording, record.base).answer["class"] == [["backlash"]]
