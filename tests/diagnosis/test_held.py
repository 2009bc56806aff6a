"""A body that is fixed to the tool pulls as well as pushes, and has no surface; others are left."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.samples.held import is_held, is_left
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S = 2e-3
T_S = DT_S * np.arange(4000)
X_M = 5e-3 * np.sin(4.4 * T_S) + 3e-3 * np.sin(10.7 * T_S + 1.0) + 2e-3 * np.sin(19.5 * T_S + 2.0)


def recorded(force: np.ndarray, seed: int = 3) -> Recording:
    noise = 0.05 * np.random.default_rng(seed).normal(size=T_S.size)
    return from_arrays("body", T_S, X_M, force + noise)


def bolted(friction: float = 0.0) -> Recording:
    v = np.gradient(X_M, DT_S)
    return recorded(350.0 * X_M + 5.0 * v + friction * np.tanh(v / 1e-3))


def pressed(surface: float, bias: float, adhesion: float = 0.0) -> Recording:
    depth = X_M - surface
    force = np.where(depth > 0.0, 350.0 * depth + 5.0 * np.gradient(X_M, DT_S), 0.0)
    held_back = adhesion * np.exp(depth / 1e-3) * (depth <= 0.0)
    return recorded(np.where(depth > 0.0, np.maximum(force, 0.0), -held_back) + bias)


@pytest.mark.parametrize("friction", [0.0, 1.2])
def test_a_body_bolted_to_the_tool_gets_no_bias_but_a_base_without_contact(friction: float) -> None:
    answer = diagnose(bolted(friction)).answer
    assert answer["class"] == ([["coulomb_friction"]] if friction else [])
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(350.0, rel=0.01)
    assert any("--surface" in note for note in answer["notes"])


def test_a_body_that_is_left_is_not_held_wherever_its_surface_is() -> None:
    assert is_held(bolted())
    for surface in (-4e-3, -1e-3, 2e-3):
        for bias in (-0.5, -2.0):
            assert not is_held(pressed(surface, bias))
    assert not is_held(pressed(0.0, 0.0, adhesion=1.0))


def test_the_surface_that_is_given_is_kept() -> None:
    assert diagnose(bolted(), surface=-0.02).base.model.base.name == "kelvin-voigt"


def test_a_place_given_in_the_middle_of_a_bolted_body_is_its_rest() -> None:
    """A return spring was named in place of the base's own, whose stiffness was 0."""
    plain, rubbed, stiff = (
        diagnose(one, surface=0.0)
        for one in (bolted(), bolted(1.2), recorded(350.0 * X_M + 6e6 * X_M**3))
    )
    assert [found.answer["class"] for found in (plain, rubbed, stiff)] == [
        [], [["coulomb_friction"]], [["nonlinear_stiffening"]],
    ]  # fmt: skip
    assert {found.base.model.base.name for found in (plain, rubbed, stiff)} == {"spring,viscous"}
    assert any("about that place" in note for note in plain.answer["notes"])


@pytest.mark.parametrize("effect", ["channel_delay", "second_layer", "periodic_disturbance"])
def test_no_return_spring_takes_the_place_of_a_bolted_bodys_own(effect: str) -> None:
    """It was named alone, or beside the effect, and the base's spring only pushed."""
    v = np.gradient(X_M, DT_S)
    force = 350.0 * X_M + 5.0 * v
    if effect == "channel_delay":
        force = np.interp(T_S - 0.01, T_S, force)
    elif effect == "second_layer":
        force = 700.0 * np.where(X_M > 0.0, X_M, 0.4 * X_M) + v
    else:
        force += 0.3 * np.sin(2.0 * np.pi * 7.3 * T_S)
    names = {effect, "return_spring", "viscous_friction"}
    tried = tuple(one for one in LIBRARY if one.name in names)
    found = diagnose(recorded(force), surface=0.0, effects=tried)
    assert found.answer["class"] == [[effect]]
    assert found.base.model.base.name == "spring,viscous"


@pytest.mark.parametrize("force", ["a spring of the rig", "adhesion"])
def test_a_body_that_is_left_stays_one_where_its_place_is_given(force: str) -> None:
    """The rig's spring pulls a third as hard as the body pushes, and has a slope everywhere."""
    body = pressed(-1e-3, 0.0, adhesion=0.8 if force == "adhesion" else 0.0)
    spring = 120.0 * (X_M + 1e-3) if force != "adhesion" else 0.0
    found = diagnose(from_arrays("left", T_S, X_M, body.force + spring), surface=-1e-3)
    assert found.base.model.base.name == "kelvin-voigt"
    assert found.answer["class"] == [["adhesion" if force == "adhesion" else "return_spring"]]


@pytest.mark.parametrize("surface", cases(-6e-3, -1e-3, 4e-3))
@pytest.mark.parametrize(("base", "bias"), [("spring,viscous", 0.0), ("spring,viscous,bias", 0.8)])
def test_terms_of_a_body_that_is_left_are_those_of_contact(
    base: str, bias: float, surface: float
) -> None:
    """The free air beyond the surface was named a second layer, with a tenth of the error left."""
    answer = diagnose(pressed(surface, bias), base).answer
    assert answer["verdict"] == "no_missing_effect"
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(350.0, rel=0.02)
    assert any("leaves the body" in note for note in answer["notes"])


@pytest.mark.parametrize("seed", cases(1, 2, 4))
def test_a_bias_in_the_base_is_not_cut_where_the_body_would_pull(seed: int) -> None:
    """The body lets go with a jump of its damping; a bias was named beside the base's own."""
    rng, t = np.random.default_rng(seed), DT_S / 8 * np.arange(3750 * 8)
    rates = rng.uniform(0.2, 3.0, 6)
    x = sum(rng.uniform(0.2, 1.0) * np.sin(2.0 * np.pi * f * t + rng.uniform(0, 6)) for f in rates)
    x = 1.8e-3 * x / np.max(np.abs(x)) + 4e-4
    body = np.where(x > 0.0, 21_600.0 * x + 85.0 * np.gradient(x, DT_S / 8), 0.0)
    force = np.maximum(body, 0.0)[::8] + 0.5 + 0.038 * rng.standard_normal(3750)
    position = 2e-7 * np.round((x[::8] + 0.05) / 2e-7)
    made = from_arrays("body", t[::8], position, force)
    answer = diagnose(made, "stiffness,damping,bias").answer
    assert answer["verdict"] == "no_missing_effect"
    assert answer["base"]["parameters"]["f0"]["value"] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("zero", [-4e-3, 0.0, 4e-3])
def test_a_body_that_stiffens_on_both_sides_or_yields_on_one_is_not_left(zero: float) -> None:
    x = X_M - zero
    for force in (350.0 * x + 1e7 * x**3, 700.0 * x * np.where(x > 0.0, 1.0, 0.4)):
        assert not is_left(recorded(force + 5.0 * np.gradient(X_M, DT_S)))


def test_a_pull_that_lets_go_slowly_is_no_fixed_body() -> None:
    """A neck of 3 mm hid the free air; no spring has a stiffness below zero."""
    body = 350.0 * X_M + 5.0 * np.gradient(X_M, DT_S)
    neck = -3.0 * np.exp(np.minimum(X_M, 0.0) / 3e-3)
    assert is_left(recorded(np.where(X_M > 0.0, body, neck)))


def test_free_air_is_seen_where_damping_hides_the_surface() -> None:
    """A damping with the depth is most of the force; two straight parts met in the body."""
    t = 2e-3 * np.arange(7500)
    x = np.full(t.size, -1e-4)
    for begin, length, size in ((1.0, 0.8, 4e-4), (5.0, 0.6, -4e-4), (6.0, 0.5, 4e-4),
                                (13.0, 0.5, -4e-4)):  # fmt: skip
        s = np.clip((t - begin) / length, 0.0, 1.0)
        x += size * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    shaken = np.clip((t - 7.0) / 0.5, 0.0, 1.0) * np.clip((12.5 - t) / 0.5, 0.0, 1.0)
    for hertz, size in ((3.1, 4e-5), (7.3, 3e-5), (11.9, 2e-5)):
        x += size * shaken * np.sin(2.0 * np.pi * hertz * t)
    depth = np.maximum(x, 0.0)
    force = np.maximum(1340.0 * depth + 4e5 * depth * np.gradient(x, t), 0.0)
    force += 1e-3 * np.random.default_rng(1).standard_normal(t.size)
    made = from_arrays("body", t, x, force)
    assert is_left(made)
    assert diagnose(made, "spring,viscous").answer["class"] == [["hunt_crossley"]]


def _far_from_zero(effect: str, zero_m: float) -> Recording:
    """Return a body of 34 kN/m, moved by 15 um, whose encoder has its zero far away."""
    rng = np.random.default_rng(16)
    t = np.arange(6000) / 1000.0
    x = 15e-6 * np.sin(2.0 * np.pi * (0.4 * t + 0.3 * t**2))
    y = np.interp(t - 0.048, t, x) if effect == "channel_delay" else x
    force = 34_000.0 * y + 490.0 * np.gradient(y, t) + 0.5 + 0.005 * rng.standard_normal(t.size)
    position = np.round((x + zero_m) / 5e-8) * 5e-8
    return from_arrays("held", t, position, force)


@pytest.mark.parametrize("zero_m", [0.0, -0.0884, 0.41])
@pytest.mark.parametrize("effect", ["none", "channel_delay"])
def test_the_place_of_the_encoders_zero_changes_no_answer(effect: str, zero_m: float) -> None:
    """A prior took the bias that a distant zero needs for one that the data do not determine."""
    answer = diagnose(_far_from_zero(effect, zero_m), "spring,viscous,bias").answer
    assert answer["class"][:1] == ([] if effect == "none" else [[effect]])
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(34_000.0, rel=0.01)


def _drifting(dt_s: float = 4e-3) -> Recording:
    """Return a stiff body that is left: a drift and a hum keep the force in air from being even."""
    rng, t = np.random.default_rng(23), dt_s * np.arange(5000)
    rates = rng.uniform(0.1, 1.5, 6)
    x = sum(rng.uniform(0.2, 1.0) * np.sin(2.0 * np.pi * f * t + rng.uniform(0, 6)) for f in rates)
    x = 9e-4 * x / np.max(np.abs(x))
    body = np.where(x > 0.0, 17_000.0 * x + 10.0 * np.gradient(x, dt_s), 0.0)
    force = np.maximum(body, 0.0) + 8.0 * t / t[-1] + 0.5 * np.sin(2.0 * np.pi * 50.0 * t)
    return from_arrays("drifting", t, x, force + 0.05 * rng.standard_normal(t.size))


def test_a_body_that_is_left_is_found_by_its_error_where_no_free_air_is_seen() -> None:
    """A drift hid the free air; a second layer was named, with many times the noise left."""
    made = _drifting()
    assert not is_left(made)
    answer = diagnose(made, "spring,viscous").answer
    assert [sorted(names) for names in answer["class"]] == [["force_drift", "periodic_disturbance"]]
    assert answer["error"]["after_over_floor"] < 1.1


def _bushing(t: np.ndarray, lost: float, rising: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position [m] and force [N] of a bushing that heats up, or damps more at one end."""
    rng = np.random.default_rng(6)
    rates = rng.uniform(0.3, 4.0, 6)
    x = sum(np.sin(2.0 * np.pi * f * t + rng.uniform(0, 6)) for f in rates) * 1e-3 + 0.03
    v = np.gradient(x, t)
    k = 900.0 * (1.0 - lost * (1.0 - np.exp(-t / 4.0)))
    force = k * (x - 0.0305) + (14.0 + rising * (x - 0.03)) * v + 1.5
    return x, force + 0.01 * rng.standard_normal(t.size)


@pytest.mark.parametrize(
    ("lost", "rising", "effect"), [(0.1, 0.0, "softening"), (0.0, 2500.0, "hunt_crossley")]
)
def test_a_fixed_body_softens_or_damps_more_along_the_stroke(
    lost: float, rising: float, effect: str
) -> None:
    """Both were laws of a body that is left alone; a fixed one was "unexplained" or a drift."""
    t = 8e-3 * np.arange(1500)
    made = from_arrays("bushing", t, *_bushing(t, lost, rising))
    answer = diagnose(made, "spring,viscous,bias").answer
    assert answer["class"] == [[effect]]
    assert answer["error"]["after_over_floor"] < 1.1
    if effect == "softening":
        amplitude = answer["effects"][0]["parameters"]["stiffness_lost"]["value"]
        assert amplitude == pytest.approx(90.0, rel=0.05)


def test_a_second_effect_is_named_beside_a_large_exact_delay() -> None:
    """Its gain was a ten-thousandth of the delay's; chance in all values hid that it took all."""
    rng, t = np.random.default_rng(9), 5e-3 * np.arange(4000)
    steps = np.cumsum(rng.normal(size=40))
    x = np.convolve(np.repeat(steps, 100), np.hanning(30) / np.sum(np.hanning(30)), "same")
    x = 7e-3 * x / np.ptp(x)
    late = np.interp(t - 0.06, t, x)
    k = 490.0 * (1.0 - 0.02 * (1.0 - np.exp(-t / 9.0)))
    pink = np.fft.irfft(
        np.fft.rfft(rng.normal(size=t.size)) / np.sqrt(np.maximum(np.arange(t.size // 2 + 1), 1.0)),
        t.size,
    )
    force = k * (late + 0.011) + 6.0 * np.gradient(late, t) + 1.8e-3 * pink / np.std(pink)
    answer = diagnose(from_arrays("muscle", t, x, force), "spring,viscous,bias").answer
    assert [sorted(names) for names in answer["class"]] == [["channel_delay", "softening"]]


@pytest.mark.parametrize("middle", cases(-0.0155, -0.0165, -0.0175))
def test_a_return_spring_that_hides_the_touch_is_named_and_no_layer(middle: float) -> None:
    """Its slope in air was taken for a body, and the body for a second layer that is late."""
    rng, t = np.random.default_rng(17), 2e-3 * np.arange(6000)
    rates = rng.uniform(0.2, 3.0, 7)
    x = sum(rng.uniform(0.3, 1.0) * np.sin(2.0 * np.pi * f * t + rng.uniform(0, 6)) for f in rates)
    x = 2.4e-3 * x / np.max(np.abs(x)) + middle
    depth = x + 0.0166
    body = np.where(depth > 0.0, 3300.0 * depth + 6.0 * np.gradient(x, t), 0.0)
    force = np.maximum(body, 0.0) + 900.0 * (x + 0.0208)
    made = from_arrays("sprung", t, x, force + 0.014 * rng.standard_normal(t.size))
    answer = diagnose(made, "kelvin-voigt").answer
    assert answer["class"] == [["return_spring"]]
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(3300.0, rel=0.02)


def test_a_friction_that_yields_over_a_fifth_of_the_stroke_has_both_names() -> None:
    t = 2e-3 * np.arange(4000)
    x = 1e-3 * np.sin(2.0 * np.pi * 0.7 * t) + 3e-4 * np.sin(2.0 * np.pi * 1.9 * t + 1.0)
    slid = np.zeros(t.size)
    for i in range(1, t.size):
        moved = x[i] - x[i - 1]
        slid[i] = slid[i - 1] + (moved - abs(moved) * slid[i - 1]) / 4e-4
    noise = 0.03 * np.random.default_rng(5).standard_normal(t.size)
    force = 14_000.0 * x + 20.0 * np.gradient(x, t) + 2.0 * slid + noise
    answer = diagnose(from_arrays("bushing", t, x, force), "spring,viscous,bias").answer
    assert sorted(answer["class"]) == [["coulomb_friction"], ["hysteresis"]]
