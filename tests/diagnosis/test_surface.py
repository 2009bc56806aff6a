"""Where the force first rises is where the surface is, whatever the body does beyond it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cases import cases
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.applicable import applicable
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.samples.lost_contact import without_contact
from teleop_rt.diagnosis.samples.onset import onset
from teleop_rt.diagnosis.samples.preparation import pose
from teleop_rt.diagnosis.samples.surface import surface_of
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt_dev.diagnosis.foreign_plants import foreign
from teleop_rt_dev.diagnosis.motions import RATE_HZ, rich

Array = NDArray[np.float64]
SURFACE_M, DEPTH_M, K = 0.06, 0.006, 3600.0
EVERY = RATE_HZ // 1000
DT_S = 1e-3


def layered(p: Array) -> Array:
    return K * p + 3.0 * K * np.maximum(p - 0.4 * DEPTH_M, 0.0)


def stiffening(p: Array) -> Array:
    return K * p * (0.3 + 3.0 * (p / DEPTH_M) ** 2)


def relaxing(p: Array) -> Array:
    force, stretch = K * p, np.zeros(3)
    change = np.diff(p, prepend=p[0])
    for i, moved in enumerate(change):
        stretch += moved - stretch * DT_S / np.array([0.03, 0.2, 1.5])
        force[i] += 0.3 * K * np.sum(stretch)
    return np.maximum(force, 0.0)


def pressed(law: Callable[[Array], Array], seed: int = 3) -> tuple[Array, Array, Array]:
    """Return time, penetration and the force of a law with 0.3 % of noise."""
    rng = np.random.default_rng(seed)
    x = rich(rng, DEPTH_M)[::EVERY]
    force = law(np.maximum(x, 0.0))
    noise = 0.003 * float(np.max(force)) * rng.standard_normal(x.size)
    return DT_S * np.arange(x.size), x, force + noise


def on_the_axis(t: Array, x: Array, force: Array) -> Recording:
    return from_arrays("axis", t, np.round((x + SURFACE_M) / 1e-6) * 1e-6, force)


@pytest.mark.parametrize(
    ("seed", "effect"),
    [
        # Of 216 recordings of a campaign, those whose surface had been placed outside its bounds.
        (44607245, "viscous_friction"),
        (427647873, "viscous_friction"),
        (1237514889, "coulomb_friction"),
        (214811860, "direction_dependent_damping"),
    ],
)
def test_the_surface_is_detected_despite_friction_in_the_approach(seed: int, effect: str) -> None:
    """Friction turns the line of the air by its speed, or flips it: no corner was seen then."""
    record = foreign(seed, (effect,))
    recording = from_arrays("friction", record.t, record.position + SURFACE_M, record.force)
    found = surface_of(recording)
    assert not found.fixed
    assert abs(found.position - SURFACE_M) < found.within


@pytest.mark.parametrize("law", [layered, stiffening, relaxing])
def test_the_surface_is_where_the_force_begins_not_where_a_line_through_all_of_it_ends(
    law: Callable[[Array], Array],
) -> None:
    found = surface_of(on_the_axis(*pressed(law)))
    assert not found.fixed
    assert abs(found.position - SURFACE_M) < min(0.05 * DEPTH_M, found.within)


def test_a_drift_in_free_air_does_not_hide_the_surface() -> None:
    t, x, force = pressed(lambda p: K * p)
    found = surface_of(on_the_axis(t, x, force + 0.15 * np.max(force) * (1.0 - np.exp(-t / 3.0))))
    assert abs(found.position - SURFACE_M) < 0.02 * DEPTH_M


def test_a_late_sensor_and_a_fast_first_approach_do_not_move_the_surface() -> None:
    x = pressed(lambda p: K * p)[1]
    fast = np.interp(np.arange(-600, 0) * DT_S, [-0.6, -0.5, -0.46, -0.3, -0.2, 0.0],
                     [x[0], x[0], 0.5 * DEPTH_M, 0.5 * DEPTH_M, x[0], x[0]])  # fmt: skip
    x = np.concatenate([fast, x])
    force = K * np.maximum(x, 0.0)
    late = np.concatenate([np.zeros(6), force[:-6]])
    found = surface_of(on_the_axis(DT_S * np.arange(x.size), x, late))
    assert abs(found.position - SURFACE_M) < 0.03 * DEPTH_M


def test_a_contact_without_free_air_has_no_onset_to_see() -> None:
    t = pressed(lambda p: K * p)[0]
    deep = 0.5 * DEPTH_M + 0.4 * DEPTH_M * np.sin(2 * np.pi * 1.3 * t)
    found = surface_of(from_arrays("deep", t, deep, K * deep))
    assert not found.clear
    assert abs(found.position) < 0.01 * DEPTH_M


def test_an_arbitrary_zero_of_a_body_pressed_all_along_is_no_missing_effect() -> None:
    """0 was taken for the surface within a quarter of the depth, and six names explained that."""
    t = pressed(lambda p: K * p)[0]
    deep = DEPTH_M * (0.6 + 0.2 * np.sin(2 * np.pi * 1.3 * t) + 0.1 * np.sin(2 * np.pi * 4.1 * t))
    force = K * deep + 2.0 * np.gradient(deep, DT_S)
    slid = np.zeros(t.size)
    for travel in np.geomspace(0.02, 0.4, 7) * DEPTH_M:
        stretch = 0.0
        for i, moved in enumerate(np.diff(deep, prepend=deep[0])):
            stretch = min(max(stretch + moved, -travel), travel)
            slid[i] += 0.02 * K * stretch
    noise = 0.02 * np.random.default_rng(8).standard_normal(t.size)
    read = np.round((deep - 0.15 * DEPTH_M) / 1e-6) * 1e-6
    assert diagnose(from_arrays("held", t, read, force + noise)).answer["class"] == []
    answer = diagnose(from_arrays("held", t, read, force + slid + noise)).answer
    assert answer["class"] == [["hysteresis"]]


@pytest.mark.parametrize("share", [-0.2, 0.1])
def test_an_encoder_zero_near_the_surface_is_not_taken_for_it(share: float) -> None:
    """Within a quarter of the depth 0 was taken for it, and an offset named in a lag's place."""
    t, x, force = pressed(lambda p: K * p)
    found = surface_of(from_arrays("near", t, x + share * DEPTH_M, force))
    assert not found.fixed
    assert abs(found.position - share * DEPTH_M) < min(0.03 * DEPTH_M, found.within)


def test_a_body_pressed_all_along_has_its_surface_where_its_force_would_end() -> None:
    """The axis counts from anywhere: its 0 was taken for the surface, and many were refused."""
    place = 0.05
    t = pressed(lambda p: K * p)[0]
    deep = DEPTH_M * (0.5 + 0.3 * np.sin(2 * np.pi * 1.3 * t) + 0.1 * np.sin(2 * np.pi * 4.1 * t))
    force = deep**1.5 * (5e4 + 400.0 * np.gradient(deep, DT_S))
    force += 0.05 * np.random.default_rng(8).standard_normal(t.size)
    recording = from_arrays("deep", t, np.round((deep + place) / 1e-6) * 1e-6, force)
    answer = diagnose(recording, "hunt-crossley").answer
    assert answer["verdict"] == "no_missing_effect"
    found = answer["base"]["parameters"]
    assert found["surface"]["value"] == pytest.approx(place, abs=0.05 * DEPTH_M)
    assert found["n"]["value"] == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize("place", [0.0, -0.02])
def test_the_surface_of_a_stiffening_body_pressed_all_along_is_within_reach(place: float) -> None:
    t = pressed(lambda p: K * p)[0]
    deep = DEPTH_M * (0.5 + 0.2 * np.sin(2 * np.pi * 1.3 * t))
    found = surface_of(from_arrays("deep", t, deep + place, 5e5 * deep**2))
    assert abs(found.position - place) < found.within


@pytest.mark.parametrize("kind", ["kelvin-voigt", "mass-spring-damper"])
def test_a_surface_far_from_0_is_no_bias_of_a_body_pressed_all_along(kind: str) -> None:
    """The line of its force ends at half the deepest position: no sensor is off by as much."""
    rng = np.random.default_rng(9)
    t = pressed(lambda p: K * p)[0]
    deep = DEPTH_M * (0.5 + 0.2 * np.sin(2 * np.pi * 1.3 * t) + 0.2 * np.sin(2 * np.pi * 3.1 * t))
    v = np.gradient(deep, DT_S)
    force = 300.0 * deep + 2.0 * v + 0.01 * rng.standard_normal(t.size)
    if kind == "mass-spring-damper":
        force += 0.2 * np.gradient(v, DT_S)
    answer = diagnose(from_arrays("deep", t, deep + DEPTH_M, force), kind).answer
    assert answer["verdict"] == "no_missing_effect"
    assert answer["base"]["parameters"]["surface"]["value"] == pytest.approx(DEPTH_M, rel=0.02)


@pytest.mark.parametrize("seed", [1, 2, 3, 8, 10, 11])
def test_where_a_tool_turns_round_inside_the_body_is_no_onset(seed: int) -> None:
    """Few samples lie before such a place, and all that a spring rises beyond it looked a jump."""
    rng = np.random.default_rng(seed)
    wander = lfilter(*butter(2, 2.5, fs=1000), rng.standard_normal(16000))[2000:]
    x = 0.2e-3 + DEPTH_M * (wander - np.min(wander)) / np.ptp(wander)
    force = K * x * (1.0 + 0.1 * (x / DEPTH_M) ** 2) + 2.0 * np.gradient(x, DT_S)
    force += 0.02 * rng.standard_normal(x.size)
    found = surface_of(from_arrays("inside", DT_S * np.arange(x.size), x, force))
    assert not found.clear
    assert found.position <= np.min(x)


def test_free_air_is_known_again_where_its_force_wanders() -> None:
    t, x, _ = pressed(relaxing)
    rng = np.random.default_rng(1)
    wander = lfilter([0.02], [1.0, -0.98], rng.standard_normal(t.size))
    wander *= 0.1 / np.std(wander)
    v = np.gradient(x, DT_S)
    lost = (x > 0.0) & (relaxing(np.maximum(x, 0.0)) <= 0.0)
    assert lost.sum() > 50
    force = relaxing(np.maximum(x, 0.0)) + wander
    found = without_contact(force, x, v, 0.005) > 0.0
    assert found[lost].mean() > 0.9
    assert not found[(x > 0.0) & (force > 2.0)].any()


def sticky(x: Array) -> Array:
    """Attract in contact, and after it out to a tenth of the depth."""
    force, stuck = np.zeros_like(x), False
    for i, p in enumerate(x):
        stuck = p > 0.0 or (stuck and p > -0.1 * DEPTH_M)
        force[i] = -(1.0 - max(-p, 0.0) / (0.1 * DEPTH_M)) if stuck else 0.0
    return force


def bonded(x: Array) -> Array:
    """Attract on both sides of the surface once it was touched."""
    return -np.exp(-0.5 * (x / (0.1 * DEPTH_M)) ** 2) * (np.cumsum(x > 0.0) > 0)


@pytest.mark.parametrize(
    ("name", "pull"),
    [("adhesion", sticky), ("adhesion", bonded), ("position_ripple", np.zeros_like)],
)
def test_another_form_of_an_effect_has_its_name(name: str, pull: Callable[[Array], Array]) -> None:
    t, x, _ = pressed(lambda p: K * p)
    screw = 0.008 * DEPTH_M * np.sin(2 * np.pi * x / (0.3 * DEPTH_M) + 1.0)
    tip = x + (screw if name == "position_ripple" else 0.0)
    force = (K * tip + 18.0 * np.gradient(tip, DT_S)) * (tip > 0.0)
    force += pull(x) * 0.08 * K * DEPTH_M
    noise = 0.003 * float(np.max(force)) * np.random.default_rng(2).standard_normal(x.size)
    found = diagnose(from_arrays(name, t, x, force + noise), surface=0.0).answer
    assert found["class"] == [[name]]
    assert found["effects"][0]["explains"] > 0.95
    assert found["error"]["after_over_floor"] < 1.15


def test_attraction_that_only_one_onset_shows_is_not_hidden_by_a_surface_moved_for_it() -> None:
    """Nor is it named: a sensor's dead zone looks the same where no pull beyond is seen."""
    t, x, _ = (row[:6000] for row in pressed(lambda p: K * p))
    force = (K * x + 18.0 * np.gradient(x, DT_S)) * (x > 0.0) + 0.08 * K * DEPTH_M * sticky(x)
    noise = 0.003 * float(np.max(force)) * np.random.default_rng(2).standard_normal(x.size)
    answer = diagnose(on_the_axis(t, x, force + noise)).answer
    assert answer["verdict"] == "unexplained"
    assert answer["error"]["before"] > 1.3 * answer["error"]["noise_floor"]
    assert answer["predictor"] == ["adhesion"]
    assert answer["error"]["after_over_floor"] < 1.1


@pytest.mark.parametrize("seed", [5009, 5119])
def test_a_complete_model_has_no_missing_effect_with_an_estimated_surface(seed: int) -> None:
    """A damper's force jumps at the surface: a few micrometres beside it were called an effect."""
    record = foreign(seed)
    elsewhere = record.position + 2.5 * np.max(record.position)
    found = diagnose(from_arrays("record", record.t, elsewhere, record.force), record.base).answer
    assert found["verdict"] == "no_missing_effect"
    surface = found["base"]["parameters"]["surface"]["value"]
    depth = np.max(record.position)
    assert surface == pytest.approx(2.5 * depth, abs=1e-3 * depth)


def test_a_jump_of_inertia_inside_the_body_is_not_its_surface() -> None:
    record = foreign(5058)
    found = surface_of(from_arrays("record", record.t, record.position, record.force))
    assert -found.within < found.position < 0.01 * np.max(record.position)


@pytest.mark.parametrize("seed", [5061, 5119])
def test_the_base_finds_the_surface_despite_the_jumps_beside_it(seed: int) -> None:
    record = foreign(seed)
    depth = float(np.max(record.position))
    elsewhere = from_arrays("record", record.t, record.position + 4.0 * depth, record.force)
    problem, base = pose(elsewhere, base_of(record.base), None)
    fit = fit_base(problem, base)
    surface = problem.surface - fit.model.shift(fit.zeta)
    assert surface == pytest.approx(4.0 * depth, abs=5e-5 * depth)


# Effects that move the contact, and those that may replace an effect whose surface lies elsewhere.
_RIVALS = ("moving_surface", "channel_delay", "backlash", "permanent_set", "adhesion",
           "second_layer", "fractional_relaxation", "force_bias")  # fmt: skip


@pytest.mark.parametrize(
    ("seed", "effect"),
    [
        (138755902, "tool_inertia"),  # the mass struck at each touch moves every onset alike
        (1758025722, "permanent_set"),  # its offset and the surface's trade against each other
        (850015244, "stress_relaxation"),  # the contact's jumps spoil the descent of the rest
    ],
)
def test_an_effect_is_found_where_its_surface_must_be_found_with_it(seed: int, effect: str) -> None:
    record = foreign(seed, (effect,))
    every = 1 + record.t.size // 20_000  # half of the longest recordings' samples show as much
    elsewhere = record.position[::every] + 2.5 * np.max(record.position)
    rivals = tuple(law for law in LIBRARY if law.name in {effect, *_RIVALS})
    recording = from_arrays("record", record.t[::every], elsewhere, record.force[::every])
    found = diagnose(recording, record.base, effects=rivals).answer
    assert [effect] in found["class"]
    assert all(len(names) == 1 for names in found["class"])
    assert found["error"]["after_over_floor"] < 1.2


def test_the_surface_is_seen_where_a_heavy_tool_strikes_it_and_the_force_then_falls() -> None:
    record = foreign(2006908024)
    recording = from_arrays("struck", record.t, record.position + 0.05, record.force)
    found = surface_of(recording)
    assert found.clear
    assert abs(found.position - 0.05) < 1e-4
    assert found.within > abs(found.position - 0.05)


def test_the_surface_is_found_in_a_gap_between_samples_that_no_step_meets() -> None:
    record = foreign(617443194)
    elsewhere = record.position - 4.0 * np.max(record.position)
    recording = from_arrays("narrow gap", record.t, elsewhere, record.force)
    problem, model = pose(recording, base_of(record.base), None)
    shift = problem.surface + 4.0 * np.max(record.position)
    found = fit_base(problem, model)
    true = problem.solve(found.model, np.array([shift]))
    assert found.chi2 < true.chi2 + 5.0


def test_a_damper_that_a_tool_meets_when_it_sets_out_from_a_rest_is_no_surface() -> None:
    """The body is pressed all along; its damping takes force as soon as the tool moves."""
    rng = np.random.default_rng(6)
    t = np.arange(12_000) * DT_S
    rise = np.clip(np.arange(400) / 400, 0.0, 1.0)
    rise = rise**3 * (10.0 - 15.0 * rise + 6.0 * rise**2)
    x = np.full(t.size, 3.3e-4)
    for first in range(500, 10_000, 1400):
        press = np.concatenate((rise, np.ones(200), rise[::-1]))
        x[first : first + 1000] += 1.4e-3 * rng.uniform(0.3, 1.0) * press
        x[first + 1000 : first + 1400] += np.linspace(-6e-6, 6e-6, 400)  # the servo creeps
    force = 13_000.0 * x * (1.0 + 1.5 * np.gradient(x, DT_S))
    force += 0.05 * rng.standard_normal(t.size)
    found = onset(np.round((x + SURFACE_M) / 3e-6) * 3e-6, force, DT_S)
    assert found is None or not found.clear


def test_where_the_surface_is_free_a_play_has_no_flank_to_be_counted_from() -> None:
    """Each flank is the same play with its surface elsewhere; which one is named was chance."""
    t = np.arange(400) * 1e-3
    recording = from_arrays("any", t, 1e-3 * t, t)
    base = base_of("kelvin-voigt")
    for found, laws in ((False, 3), (True, 1)):
        left = applicable(LIBRARY, recording, replace(base, finds_surface=found))
        assert len([e for e in left if e.name == "backlash"]) == laws


def test_a_base_with_a_bias_has_no_friction_that_differs_by_direction() -> None:
    """While the tool moves such a friction is even friction and a bias: no data show its ratio."""
    t = np.arange(400) * 1e-3
    recording = from_arrays("any", t, 1e-3 * t, t)
    for terms, laws in (("spring,viscous,bias", 5), ("spring,viscous", 8)):
        left = applicable(LIBRARY, recording, base_of(terms))
        assert len([e for e in left if e.name == "coulomb_friction"]) == laws


def test_a_body_pressed_all_along_has_no_friction_that_differs_by_direction() -> None:
    """Its surface is not known, and moving it adds the same force as a bias."""
    t = np.arange(400) * 1e-3
    recording = from_arrays("any", t, 1e-3 * t, t)
    base = base_of("kelvin-voigt")
    for pressed, finds, possible in ((True, True, False), (True, False, True), (False, True, True)):
        model = replace(base, finds_surface=finds)
        left = applicable(LIBRARY, recording, model, pressed=pressed)
        assert any("by direction" in e.law for e in left) == possible


def test_a_surface_beyond_the_uncertainty_of_its_onset_is_found() -> None:
    # The force rises with the square of the depth, and is noise in the first third of the travel:
    # the onset is guessed 0.76 mm deep in the body, give or take 0.48 mm.
    record = foreign(1862021003, ("quadratic_damping",))
    rivals = {"quadratic_damping", "viscous_friction", "direction_dependent_damping"}
    laws = tuple(law for law in LIBRARY if law.name in rivals)
    recording = from_arrays("record", record.t, record.position, record.force)
    found = diagnose(recording, record.base, effects=laws)
    assert found.answer["class"] == [["quadratic_damping"]]
    surface = found.problem.surface - found.best.model.shift(found.best.zeta)
    assert surface == pytest.approx(0.0, abs=1e-4)


_LAWS_OF_LOSS = ["permanent_set", "softening", "stress_relaxation", "mullins_softening"]


@pytest.mark.parametrize("names", cases(_LAWS_OF_LOSS[:2], _LAWS_OF_LOSS))
def test_a_surface_beyond_its_bound_is_sought_where_nothing_is_named_yet(names: list[str]) -> None:
    """A body that keeps most of each dent is met deeper each time, and the onset guessed deep."""
    dt_s = 2e-3
    t = dt_s * np.arange(8000)
    position = 5e-3 - 3e-3 * np.cos(2.0 * np.pi * (0.2 + 0.072 * t) * t)
    depth = position - 4e-3
    left = depth - 0.6 * np.maximum.accumulate(np.maximum(depth, 0.0))
    force = np.maximum(1250.0 * left + 12.0 * np.gradient(position, dt_s), 0.0) * (left > 0.0)
    noise = lfilter([1.0], [1.0, -0.95], np.random.default_rng(0).standard_normal(t.size))
    recording = from_arrays("dented", t, position, force + 0.015 * noise)
    laws = tuple(law for law in LIBRARY if law.name in names)
    assert diagnose(recording, effects=laws).answer["class"] == [["permanent_set"]]


@pytest.mark.parametrize("zero", [1e-3, -2e-3])
def test_the_zero_of_an_encoder_inside_the_travel_is_no_surface(zero: float) -> None:
    """A tissue that the tool never leaves, met 1 mm before the nearest position (Fung's law)."""
    dt = 0.002
    t = dt * np.arange(6000)
    sway = 2.4 * np.sin(2.1 * t) + 1.1 * np.sin(5.3 * t + 1.0) + 0.4 * np.sin(14.0 * t + 2.0)
    depth = 1e-3 * (1.0 + sway - np.min(sway))
    force = 310.0 / 300.0 * np.expm1(300.0 * depth) + 8.0 * np.gradient(depth, dt)
    noise = 0.03 * np.random.default_rng(14).standard_normal(t.size)
    answer = diagnose(from_arrays("tissue", t, depth - 1e-3 - zero, force + noise)).answer
    assert answer["class"] == [["nonlinear_stiffening"]]


def test_a_stated_surface_that_is_off_is_an_offset_beside_a_relaxation() -> None:
    """A surface that settles at once is the same one, elsewhere."""
    dt, rng = 0.002, np.random.default_rng(48)
    t = dt * np.arange(6000)
    x = 2.2e-3 * np.sin(1.9 * t - 1.0) + 1.1e-3 * np.sin(4.7 * t) + 6e-4 * np.sin(11.0 * t)
    depth = np.maximum(x, 0.0)
    arm = np.zeros(t.size)  # of 420 N/m, relaxing within 0.3 s
    for i in range(1, t.size):
        way = depth[i] - depth[i - 1]
        arm[i] = (arm[i - 1] + 420.0 * way) * np.exp(-dt / 0.3)
    force = np.where(x > 0.0, 2200.0 * x + 6.0 * np.gradient(x, dt) + arm, 0.0)
    read = 2e-6 * np.round(x / 2e-6)
    recording = from_arrays("deep", t, read, force + 0.05 * rng.standard_normal(t.size))
    answer = diagnose(recording, surface=3.5e-4).answer
    assert [sorted(names) for names in answer["class"]] == [["contact_offset", "stress_relaxation"]]
    found = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    assert found["shift"] == pytest.approx(3.5e-4, rel=0.05)
    assert found["arm_stiffness"] == pytest.approx(420.0, rel=0.05)
