"""The measured campaign: its rival, and the worth that it gives to an answer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"

from teleop_rt.contact.effects import LIBRARY  # noqa: E402 - as above
from teleop_rt.diagnosis.models.base import base_of  # noqa: E402 - as above
from teleop_rt_dev.campaign import measured as campaign  # noqa: E402 - beside the scripts
from teleop_rt_dev.diagnosis.greedy_rival import BLOCKS, FOLDS, Sampled, fitted, sampled  # noqa: E402 - as above

DATA = os.environ.get("TELEOP_RT_DATA", "")
# Figures of another engineer's script for the same recordings: base, greedy (5 Hz, no phase).
PUBLISHED = {
    "pneumatic/pn_Circle_3bar.csv": (0.102, 0.055),
    "pneumatic/pn_NAPN_3bar.csv": (0.096, 0.041),
    "pneumatic/pn_Stadium_1bar.csv": (0.110, 0.044),
    "pneumatic/pn_X-ring257_3bar.csv": (0.124, 0.088),
    "davinci_tools/dv_53_25_spindle.csv": (0.267, 0.058),
}


def rubbed(noise: float, seed: int = 2) -> Sampled:
    """Two sines against a spring with Coulomb friction, at 200 Hz over 20 s."""
    rng = np.random.default_rng(seed)
    t = np.arange(4000) / 200.0
    x = 0.01 * np.sin(2.0 * np.pi * 0.4 * t) + 0.004 * np.sin(2.0 * np.pi * 1.3 * t)
    force = 300.0 * x + 0.8 * np.sign(np.gradient(x, t)) + noise * rng.standard_normal(t.size)
    return sampled(1.0 / 200.0, x, force, np.ones(t.size), 20.0)


def test_the_rival_finds_friction_and_leaves_little_but_noise() -> None:
    found = fitted(rubbed(0.05), "spring,viscous,bias")
    noise = 0.05 / float(np.std(rubbed(0.05).force))
    assert found.terms[0].startswith(("sign", "dahl"))
    assert found.base_error > 8.0 * noise
    # None of its terms jumps as a sign does: a little more than the noise is left at reversals.
    assert 0.95 * noise < found.error < 1.3 * noise


def test_the_rivals_error_uses_blocks_without_its_fit() -> None:
    motion = rubbed(0.05)
    columns = np.array([motion.x, motion.v, np.ones(motion.x.size)])
    fold = (np.arange(motion.x.size) * BLOCKS // motion.x.size) % FOLDS
    left = np.empty(motion.x.size)
    for number in range(FOLDS):
        hidden = fold == number
        c = np.linalg.lstsq(columns[:, ~hidden].T, motion.force[~hidden], rcond=None)[0]
        left[hidden] = motion.force[hidden] - c @ columns[:, hidden]
    error = float(np.sqrt(np.mean(left**2)) / np.std(motion.force))
    assert fitted(motion, "spring,viscous,bias").base_error == pytest.approx(error, rel=1e-6)


def test_the_rival_finds_where_a_body_begins() -> None:
    t = np.arange(4000) / 200.0
    x = 0.01 * np.sin(2.0 * np.pi * 0.4 * t) + 0.004 * np.sin(2.0 * np.pi * 1.3 * t)
    depth = np.maximum(x - 0.002, 0.0)
    force = 2000.0 * depth + 0.02 * np.random.default_rng(1).standard_normal(t.size)
    found = fitted(sampled(0.005, x, force, np.ones(t.size), 20.0), "kelvin-voigt")
    assert found.error < 0.03


@pytest.mark.skipif(not DATA, reason="TELEOP_RT_DATA is not set: no measured data")
@pytest.mark.parametrize("name", PUBLISHED)
def test_the_rival_agrees_with_another_engineers_figures(name: str) -> None:
    t, x, force = np.loadtxt(Path(DATA) / name, delimiter=",", skiprows=1).T
    t = (t - t[0]) * (1e-3 if name.startswith("pneumatic") else 1.0)
    dt = float(np.median(np.diff(t)))
    grid = np.arange(0.0, t[-1], dt)
    x, force = np.interp(grid, t, x), np.interp(grid, t, force)
    motion = sampled(dt, x, force, np.ones(grid.size), 5.0)
    found = fitted(motion, "spring,viscous,bias")
    base, greedy = PUBLISHED[name]
    assert found.base_error == pytest.approx(base, rel=0.02)
    assert found.error == pytest.approx(greedy, rel=0.1)


def answer(verdict: str, *sets: str, before: float | None = 0.4, after: float | None = 0.1) -> Any:
    names = [one.split("+") for one in sets]
    effects = [{"name": name} for name in names[0]] if names else []
    sets = names if verdict in {"named", "class"} else []
    return {"verdict": verdict, "class": sets, "effects": effects, "before": before, "after": after}


@pytest.mark.parametrize(
    ("given", "halved", "worth"),
    [
        (answer("named", "friction"), True, "right"),
        (answer("partial", "friction"), True, "right"),
        (answer("named", "friction+lag"), True, "right"),
        (answer("class", "friction", "drift"), True, "right"),
        (answer("class", "friction", "drift", "bias", "ripple"), True, "useless"),
        (answer("class", "drift", "friction"), True, "useless"),
        (answer("named", "friction", after=0.37), True, "useless"),
        (answer("named", "friction", after=None), True, "useless"),
        (answer("named", "friction+drift"), True, "wrong"),
        (answer("class", "drift", "ripple"), True, "wrong"),
        (answer("partial", "drift"), False, "wrong"),
        (answer("partial"), True, "useless"),
        (answer("partial", "outliers"), False, "honest"),
        (answer("named", "friction+outliers"), True, "right"),
        (answer("unexplained"), True, "useless"),
        (answer("unexplained"), False, "honest"),
        (answer("no_missing_effect"), True, "useless"),
        (answer("refused", before=None, after=None), False, "honest"),
    ],
)
def test_the_worth_of_an_answer_follows_the_definition(
    given: Any, halved: bool, worth: str
) -> None:
    assert campaign.worth(given, ["friction", "lag"], halved) == worth
    assert campaign.worth(given, None, halved) == "unkeyed"


def test_every_key_is_an_effect_and_every_base_can_be_fitted() -> None:
    names = {effect.name for effect in LIBRARY}
    entries = campaign.keyed()
    assert len({entry["name"] for entry in entries}) == len(entries)
    for entry in entries:
        assert set(entry["keys"] or ()) <= names, entry["name"]
        base_of(entry["base"])
        assert entry["cutoff_hz"] > 0.0


def test_the_product_does_not_read_the_keys() -> None:
    package = SCRIPTS.parent / "teleop_rt"
    for path in package.rglob("*.py"):
        assert campaign.KEYS.stem not in path.read_text(encoding="utf-8"), path
    assert package not in campaign.KEYS.parents
