"""The public Python interface: its names, its answers, its errors, and its memory."""

import ast
import dataclasses
import doctest
import gc
import importlib
import inspect
import json
import re
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import teleop_rt
from teleop_rt.diagnosis.answers import extended
from teleop_rt.offline.replay import Choice, online_of_recording

PAGE = Path(__file__).parents[2] / "docs" / "python.md"
RATE_HZ = 250.0


def press(duration_s=3.0, stiffness=1500.0, cubic=0.0, seed=1, surface=0.0, rate_hz=RATE_HZ):
    """Time, position and force of a spring and a damper that may stiffen with the cube."""
    t = np.arange(0.0, duration_s, 1.0 / rate_hz)
    x = 0.004 - 0.008 * np.cos(2.0 * np.pi * 1.5 * t) + 0.001 * np.sin(2.0 * np.pi * 4.1 * t)
    force = np.where(x > 0.0, stiffness * x + cubic * x**3 + 8.0 * np.gradient(x, t), 0.0)
    return t, x + surface, force + np.random.default_rng(seed).normal(0.0, 0.02, t.size)


@pytest.fixture(scope="module")
def diagnosed():
    recording = teleop_rt.from_arrays(*press(cubic=4e7))
    return recording, teleop_rt.diagnose(recording)


def test_importing_the_package_loads_nothing_heavy():
    code = "import sys, teleop_rt; dir(teleop_rt); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "teleop_rt" in loaded
    assert loaded.isdisjoint({"numpy", "numba", "scipy", "pydantic", "teleop_rt.api"})


def test_checkers_see_the_very_names_that_are_loaded():
    tree = ast.parse(Path(teleop_rt.__file__).read_text())
    (checked,) = (
        node for node in tree.body
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name)
    )  # fmt: skip
    seen = {
        (alias.name, statement.module)
        for statement in checked.body if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }  # fmt: skip
    assert {name for name, _ in seen} == set(teleop_rt.__all__) <= set(dir(teleop_rt))
    for name, module in seen:
        assert getattr(teleop_rt, name) is getattr(importlib.import_module(module), name)
    with pytest.raises(AttributeError, match="no attribute 'diagnoze'"):
        _ = teleop_rt.diagnoze


@pytest.mark.parametrize("name", [n for n in teleop_rt.__all__ if n != "ExpectedError"])
def test_every_name_has_a_short_signature_and_a_docstring(name):
    public = getattr(teleop_rt, name)
    assert inspect.getdoc(public)
    if name != "Recording":  # made by read and from_arrays alone
        assert len(str(inspect.signature(public))) <= 120


def test_every_answer_has_a_short_repr(diagnosed):
    recording, diagnosis = diagnosed
    found = teleop_rt.identify(recording, "kelvin-voigt")
    shown = [recording, diagnosis, diagnosis.model, *diagnosis.effects, found, *found.estimates]
    assert all(len(repr(one)) < 250 and "\n" not in repr(one) for one in shown)
    assert repr(recording) == "<Recording arrays: 3 s, 750 samples at 250 Hz, in m and N>"
    assert repr(teleop_rt.Parameter(2.0, None, "N/m", identified=False)) == (
        "2 N/m (not identified)"
    )


def test_identify_gives_what_replay_prints_of_the_same_file(call, tmp_path):
    t, x, force = press(surface=0.02)
    np.savez(tmp_path / "a.npz", t_s=t, position_m=x, force_N=force)
    answer = json.loads(call("replay", "a.npz", "--json")[1])
    for source in ("a.npz", teleop_rt.read("a.npz")):
        found = teleop_rt.identify(source)
        assert len(found.estimates) == len(answer["estimators"])
        for one, row in zip(found.estimates, answer["estimators"], strict=True):
            result = {name: (p.value, p.std, p.unit) for name, p in one.parameters.items()}
            printed = {n: (p["value"], p["std"], p["unit"]) for n, p in row["parameters"].items()}
            assert result == printed
            assert (one.nrmse, one.status) == (row["nrmse"], row["status"])


def test_an_estimate_has_its_parameters_over_time():
    recording = teleop_rt.from_arrays(*press(), surface=0.0)
    found = teleop_rt.identify(recording, "kelvin-voigt", regressions="direct", solvers="rls")
    (one,) = found.estimates
    assert found["kelvin-voigt"] is found["kelvin-voigt", "direct", "rls"] is one
    assert one.trace("k").shape == found.time_s.shape == recording.position.shape
    assert one.trace("k")[-1] == pytest.approx(one.parameters["k"].value, rel=1e-12)
    assert one.parameters["k"].value == pytest.approx(1500.0, rel=0.05)
    assert one.parameters["k"].std < 75.0
    with pytest.raises(KeyError, match="has k, b"):
        one.trace("m")
    with pytest.raises(KeyError, match="models: kelvin-voigt"):
        _ = found["mass"]


def test_rotary_units_are_those_of_every_answer():
    t, x, force = press()
    recording = teleop_rt.from_arrays(t, x, force, ("rad", "Nm"), surface=0.0)
    found = teleop_rt.identify(recording, "kelvin-voigt", solvers="rls")
    assert found.estimates[0].parameters["b"].unit == "Nm s/rad"
    one = teleop_rt.Estimator("kelvin-voigt", 4e-3, 0.02, 1e-6, surface=0.0, units=("rad", "Nm"))
    one.update(0.001, 1.0)
    assert one.parameters["k"].unit == "Nm/rad"


def test_a_notebook_shows_tables_in_which_every_text_is_escaped(diagnosed):
    recording, diagnosis = diagnosed
    strange = dataclasses.replace(recording, name="<b>a & b</b>")
    shown = teleop_rt.identify(strange, "kelvin-voigt")._repr_html_()
    assert "&lt;b&gt;a &amp; b&lt;/b&gt;" in shown
    assert "<b>" not in shown
    assert shown.count("<tr>") == 7
    assert "nonlinear stiffening" in diagnosis._repr_html_()


def test_a_diagnosis_names_the_effect_and_its_model_predicts_another_motion(diagnosed):
    recording, diagnosis = diagnosed
    assert diagnosis.verdict == "named"
    assert [one.name for one in diagnosis.effects] == ["nonlinear_stiffening"]
    assert diagnosis.parameters["k"].value == pytest.approx(1500.0, rel=0.02)
    assert diagnosis.nrmse_after < 0.1 * diagnosis.nrmse_before
    # The fit itself has no public name: its model has.
    own = diagnosis._found.best.force_on(diagnosis._found.problem.motion)
    assert teleop_rt.predict(diagnosis.model, recording) == pytest.approx(own, abs=1e-9)
    t, x, force = press(cubic=4e7, seed=2)
    other = teleop_rt.from_arrays(t, 0.8 * x, np.where(x > 0.0, 1.0, 0.0) + force)
    wanted = np.where(x > 0.0, 1500 * 0.8 * x + 4e7 * (0.8 * x) ** 3, 0.0)
    wanted += np.where(x > 0.0, 8.0 * np.gradient(0.8 * x, t), 0.0)
    error = teleop_rt.predict(diagnosis.model, dataclasses.replace(other, surface=0.0)) - wanted
    inner = slice(20, -20)
    assert np.sqrt(np.mean(error[inner] ** 2)) < 0.01 * np.ptp(wanted)


@pytest.mark.parametrize("place", ["taken", "taken/below"])
def test_a_diagnosis_is_not_written_into_a_file(diagnosed, tmp_path, place):
    (tmp_path / "taken").write_text("")
    with pytest.raises(teleop_rt.ExpectedError, match="taken: is a file: name another folder"):
        diagnosed[1].write(tmp_path / place)


def test_a_model_written_and_read_predicts_the_same(diagnosed, tmp_path, monkeypatch):
    recording, diagnosis = diagnosed
    monkeypatch.setitem(sys.modules, "teleop_rt.view.diagnosis_page", None)  # no page: seconds less
    diagnosis.write(tmp_path / "out")
    model = teleop_rt.read_model(tmp_path / "out" / "model.yaml")
    assert model.clamped == diagnosis.model.clamped
    expected = teleop_rt.predict(diagnosis.model, recording)
    assert np.array_equal(teleop_rt.predict(model, recording), expected)
    kinds = {False: (), True: ("",), "with effects": ("", "_with_effects"),
             "without damping": ("", "_with_effects", "_without_damping")}  # fmt: skip
    for clamped, true in kinds.items():
        keys = {f"clamped{key}": key in true for key in kinds["without damping"]}
        answer = dict(diagnosis.answer) | {"base": diagnosis.answer["base"] | keys}
        extended.write(tmp_path / "other.yaml", answer)
        assert teleop_rt.read_model(tmp_path / "other.yaml").clamped == clamped


def test_a_step_by_step_estimator_ends_where_the_replay_ends():
    t, x, force = press(6.0, surface=0.02, rate_hz=1000.0)
    recording = teleop_rt.from_arrays(t, x, force, surface=0.02)
    settings = online_of_recording(recording, Choice()).settings
    for model, solver in (("kelvin-voigt", "rls"), ("hunt-crossley", "iec")):
        replayed = teleop_rt.identify(recording, model, regressions="direct", solvers=solver)
        one = teleop_rt.Estimator(
            model, recording.dt, settings.force_noise, settings.position_resolution,
            surface=0.02, solver=solver,
        )  # fmt: skip
        assert np.all(np.isnan(one.update(0.0, 0.0)))
        one.reset()
        for sample in zip(x, force, strict=True):
            values = one.update(*sample)
        result = replayed.estimates[0].parameters
        assert values == pytest.approx([result[name].value for name in one.names], rel=1e-9)
        assert one.surface == 0.02
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0


def test_a_step_by_step_estimator_finds_the_surface_and_survives_missing_samples():
    _, x, force = press(6.0, surface=0.02)
    one = teleop_rt.Estimator("kelvin-voigt", 1.0 / RATE_HZ, 0.02, 1e-6)
    assert (one.surface, one.in_contact, one.status) == (None, False, "warming up")
    force[700] = np.nan
    for sample in zip(x, force, strict=True):
        values = one.update(*sample)
    assert one.surface == pytest.approx(0.02, abs=2e-4)
    assert values == pytest.approx([1500.0, 8.0], rel=0.1)


def test_a_step_by_step_estimator_leaves_nothing_behind():
    _, x, force = press()
    samples = list(zip(x.tolist(), force.tolist(), strict=True))
    one = teleop_rt.Estimator("kelvin-voigt", 1.0 / RATE_HZ, 0.02, 1e-6)
    for sample in samples:
        one.update(*sample)
    gc.collect()
    seldom = gc.get_threshold()
    gc.set_threshold(700)  # as in a user's program
    tracemalloc.start()
    one.update(*samples[0])
    before, collected = tracemalloc.get_traced_memory()[0], gc.get_stats()[0]["collections"]
    for _ in range(10):
        for sample in samples:
            one.update(*sample)
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    gc.set_threshold(*seldom)
    assert gc.get_stats()[0]["collections"] == collected
    assert after - before < 1024  # bytes, over 7500 calls


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": np.zeros((750, 2))}, r"position: has the shape \(750, 2\)"),
        ({"force": 3.0}, r"force: has the shape \(\)"),
        ({"force": ["a"] * 750}, "force: not an array of numbers"),
        ({"force": np.zeros(750, complex)}, "force: complex numbers"),
        ({"force": np.zeros(700)}, "columns of different length"),
        ({"force": np.full(750, np.nan)}, "of 750 samples 750 of force are not a number"),
        ({"time_s": np.arange(750)[::-1] * 4e-3}, "time does not increase at sample 1"),
        ({"time_s": np.arange(750) * 4.0}, "wrong unit"),
        ({"position": 1e3 * press()[1] * 1e3}, "wrong unit"),
        ({"units": ("mm", "N")}, r"give \('m', 'N'\) or \('rad', 'Nm'\)"),
        ({"force": np.zeros(750)}, "the force is constant"),
    ],
    ids=lambda value: value if isinstance(value, str) else next(iter(value)),
)
def test_arrays_that_cannot_be_are_refused_with_the_cause(change, message):
    names = ("time_s", "position", "force")
    arrays = dict(zip(names, press(), strict=True)) | change
    with pytest.raises(teleop_rt.ExpectedError, match=message):
        teleop_rt.from_arrays(**arrays)


def test_a_message_that_names_an_option_says_what_a_python_caller_does(tmp_path):
    time, position, force = press()
    with pytest.raises(teleop_rt.ExpectedError, match=r"--units.*; from_arrays takes arrays as"):
        teleop_rt.from_arrays(time, 1e3 * position, force)
    with pytest.raises(teleop_rt.ExpectedError) as raised:
        teleop_rt.from_arrays(time[:9], position[:9], force[:9])
    assert "from_arrays takes" not in str(raised.value)
    table = tmp_path / "a.csv"
    table.write_text(
        "t_s,a,b\n" + "".join(f"{t},{x},{f}\n" for t, x, f in zip(*press(), strict=True))
    )
    with pytest.raises(teleop_rt.ExpectedError, match=r"--columns.*; in Python .* arguments colum"):
        teleop_rt.read(table)


def test_names_and_files_that_are_unknown_are_refused_alike(tmp_path):
    recording = teleop_rt.from_arrays(*press())
    for refused in (
        lambda: teleop_rt.identify(recording, "maxwell"),
        lambda: teleop_rt.diagnose(recording, "maxwell"),
        lambda: teleop_rt.Estimator("maxwell", 1e-3, 0.01, 1e-6),
        lambda: teleop_rt.Estimator("kelvin-voigt", 0.0, 0.01, 1e-6),
        lambda: teleop_rt.read(tmp_path / "none.csv"),
        lambda: teleop_rt.read_model(tmp_path / "none.yaml"),
    ):
        with pytest.raises(teleop_rt.ExpectedError):
            refused()


def test_the_page_and_the_docstrings_do_what_they_say(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    examples = "\n".join(re.findall(r"```pycon\n(.*?)```", PAGE.read_text(), re.DOTALL))
    tests = [parser.get_doctest(examples, {}, "python.md", str(PAGE), 0)]
    for name in teleop_rt.__all__:
        public = getattr(teleop_rt, name)
        tests += doctest.DocTestFinder(recurse=False).find(public, name)
    for test in tests:
        runner.run(test)
    assert runner.failures == 0
    assert runner.tries > 20
