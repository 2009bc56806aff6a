"""The peers of diagnosis: the grades of their answers, and the one that is written here."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from teleop_rt.contact.effects import LIBRARY
from teleop_rt_dev.campaign import peers as campaign
from teleop_rt_dev.diagnosis import peers
from teleop_rt_dev.diagnosis.greedy_rival import described, sampled


@pytest.mark.parametrize(
    ("term", "keys", "sign"),
    [
        ("sign v/0.05", ["hysteresis"], "+"), ("x sign v", ["coulomb_friction"], "+"),
        ("x v", ["coulomb_friction"], "-"), ("x^2", ["nonlinear_stiffening"], "+"),
        ("maxwell 0.3 s", ["stress_relaxation"], "+"), ("drift", ["stress_relaxation"], "-"),
        (None, ["hysteresis"], "0"), ("x^2", None, ""),
    ],
)  # fmt: skip
def test_a_term_represents_effects(term: str | None, keys: list[str] | None, sign: str) -> None:
    assert campaign.mark(term, keys) == sign


def test_every_column_represents_existing_effects() -> None:
    t = np.arange(400) / 100.0
    x = np.sin(t) + 0.1 * np.sin(7.0 * t)
    motion = sampled(0.01, x, np.maximum(x, 0.0), np.ones(t.size), 20.0)
    names = {name for base in ("kelvin-voigt", "mass") for name in described(motion, base).columns}
    assert all(campaign.mark(name, ["none"]) == "-" for name in names)
    known = {effect.name for effect in LIBRARY}
    assert set().union(*campaign.STANDS_FOR.values()) <= known


def test_a_peer_is_scored_on_data_outside_its_fit() -> None:
    def mean(theta: Any, force: Any) -> Any:
        return np.array([np.mean(force)])

    force = np.array([1.0, 3.0, 10.0, 10.0])
    hidden = np.array([False, False, True, True])
    scored = peers.scored(mean, np.ones((4, 1)), force, hidden)
    assert scored["rms"] == pytest.approx(8.0)


def test_noise_of_the_columns_does_not_pull_coefficients_to_zero() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(8000) / 400.0
    clean = np.column_stack([np.sin(2.0 * t), np.cos(3.1 * t), np.sin(5.3 * t)])
    force = clean @ [1.0, 0.0, 0.4] + 0.05 * rng.standard_normal(t.size)
    theta = clean + 0.4 * rng.standard_normal(clean.shape)
    plain = np.linalg.lstsq(theta, force, rcond=None)[0]
    found = peers.errors_in_variables(theta, force)
    assert plain[0] < 0.8
    assert found == pytest.approx([1.0, 0.0, 0.4], abs=0.05)
    assert found[1] == 0.0


def test_diagnosis_is_scored_by_its_first_set() -> None:
    row = {"class": [["coulomb_friction", "outliers"], ["force_lag"]], "after": 0.1234,
           "keys": ["coulomb_friction"]}  # fmt: skip
    assert campaign.by_diagnosis(row) == "0.123 +"
    assert campaign.by_diagnosis({**row, "keys": ["force_lag"]}) == "0.123 -"
    assert campaign.by_diagnosis({**row, "class": []}) == "0.123 0"
    assert campaign.by_diagnosis({**row, "after": None}) == "-"
