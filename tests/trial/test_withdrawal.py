"""An extended model that makes an error worse on fresh data is withdrawn, with a word."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.offline import closing
from teleop_rt.offline.on_line_error import cause_of_error
from teleop_rt.offline.withdrawal import keep_or_withdraw, made_worse
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.signals import SLAVE, SLAVE_TOPIC


def fresh(free_run=(0.08, 0.01), on_line=(0.08, 0.01), felt=(0.07, 0.01), floor=0.002):
    def pair(errors):
        return dict(zip(("before", "after"), errors, strict=True))

    slave = {"free_run": pair(free_run) | {"noise_floor": floor}, "on_line": pair(on_line)}
    return {"slave": slave, "master": pair(felt)}


def write(path, t, measured, predicted):
    """Write a run's recording with these forces."""
    writer = RecordingWriter(path, Units(position="m", force="N"))
    writer.add_topic(SLAVE_TOPIC, SLAVE)
    rows = np.zeros((t.size, len(SLAVE)))
    names = [signal.name for signal in SLAVE]
    for name, values in (
        ("stamp_ns", 1e9 * t), ("filtered_force", measured), ("predicted_force", predicted)
    ):  # fmt: skip
        rows[:, names.index(name)] = values
    writer.write_rows(SLAVE_TOPIC, rows)
    writer.close()


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        ({}, []),
        ({"felt": (0.0018, 0.0066)}, ["felt at the hand, 0.0018 before, is 0.0066 after"]),
        ({"on_line": (0.03, 0.05)}, ["predicted on-line, 0.0300 before, is 0.0500 after"]),
        ({"free_run": (0.03, 0.05), "felt": (0.03, 0.05)}, ["in free run", "felt at the hand"]),
        ({"felt": (0.0005, 0.0015)}, []),
        ({"felt": (0.05, 0.053)}, []),
        ({"felt": (0.05, None)}, ["felt at the hand, 0.0500 before, is unknown after"]),
        ({"on_line": (0.3, None)}, ["0.3000 before, with the effects no estimate predicts it"]),
        ({"free_run": (0.3, None)}, ["0.3000 before, with the effects it cannot be predicted"]),
        ({"felt": (None, None)}, []),
        ({"felt": (0.0005, 0.0015), "floor": None}, ["felt at the hand"]),
    ],
)
def test_what_an_extended_model_makes_worse_is_said(errors, words):
    found = made_worse(fresh(**errors))
    assert len(found) == len(words)
    assert all(word in one for word, one in zip(words, found, strict=True))


def test_a_withdrawn_model_cannot_be_taken_by_its_name(tmp_path):
    model = tmp_path / "model.yaml"
    model.write_text("effects: []\n")
    kept = keep_or_withdraw(model, fresh())
    assert kept == {"extended_model": str(model), "withdrawn": None}
    assert model.is_file()
    gone = keep_or_withdraw(model, fresh(felt=(0.01, 0.02)))
    assert gone["extended_model"] is None
    assert "felt" in gone["reason"]
    assert [path.name for path in tmp_path.iterdir()] == ["withdrawn.yaml"]


def test_a_withdrawal_says_where_the_error_on_line_comes_from(tmp_path):
    model = tmp_path / "model.yaml"
    model.write_text("effects: []\n")
    why = "the compensation adds noise"
    gone = keep_or_withdraw(model, fresh(on_line=(0.03, 0.05), felt=(0.01, 0.02)), lambda: why)
    on_line, felt = gone["withdrawn"]
    assert on_line.endswith(f"is 0.0500 after ({why})")
    assert gone["reason"].startswith("the extended model increases errors on fresh data, so it is")
    assert on_line in gone["reason"]
    assert why not in felt


@pytest.mark.parametrize(
    ("early", "late", "noise", "words"),
    [
        (2.0, 0.0, 0.0, "increase occurs while the parameters settle: 2 N in the first half"),
        (0.0, 0.0, 0.5, "adds noise: .* 0.51 in the second .0.051., of which 0.5 is noise .0.05."),
        (0.5, 0.5, 0.0, "the error varies slowly, and remains after the parameters settle"),
    ],
)
def test_the_error_on_line_is_settling_noise_or_slow(tmp_path, early, late, noise, words):
    t, rng = np.arange(0.0, 10.0, 4e-3), np.random.default_rng(5)
    force = 20.0 + 10.0 * np.sin(2 * np.pi * 0.7 * t)
    slow = np.where(t < 5.0, early, late) * np.sin(2 * np.pi * 0.4 * t) * np.sqrt(2.0)
    white = rng.standard_normal(t.size)
    errors = {"before": 0.05 * white, "after": slow + np.hypot(0.05, noise) * white}
    for name, error in errors.items():
        write(tmp_path / name, t, force, force - error)
    assert re.search(words, cause_of_error(tmp_path / "before", tmp_path / "after", "N"))


def test_a_fresh_run_on_which_nothing_can_be_predicted_keeps_its_other_errors(monkeypatch):
    def refused(*_):
        raise RecordingError("recording.mcap: moving surface?")

    monkeypatch.setattr(closing, "load_any", refused)
    found = SimpleNamespace(diagnosed=SimpleNamespace(diagnosis=None))
    error = closing.in_free_run(Path("after"), found, None)
    assert (error["before"], error["after"]) == (None, None)
    assert error["reason"] == "recording.mcap: moving surface?"
    errors = fresh(on_line=(0.01, 0.08))
    errors["slave"]["free_run"] = error
    assert made_worse(errors) == ["force predicted on-line, 0.0100 before, is 0.0800 after"]
