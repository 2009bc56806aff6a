from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy

from teleop_rt.contact.effect import MOST_SHAPES
from teleop_rt.contact.effects import LIBRARY, NAMES, find
from teleop_rt.contact.effects.user import EffectError, load_file
from teleop_rt.diagnosis.answers.answer import effect_entry
from teleop_rt.diagnosis.answers.extended import ExtendedModelError, read, write
from teleop_rt.diagnosis.models.in_series import Joint, SpringDamper, press_in_series
from teleop_rt.diagnosis.models.simulate import run_step
from teleop_rt.view.style import effect_in_words

VOCABULARY = {
    "contact_offset": ("environment", "kinematics"),
    "moving_surface": ("environment", "kinematics"),
    "permanent_set": ("environment", "material"),
    "series_compliance": ("rig", "kinematics"),
    "backlash": ("rig", "kinematics"),
    "channel_delay": ("rig", "kinematics"),
    "stress_relaxation": ("environment", "material"),
    "fractional_relaxation": ("environment", "material"),
    "nonlinear_stiffening": ("environment", "material"),
    "second_layer": ("environment", "material"),
    "preload": ("environment", "material"),
    "hysteresis": ("environment", "material"),
    "mullins_softening": ("environment", "material"),
    "softening": ("environment", "material"),
    "hunt_crossley": ("environment", "material"),
    "quadratic_damping": ("environment", "material"),
    "adhesion": ("environment", "material"),
    "coulomb_friction": ("rig", "tool"),
    "stribeck_friction": ("rig", "tool"),
    "viscous_friction": ("rig", "tool"),
    "direction_dependent_damping": ("rig", "tool"),
    "gravity_torque": ("rig", "tool"),
    "return_spring": ("rig", "tool"),
    "tool_inertia": ("rig", "tool"),
    "position_ripple": ("rig", "tool"),
    "force_bias": ("rig", "sensor"),
    "force_drift": ("rig", "sensor"),
    "periodic_disturbance": ("rig", "sensor"),
    "force_lag": ("rig", "sensor"),
    "gain_drift": ("rig", "sensor"),
    "charge_leak": ("rig", "sensor"),
    "force_saturation": ("rig", "sensor"),
    "outliers": ("rig", "sensor"),
}
DRAG = {("quadratic_damping", "in air and contact"): ("rig", "tool")}
DT = 1e-3
T = DT * np.arange(4000)
X = 0.006 - 0.010 * np.cos(2 * np.pi * 1.3 * T)
V = np.gradient(X, DT)


def run(name: str, eta: list[float], law: str = "", x: np.ndarray = X) -> np.ndarray:
    v = np.gradient(x, DT)
    return run_step(find(name, law), x, v, np.gradient(v, DT), T, DT, np.array(eta or [0.0]))


def test_the_library_is_the_vocabulary() -> None:
    assert set(NAMES) == set(VOCABULARY)
    for effect in LIBRARY:
        place = (effect.belongs_to, effect.stage)
        assert place in {VOCABULARY[effect.name], DRAG.get((effect.name, effect.law))}


@pytest.mark.parametrize("effect", LIBRARY, ids=lambda e: f"{e.name} {e.law}".strip())
def test_every_step_stays_finite_over_its_whole_range_of_shapes(effect: object) -> None:
    travel = {"travel": 0.016, "speed": 0.08, "duration": 4.0, "compliance": 1e-3, "force": 40.0}
    for edge in ("lower", "start", "upper"):
        eta = np.array([getattr(s, edge) * travel.get(s.relative_to, 1.0) for s in effect.shapes])
        value = run_step(effect, X, V, np.gradient(V, DT), T, DT, eta if eta.size else np.zeros(1))
        assert np.all(np.isfinite(value))


def test_a_sentence_names_only_parameters_of_its_effect() -> None:
    for effect in LIBRARY:
        names = {s.name for s in effect.shapes} | {effect.amplitude.name}
        effect.sentence.format(**dict.fromkeys(names, "1"))


def test_a_message_has_room_for_the_shapes_of_every_effect() -> None:
    assert max(len(effect.shapes) for effect in LIBRARY) <= MOST_SHAPES


def test_a_maxwell_arm_relaxes_with_its_time_constant() -> None:
    step = np.where(T < 0.1, 0.0, 0.01)
    force = run("stress_relaxation", [0.5], "one arm", step)
    held = T > 0.2
    np.testing.assert_allclose(
        force[held] / force[200], np.exp(-(T[held] - T[200]) / 0.5), rtol=2e-3
    )


def test_a_springpot_relaxes_with_a_power_of_time() -> None:
    step = np.where(T < 0.1, 0.0, 0.01)
    force = run("fractional_relaxation", [0.3], "", step)
    late = (T > 0.2) & (T < 3.0)
    slope = np.polyfit(np.log(T[late] - 0.1), np.log(force[late]), 1)[0]
    assert slope == pytest.approx(-0.3, abs=0.02)


def test_a_play_moves_the_tip_within_its_gap_only() -> None:
    lag = run("backlash", [0.001], "centred")
    assert np.max(np.abs(lag)) == pytest.approx(0.0005)
    forward = (V > 0.01) & (T > 1.0) & (X > 0.0)
    np.testing.assert_allclose(lag[forward], -0.0005, atol=1e-9)


def test_sliders_hold_what_each_has_stretched_and_turn_over_after_twice_their_travel() -> None:
    """Masing: an unloading follows the first loading, stretched twice."""
    travels = 1e-3 * 16.0 ** -np.linspace(0.0, 1.0, 6)
    depth = np.concatenate([np.linspace(0.0, 2e-3, 400), np.linspace(2e-3, 1e-4, 400)])
    held = run("hysteresis", [1e-3, 16.0], "sliders", x=depth)

    def first(moved: np.ndarray) -> np.ndarray:
        return np.minimum(moved[:, None], travels).sum(axis=1) / travels.sum()

    np.testing.assert_allclose(held[:400], first(depth[:400]), atol=1e-9)
    back = 2.0 * first(0.5 * (2e-3 - depth[400:]))
    np.testing.assert_allclose(held[400:], 1.0 - back, atol=1e-9)


def test_presliding_friction_holds_its_force_at_rest() -> None:
    x = np.where(T < 1.0, 0.01 * T, 0.01)
    force = run("coulomb_friction", [5e-5], "presliding", x)
    assert force[900] == pytest.approx(1.0, abs=1e-6)
    assert force[-1] == pytest.approx(1.0, abs=1e-3)


def test_a_slow_channel_has_the_gain_and_phase_of_a_first_order_filter() -> None:
    tone = np.sin(2 * np.pi * 10.0 * T)
    late = T >= 2.0
    out = run_step(find("force_lag", "first order"), tone, tone, tone, T, DT, np.array([10.0]))
    answer = 2 * np.mean(out[late] * np.exp(-2j * np.pi * 10.0 * T[late]))
    assert abs(answer) == pytest.approx(1 / np.sqrt(2), rel=2e-3)
    assert np.angle(answer) + np.pi / 2 == pytest.approx(-np.pi / 4, abs=5e-3)


def test_a_slow_channel_of_second_order_answers_as_scipy_says() -> None:
    tone = np.sin(2 * np.pi * 7.0 * T) + np.minimum(T, 0.5)
    natural, damping = 2 * np.pi * 12.0, 0.8
    _, expected, _ = scipy.signal.lsim(
        ([natural**2], [1.0, 2 * damping * natural, natural**2]), tone, T
    )
    out = run_step(find("force_lag", "second order"), tone, tone, tone, T, DT,
                   np.array([12.0, damping]))  # fmt: skip
    assert out == pytest.approx(expected, abs=1e-9)


def test_a_compliance_in_series_makes_springs_add_as_springs_do() -> None:
    spring, joint = SpringDamper(2000.0, 1.0, 1e-9, 0.0), Joint(1 / 8000.0, np.inf)
    force = press_in_series(X, V, spring, joint, DT, clamped=False)[0]
    np.testing.assert_allclose(force, 1600.0 * np.maximum(X, 0.0), atol=1e-6)


USER_FILE = """
from teleop_rt.contact.effect import Amplitude, Effect, Shape
from teleop_rt.kernels.jit import kernel


@kernel
def cubic(state, x, v, a, t, dt, eta):
    return max(x - eta[0], 0.0) ** 3


EFFECTS = (
    Effect(
        name="buried_grain", family="stiffening", belongs_to="environment", stage="material",
        amplitude=Amplitude("grain", "{f}/{x}^3", nonnegative=True),
        shapes=(Shape("depth", "{x}", 0.1, 0.9, 0.5, relative_to="travel"),),
        step=cubic, sentence="A grain lies {depth} deep.", compensation="render",
    ),
)
"""


def test_a_user_adds_an_effect_by_one_declaration(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(USER_FILE)
    (effect,) = load_file(path)
    value = run_step(effect, X, V, V, T, DT, np.array([0.01]))
    np.testing.assert_allclose(value, np.maximum(X - 0.01, 0.0) ** 3, rtol=1e-12)


STEP_OF_A_FILE = """
import os
import sys
from pathlib import Path
from teleop_rt.contact.effects.user import load_file
from teleop_rt.diagnosis.models.simulate import run_step
import numpy as np

def value(path):
    (effect,) = load_file(path)
    row = np.full(1, 3.0)
    return run_step(effect, row, row, row, row, 1e-3, np.array([1.0]))[0]

path = Path(sys.argv[1])
cubed = value(path)
stamp = path.stat().st_mtime_ns
path.write_text(path.read_text().replace("** 3", "** 2"))
os.utime(path, ns=(stamp, stamp))  # the clock of a file system may stand still for a whole second
print(cubed, value(path), file=sys.stdout)
path.write_text(path.read_text().replace("** 2", "** 3"))
os.utime(path, ns=(stamp, stamp))
"""


def test_a_user_file_is_used_again_by_another_process_and_after_a_change(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(USER_FILE)
    command = [sys.executable, "-c", STEP_OF_A_FILE, path]
    caching = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    for _ in range(2):
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=caching)
        assert done.stdout.split() == ["8.0", "4.0"], done.stderr


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("EFFECTS = ()", "write EFFECTS = "),
        ("EFFECTS = (3,)", "contains int: write Effect"),
        ("import nothing_like_this", "ModuleNotFoundError"),
        (USER_FILE.replace("buried_grain", "hysteresis").replace("family", "law='plain', family"),
         "exists"),
        (USER_FILE + "EFFECTS *= 2", "exists"),
        (USER_FILE.replace("shapes=(", "shapes=17 * ("), "has 17 shapes: declare at most 16"),
        (USER_FILE.replace('"stiffening"', '"stiffness"'), "family is 'stiffness': take .*'adhes"),
        (USER_FILE.replace('"environment"', '"body"'), "belongs_to is 'body'"),
        (USER_FILE.replace('"material"', '"matter"'), "stage is 'matter'"),
        (USER_FILE.replace('"render"', '"renders"'), "compensation is 'renders'"),
        (USER_FILE.replace('"travel"', '"depth"'), "relative_to of depth is 'depth'"),
        (USER_FILE.replace("{depth} deep", "{dept} deep"), "name only {grain}, {depth}"),
        (USER_FILE.replace("{depth} deep", "{depth:.2f} deep"), "without a format"),
        (USER_FILE.replace("max(x - eta[0], 0.0) ** 3", "1.0 / (x - 1e-3)"), "return a finite"),
        (USER_FILE.replace("eta[0]", "eta[1]"), "beyond its arrays .*size 1.*one of each shape, 1"),
        (USER_FILE.replace("return", "state[0] += x * dt; return"), "state_size=0 values"),
        (USER_FILE.replace("return", "if v < 0.0: return eta[2]\n    return"), "size 1"),
    ],
)  # fmt: skip
def test_a_user_file_that_cannot_be_used_is_refused(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "mine.py"
    path.write_text(text)
    with pytest.raises(EffectError, match=message):
        load_file(path)


def test_a_step_that_is_no_kernel_yet_is_compiled(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(USER_FILE.replace("@kernel\n", ""))
    (effect,) = load_file(path)
    row = np.full(1, 3.0)
    assert run_step(effect, row, row, row, row, 1e-3, np.array([1.0]))[0] == 8.0


def answer_with(parameters: dict[str, float]) -> dict[str, object]:
    return {
        "base": {
            "model": "kelvin-voigt",
            "parameters": {"k": {"value": 3600.0}},
            "clamped": False,
            "clamped_with_effects": False,
            "clamped_without_damping": False,
        },
        "effects": [
            {
                "name": "coulomb_friction",
                "law": "presliding",
                "belongs_to": "rig",
                "compensation": "subtract_force",
                "parameters": {k: {"value": v} for k, v in parameters.items()},
            }
        ],
    }


def test_an_extended_model_survives_its_file(tmp_path: Path) -> None:
    path = tmp_path / "model.yaml"
    write(path, answer_with({"friction_force": 2.5, "presliding_travel": 4e-5}))
    (fitted,) = read(path)
    assert (fitted.effect.name, fitted.effect.law) == ("coulomb_friction", "presliding")
    assert (fitted.amplitude, list(fitted.eta)) == (2.5, [4e-5])


def test_an_extended_model_without_a_shape_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.yaml"
    write(path, answer_with({"friction_force": 2.5}))
    with pytest.raises(ExtendedModelError, match="presliding_travel"):
        read(path)


@pytest.mark.parametrize("bias", [8.031, -8.031])
def test_a_bias_of_either_sign_reads_as_what_the_sensor_shows(bias):
    effect = find("force_bias")
    shown = {"bias": {"value": bias, "std": None, "unit": "N"}}
    words = effect_in_words({"template": effect.sentence, "parameters": shown})
    assert words == f"The force sensor reads {bias:.4g} N where the force is zero."


@pytest.mark.parametrize(
    ("name", "law", "words"),
    [
        ("moving_surface", "steady", "The surface comes nearer at 0.002 m/s."),
        ("contact_offset", "", "The surface lies 0.002 m farther than assumed."),
        ("softening", "", "Within unknown the stiffness rises by 0.002 N/m."),
    ],
)
def test_the_sentence_of_a_negative_amplitude_says_so_in_words(
    name: str, law: str, words: str
) -> None:
    effect = next(e for e in LIBRARY if (e.name, e.law) == (name, law))
    unit = effect.amplitude.unit.format(x="m", f="N")
    parameters = {shape.name: {"value": None, "std": None, "unit": "s"} for shape in effect.shapes}
    parameters[effect.amplitude.name] = {"value": -0.002, "std": 1e-5, "unit": unit}
    found = effect_entry(effect, parameters)
    assert found["sentence"] == words
    shown = effect_in_words(found).replace("–", "unknown")
    assert shown.replace("2 mm", "0.002 m") == words


def test_the_sentence_of_an_answer_has_the_figures_and_its_template_the_names() -> None:
    effect = find("second_layer")
    shown = {
        "layer_stiffness": {"value": 1234.56, "std": None, "unit": "N/m"},
        "depth": {"value": None, "std": None, "unit": "m"},
    }
    found = effect_entry(effect, shown)
    assert found["sentence"] == "Below unknown a second layer adds 1235 N/m."
    assert found["template"] == effect.sentence
