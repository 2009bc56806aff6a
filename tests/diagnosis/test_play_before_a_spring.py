"""A play between a drive, whose damping is its own, and the spring that it pulls."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.contact.effects.joints import BEFORE_A_SPRING
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.applicable import applicable
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.recordings.recording import from_arrays

DT_S, GAP_M, SPRING, DAMPING, NOISE_N = 2e-3, 1.8e-3, 75.0, 6.0, 0.007


@pytest.mark.parametrize("ripple_N", [0.0, 0.058])
def test_a_chain_hangs_slack_between_a_drive_and_its_spring(ripple_N: float) -> None:
    """The drive's own damping goes on while the chain is slack: with ripple it was unexplained."""
    t = DT_S * np.arange(7000)
    x = 0.016 * np.sin(1.9 * t) + 0.009 * np.sin(4.6 * t + 1.0) + 0.004 * np.sin(11.0 * t)
    pulled = np.zeros_like(x)
    for i in range(1, x.size):
        pulled[i] = np.clip(pulled[i - 1], x[i] - 0.5 * GAP_M, x[i] + 0.5 * GAP_M)
    force = SPRING * pulled + DAMPING * np.gradient(x, DT_S) + 0.2
    force += ripple_N * np.sin(2.0 * np.pi * x / 9.525e-3 + 0.6)
    force += NOISE_N * np.random.default_rng(12).standard_normal(t.size)
    recording = from_arrays("chain", t, 1e-6 * np.round(x / 1e-6) + 0.04, force)
    answer = diagnose(recording, "spring,viscous,bias").answer
    names = ["backlash", "position_ripple"] if ripple_N else ["backlash"]
    assert [sorted(one) for one in answer["class"]] == [names]
    sizes = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    assert sizes["gap"] == pytest.approx(GAP_M, rel=0.05)
    assert sizes["spring_stiffness"] == pytest.approx(SPRING, rel=0.05)


@pytest.mark.parametrize(("base", "possible"), [("spring,viscous,bias", True),
                                                ("mass,viscous,bias", False)])  # fmt: skip
def test_a_drive_without_a_spring_has_no_play_before_one(base: str, possible: bool) -> None:
    """There the law took the form error of a friction, as a third effect."""
    t = DT_S * np.arange(500)
    made = from_arrays("slide", t, 0.01 * np.sin(2.0 * t), np.sign(np.cos(2.0 * t)))
    laws = {(one.name, one.law) for one in applicable(LIBRARY, made, base_of(base))}
    assert (("backlash", BEFORE_A_SPRING) in laws) == possible
