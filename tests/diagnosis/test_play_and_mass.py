"""A play beyond the tool's mass: the mass follows the encoder, and the tip lags behind both."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.contact.effects.joints import BEYOND_THE_MASS
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.applicable import applicable
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, GAP_M, MASS_KG = 2e-3, 1.2e-4, 3.7


def recorded(seed: int) -> Recording:
    """Return 12 s of presses on a spring of 6.7 kN/m from free air, through a play of 0.12 mm."""
    rng = np.random.default_rng(seed)
    t = DT_S * np.arange(6000)
    x, v, a = np.full(t.size, 5e-4), np.zeros(t.size), np.zeros(t.size)
    for frequency_hz, size_m in ((0.37, 2e-3), (1.1, 7e-4), (2.9, 2e-4)):
        w, phase = 2.0 * np.pi * frequency_hz, rng.uniform(0.0, 2.0 * np.pi)
        x += size_m * np.sin(w * t + phase)
        v += size_m * w * np.cos(w * t + phase)
        a -= size_m * w * w * np.sin(w * t + phase)
    tip = np.empty(t.size)
    at = x[0]
    for i, here in enumerate(x.tolist()):
        at = min(max(at, here - 0.5 * GAP_M), here + 0.5 * GAP_M)
        tip[i] = at
    carried = np.abs(tip - x) > 0.499 * GAP_M
    force = np.where(tip > 0.0, 6700.0 * tip + 90.0 * v * carried, 0.0) + MASS_KG * a
    force += 0.03 * rng.standard_normal(t.size)
    return from_arrays("play", t, np.round((x + 0.07) / 1e-6) * 1e-6, force)


@pytest.mark.parametrize("seed", cases(1, 2))
def test_a_play_beyond_the_mass_is_a_play_and_no_second_mass(seed: int) -> None:
    answer = diagnose(recorded(seed), "stiffness,damping,mass").answer
    assert answer["class"] == [["backlash"]]
    (effect,) = answer["effects"]
    assert effect["law"] == BEYOND_THE_MASS
    assert effect["parameters"]["gap"]["value"] == pytest.approx(GAP_M, rel=0.1)
    assert answer["base"]["parameters"]["m"]["value"] == pytest.approx(MASS_KG, rel=0.05)
    assert answer["error"]["after_over_floor"] < 1.1


@pytest.mark.parametrize(
    ("base", "masses"),
    [
        ("stiffness,damping,mass", {BEYOND_THE_MASS}),
        ("mass-spring-damper", {"tool_inertia", BEYOND_THE_MASS}),
        ("kelvin-voigt", {"tool_inertia"}),
    ],
)
def test_a_play_beyond_a_mass_needs_a_mass_and_the_tool_has_only_one(
    base: str, masses: set[str]
) -> None:
    laws = applicable(LIBRARY, recorded(1), base_of(base))
    ours = {"tool_inertia", BEYOND_THE_MASS}
    assert ours & {effect.law or effect.name for effect in laws} == masses


def test_a_held_mass_behind_a_play_may_lose_stiffness_too() -> None:
    """The mass moves with the encoder; impacts of the play are left out, and the loss is slow."""
    rng = np.random.default_rng(5)
    t = DT_S * np.arange(6000)
    x, a = np.full(t.size, 3e-3), np.zeros(t.size)
    for frequency_hz, size_m in ((0.29, 1.4e-3), (0.83, 8e-4), (2.3, 3e-4)):
        w, phase = 2.0 * np.pi * frequency_hz, rng.uniform(0.0, 2.0 * np.pi)
        x += size_m * np.sin(w * t + phase)
        a -= size_m * w * w * np.sin(w * t + phase)
    tip = np.empty(t.size)
    at = x[0]
    for i, here in enumerate(x.tolist()):
        at = min(max(at, here - 4e-4), here + 4e-4)
        tip[i] = at
    part = t / t[-1]
    stiffness = 3900.0 * (1.0 - 0.08 * (3.0 * part**2 - 2.0 * part**3))
    force = stiffness * tip + 180.0 * np.gradient(tip, DT_S) + 12.0 * a
    force += 0.15 * rng.standard_normal(t.size)
    recording = from_arrays("held", t, np.round((x + 0.03) / 1e-6) * 1e-6, force)
    answer = diagnose(recording, "mass-spring-damper", surface=0.03).answer
    assert answer["class"] == [["backlash", "softening"]]
    assert answer["effects"][0]["law"] == BEYOND_THE_MASS
    assert answer["error"]["after_over_floor"] < 1.15
