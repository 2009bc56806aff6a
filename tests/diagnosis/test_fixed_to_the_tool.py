"""Bodies of testing machines that are fixed to the tool, and no option says so."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, filtfilt
from scipy.special import erf

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import Recording, from_arrays

Row = NDArray[np.float64]


def _swept(dt_s: float, size_m: float) -> tuple[Row, Row, Row]:
    """Return time, place [m] and speed of a triangle at three rates with rounded ends."""
    t = np.arange(0.0, 24.0, dt_s)
    rate = np.choose(np.minimum(t // 8.0, 2).astype(int), [0.2, 0.5, 1.3])
    phase = 2.0 * np.pi * np.cumsum(rate) * dt_s
    x = size_m * 2.0 / np.pi * np.arcsin(0.995 * np.sin(phase))
    return t, x, np.gradient(x, dt_s)


def _recorded(t: Row, x: Row, force: Row, noise_n: float) -> Recording:
    noise = noise_n * np.random.default_rng(41).standard_normal(t.size)
    return from_arrays("made", t, 1e-6 * np.round(x / 1e-6), force + noise)


def test_a_damper_that_brakes_harder_one_way_is_named_without_a_base() -> None:
    """Its two halves differ by speed, so no slope shows that it is fixed."""
    t, x, v = _swept(0.002, 0.02)
    force = 1500.0 * x + np.where(v > 0.0, 90.0, 290.0) * v
    answer = diagnose(_recorded(t, x, force, 0.05)).answer
    assert [e["name"] for e in answer["effects"]] == ["direction_dependent_damping"]
    found = answer["effects"][0]["parameters"]["extra_forward_damping"]["value"]
    assert found == pytest.approx(-200.0, rel=0.01)


def test_a_dome_that_snaps_through_is_judged_on_its_whole_stroke() -> None:
    """Its force falls in the middle: a contact near one end named a spring and a weight."""
    t = 0.002 * np.arange(10000)
    x = 6.5e-3 * np.sin(2.0 * np.pi * 0.3 * t) + 8e-4 * np.sin(2.0 * np.pi * 1.1 * t)
    force = -4200.0 * x + 2.4e8 * x**3 + 12.0 * np.gradient(x, 0.002)
    answer = diagnose(_recorded(t, x, force, 0.05)).answer
    assert [e["name"] for e in answer["effects"]] == ["nonlinear_stiffening"]
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(-4200.0, rel=0.02)


@pytest.mark.parametrize("dt_s", [0.002, 0.004])
def test_dry_friction_that_yields_first_has_no_delay(dt_s: float) -> None:
    """Dahl's force is that of the way; by the speed at each sample it was half a sample ahead."""
    t, x, _ = _swept(dt_s, 4e-3)
    fine = 8  # steps between samples
    z, slid = np.zeros(t.size), 0.0
    for i in range(1, t.size):
        way = (x[i] - x[i - 1]) / fine
        for _ in range(fine):
            slid += way / 6e-4 * (1.0 - np.sign(way) * slid)
        z[i] = slid
    answer = diagnose(_recorded(t, x, 18e3 * x + 20.0 * z, 0.1)).answer
    names = {name for names in answer["class"] for name in names}
    assert names == {"coulomb_friction", "hysteresis"}
    found = answer["effects"][0]["parameters"]
    size = found.get("friction_force", found.get("yield_force"))["value"]
    assert size == pytest.approx(20.0, rel=0.01)


def test_a_stop_that_a_quick_stroke_meets_has_its_stiffness() -> None:
    """Between two samples lies more than the onset's uncertainty: 135 kN/m were found there."""
    t = 0.002 * np.arange(8000)
    way = 0.02 * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * 0.25 * t - 0.5 * np.pi))
    x = filtfilt(*butter(2, 0.048), np.minimum(way, 0.0152 + 0.02 * (way - 0.0152)))
    v, depth = np.gradient(x, 0.002), np.maximum(x - 0.015, 0.0)
    stop = 2e5 * depth + 300.0 * np.gradient(depth, 0.002)
    answer = diagnose(_recorded(t, x, stop + 8.0 * np.tanh(v / 8e-4) + 25.0 * v, 0.15)).answer
    assert answer["class"][0] == ["coulomb_friction"]
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(2e5, rel=0.01)


def test_damage_of_a_fixed_specimen_is_no_bias_of_a_contact() -> None:
    """A surface at the outer end of the stroke, with a bias, is the fixed body on fewer samples."""
    t = 0.005 * np.arange(4000)
    x = 0.03 * np.sin(2.0 * np.pi * 0.23 * t) + 0.01 * np.sin(2.0 * np.pi * 0.71 * t + 1.0)
    x += 1.2e-4 * t
    lost = np.where(np.abs(x) < 0.98 * np.maximum.accumulate(np.abs(x)), 0.06, 0.0)
    force = 700.0 * x * (1.0 - lost) + 200.0 * np.gradient(x, 0.005)
    answer = diagnose(_recorded(t, x, force, 0.2)).answer
    assert answer["base"]["model"] == "spring,viscous,bias"
    assert "force_bias" not in {name for names in answer["class"] for name in names}


def _cycled(dt_s: float) -> tuple[Row, Row, Row]:
    """Return time, place [m] and speed of cycles whose size grows and falls about 55 mm."""
    t = np.arange(0.0, 20.0, dt_s)
    size = 4e-3 * np.interp(t, [0.0, 5.0, 9.0, 14.0, 20.0], [0.3, 0.8, 0.5, 1.0, 0.6])
    x = size * np.sin(2.0 * np.pi * 0.7 * t) + 0.2 * size * np.sin(2.0 * np.pi * 1.6 * t + 1.0)
    return t, 0.055 + x, np.gradient(x, dt_s)


def test_structural_damping_of_a_bush_is_hysteresis_or_the_friction_of_its_guide() -> None:
    """Its friction grows with the way from the rest to both sides: it is no dry friction."""
    t, x, v = _cycled(0.004)
    beside = x - 0.0545
    force = 25e3 * beside + 30.0 * v + 4e3 * np.abs(beside) * np.tanh(v / 4e-4)
    answer = diagnose(_recorded(t, x, force, 0.3)).answer
    assert {tuple(names) for names in answer["class"]} == {("hysteresis",), ("coulomb_friction",)}
    centre = answer["effects"][0]["parameters"]["centre"]["value"]
    assert centre == pytest.approx(0.0545, abs=2e-4)


def test_a_rubber_that_has_lost_stiffness_on_both_sides_shows_mullins() -> None:
    """By Ogden and Roxburgh's law, which is not the library's for a body that is held."""
    t, x, v = _cycled(0.004)
    beside = x - 0.0545
    most = np.maximum.accumulate(np.abs(beside))
    lost = 0.2 * erf((most - np.abs(beside)) / 2e-3)
    answer = diagnose(_recorded(t, x, 25e3 * beside * (1.0 - lost) + 30.0 * v, 0.3)).answer
    assert answer["class"][0] == ["mullins_softening"]
    assert answer["error"]["after"] < 0.3 * answer["error"]["before"]


def test_a_held_body_behind_a_joint_is_late_as_by_a_slow_channel() -> None:
    """Spring and damper behind a spring are a softer pair whose force is late: no data decide."""
    t, x, v = _cycled(0.002)
    joint, force, fine = 8e-6, np.zeros(t.size), 20
    for i in range(1, t.size):
        f = force[i - 1]
        for part in (np.arange(fine) + 0.5) / fine:
            place, speed = (row[i - 1] + part * (row[i] - row[i - 1]) for row in (x, v))
            pull = 2000.0 * (place - 0.05) + 800.0 * speed - (1.0 + 2000.0 * joint) * f
            f += 0.002 / fine * pull / (800.0 * joint)
        force[i] = f
    answer = diagnose(_recorded(t, x, force, 0.02), "spring,viscous,bias").answer
    assert {("force_lag",), ("series_compliance",)} <= {tuple(names) for names in answer["class"]}
    known = answer["probability"]
    assert known["series_compliance"] == pytest.approx(known["force_lag"], rel=0.02)


@pytest.mark.parametrize("dry_n", [0.0, 1.5])
def test_a_clevis_with_play_is_backlash(dry_n: float) -> None:
    """Within the play the spring is slack (Nordin and Gutman 2002), as a softer middle would be."""
    t, x, v = _swept(0.002, 5e-3)
    taut = np.where(np.abs(x - 6e-4) > 3.5e-4, 1.0, 0.0)
    spring = 3000.0 * (x - 6e-4 - np.clip(x - 6e-4, -3.5e-4, 3.5e-4)) + 20.0 * taut * v
    force = spring + dry_n * np.tanh(v / 2e-4)
    answer = diagnose(_recorded(t, x, force, 0.03), "spring,viscous,bias").answer
    named = ["backlash", "coulomb_friction"] if dry_n else ["backlash"]
    assert named in [sorted(names) for names in answer["class"]]
    found = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    assert found["gap"] == pytest.approx(7e-4, rel=0.03)
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(3000.0, rel=0.01)


def test_a_play_before_a_dry_guide_opens_at_no_force() -> None:
    """The guide holds the body where the tool lets go of it, so the play opens at two places."""
    t, x, _ = _swept(0.002, 5e-3)
    stiffness, dry, half_gap = 3000.0, 1.5, 3.5e-4
    tip, flank, force = 0.0, 0.0, np.zeros(t.size)
    for i in range(1, t.size):
        if flank == 0.0 and abs(x[i] - tip) > half_gap:
            flank = np.sign(x[i] - tip)
        if flank != 0.0:
            pushed = x[i] - flank * half_gap
            pressed = stiffness * pushed + dry * np.sign(pushed - tip)
            flank = flank if flank * pressed > 0.0 else 0.0
        if flank != 0.0:
            tip, force[i] = pushed, pressed
    answer = diagnose(_recorded(t, x, force, 0.03), "spring,viscous,bias").answer
    assert [sorted(names) for names in answer["class"]] == [["backlash", "coulomb_friction"]]
    found = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    assert found["friction_force"] == pytest.approx(dry, rel=0.03)
    assert found["slack_force"] == pytest.approx(stiffness * half_gap, rel=0.05)
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(stiffness, rel=0.01)


@pytest.mark.parametrize("sharpness", [0.75, 1.0, 2.0])
def test_a_mount_after_bouc_and_wen_is_a_held_body_with_hysteresis(sharpness: float) -> None:
    """The sliders of Iwan turn over otherwise, and dry friction was the first of a class."""
    rng, dt = np.random.default_rng(25), 0.002
    t = dt * np.arange(7000)
    turns = np.outer(2.0 * np.pi * np.array([0.31, 0.83, 1.9]), t) + rng.uniform(0, 6, 3)[:, None]
    x = np.array([2.1e-3, 1e-3, 4e-4]) @ np.sin(turns)
    z, held = 0.0, np.zeros(t.size)
    for i in range(1, t.size):
        way = (x[i] - x[i - 1]) / 20
        for _ in range(20):
            z += way / 7e-4 * (1.0 - abs(z) ** sharpness * (0.5 + 0.5 * np.sign(way * z)))
        held[i] = z
    force = 6500.0 * (x + 3e-4) + 12.0 * np.gradient(x, dt) + 2.4 * held
    answer = diagnose(_recorded(t, x, force, 0.15)).answer
    assert answer["class"] == [["hysteresis"]]
    found = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    assert found["yield_force"] == pytest.approx(2.4, rel=0.01)
    assert found["yield_travel"] == pytest.approx(7e-4, rel=0.01)
    assert found["sharpness"] == pytest.approx(sharpness, rel=0.05)
