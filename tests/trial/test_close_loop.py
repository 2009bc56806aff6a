"""From a run whose model lacks something to a fresh run with that added: close-loop."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from lean_install import without_pages
from mcap.reader import make_reader
from mcap.writer import Writer

from teleop_rt.config.yaml_file import ConfigError
from teleop_rt.contact.effects import LIBRARY, find
from teleop_rt.contact.fitted import ExtendedModelError
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.offline.load import load_any
from teleop_rt.offline.table import Table
from teleop_rt.realtime.reading import read_topics
from teleop_rt.trial.estimators import trial_extension
from teleop_rt_dev.trial.closed_loop import FOAM, closed, run_into
from teleop_rt_dev.trial.files import TRIALS, load

LAYER = TRIALS / "hidden_layer.yaml"
BIAS = "plant.undeclared=[{effect: force_bias, bias_N: 1.0}]"
SHORT = "duration_s=4.0"
FIRM = ("contact.onset_force_N=4.0", "contact.release_force_N=2.0")
OWN = Table({}, {}, None)
ALIKE = tuple(
    find(name)
    for name in ("stress_relaxation", "force_lag", "series_compliance", "nonlinear_stiffening",
                 "channel_delay", "force_bias")
)  # fmt: skip
"""Effects that a compliance resembles, and some that it does not; other tests name from all."""


@pytest.fixture(scope="module", autouse=True)
def no_page_of_a_diagnosis():
    """tests/trial/test_close_loop_command.py looks at the pages."""
    with without_pages():
        yield


@pytest.fixture(scope="module")
def foam(tmp_path_factory):
    out = tmp_path_factory.mktemp("foam")
    return out, closed(out, SHORT)


@pytest.fixture(scope="module")
def bias(tmp_path_factory):
    out = tmp_path_factory.mktemp("bias")
    return out, closed(out, BIAS, SHORT, *FIRM, library=ALIKE)


def test_the_layer_that_the_tutorials_trial_hides_is_named(tmp_path):
    run_into(tmp_path / "run", SHORT, file=LAYER)
    found = diagnose(load_any(tmp_path / "run" / "recording.mcap", OWN)).answer
    assert found["class"][0] == ["second_layer"]
    assert found["error"]["after"] < 0.3 * found["error"]["before"]


def test_a_hidden_effect_of_the_environment_is_found_estimated_and_felt(foam):
    out, answer = foam
    assert answer["experiment"] is None, "the first motion suffices"
    assert answer["verdict"] == "named"
    assert answer["class"] == [["nonlinear_stiffening"]]
    slave, master = answer["fresh"]["slave"], answer["fresh"]["master"]
    free_run = slave["free_run"]
    assert free_run["after_over_floor"] < 1.15
    smooth = free_run["std_normalised_low_passed"]
    assert smooth["after"] < 0.3 * smooth["before"]
    assert slave["on_line"]["after"] < 0.3 * slave["on_line"]["before"]
    assert master["after"] < 0.3 * master["before"]
    (handled,) = answer["fresh"]["handled"]
    assert handled["where"] == "rendered to the operator"
    model = yaml.safe_load((out / "model.yaml").read_text())
    assert model["effects"][0]["name"] == answer["effects"][0]["name"]


def test_what_the_first_motion_leaves_open_is_asked_of_the_one_that_is_proposed(tmp_path):
    """A compliance between sensor and tip is all but a slow sensor, whatever the motion."""
    compliance = "plant.undeclared=[{effect: series_compliance, compliance_m_per_N: 0.8e-4}]"
    answer = closed(tmp_path, SHORT, compliance, library=ALIKE)
    second = answer["experiment"]
    left_open = second["left_open"]
    proposed, moved = (
        yaml.safe_load((tmp_path / name).read_text())["operator"]
        for name in ("diagnosis/experiment.yaml", "experiment/trial.yaml")
    )
    assert proposed.items() <= moved.items()
    assert len(left_open) > 1
    assert ["series_compliance"] in answer["class"]
    assert all(names in left_open and names in second["class"] for names in answer["class"])
    assert answer["fitted_on"] in {"first", "experiment"}
    assert answer["fresh"]["slave"]["free_run"]["after_over_floor"] < 1.2


def test_the_fresh_trial_has_another_seed_and_another_motion(foam):
    out, _ = foam
    first, after = (
        yaml.safe_load((out / n / "trial.yaml").read_text()) for n in ("first", "after")
    )
    assert after["seed"] != first["seed"]
    assert after["operator"]["frequency_hz"] != first["operator"]["frequency_hz"]
    assert after["extended_model"]["effects"][0]["name"] == "nonlinear_stiffening"


def test_the_lamp_is_lit_without_the_effect_and_stays_dark_with_it(foam):
    out, _ = foam
    for name, expected in (("first", True), ("before", True), ("after", False)):
        summary = json.loads((out / name / "summary.json").read_text())
        assert summary["adequacy"]["inadequate"] is expected
        log = (out / name / "log.jsonl").read_text().splitlines()
        events = [json.loads(line)["event"] for line in log]
        assert ("model inadequate" in events) is expected
        assert any("model inadequate" in note for note in summary["notes"]) is expected
        flags = read_topics(out / name / "recording.mcap", ["/master"])["/master"]["inadequate"]
        assert bool(flags[-500:].any()) is expected


def test_a_surface_that_the_run_took_for_another_is_reported(foam):
    out, answer = foam
    run = out / answer["fitted_on"]
    true = json.loads((run / "truth.json").read_text())["environment"]["surface"]
    slave = read_topics(run / "recording.mcap", ["/slave"])["/slave"]
    online = slave["surface"][np.isfinite(slave["surface"])][-1]
    assert answer["base"]["parameters"]["surface"]["value"] == pytest.approx(true, abs=2e-5)
    assert answer["surface_shift"]["value"] == pytest.approx(online - true, abs=2e-5)


def test_a_hidden_effect_of_the_rig_is_found_compensated_and_not_felt(bias):
    out, answer = bias
    assert answer["class"] == [["force_bias"]]
    slave, master = answer["fresh"]["slave"], answer["fresh"]["master"]
    # In contact a bias is a surface elsewhere, so the model alone predicts as well; yet its surface
    # is wrong by the bias over the stiffness.
    assert slave["free_run"]["after_over_floor"] < 1.1
    true = json.loads((out / "first" / "truth.json").read_text())["environment"]["surface"]
    assert answer["base"]["parameters"]["surface"]["value"] == pytest.approx(true, abs=2e-5)
    assert slave["on_line"]["after"] < slave["on_line"]["before"]
    assert master["after"] <= master["before"]
    assert answer["fresh"]["handled"][0]["where"] == "kept from the operator"
    slave_rows = read_topics(out / "after" / "recording.mcap", ["/slave"])["/slave"]
    free = (slave_rows["in_contact"] == 0) & (slave_rows["tick"] > 200)
    assert np.median(slave_rows["force"][free]) == pytest.approx(1.0, abs=0.05)
    assert np.median(slave_rows["rig_force"][free]) == pytest.approx(1.0, abs=0.1)


def test_a_plant_that_hides_nothing_changes_nothing(tmp_path):
    answer = closed(tmp_path, "plant.undeclared=[]", SHORT)
    assert answer["verdict"] == "no_missing_effect"
    assert answer["effects"] == []
    assert answer["extended_model"] is None
    assert answer["fresh"] is None
    assert "no missing effect" in answer["reason"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["diagnosis", "first"]


def without_truth(source: Path, target: Path) -> None:
    """Copy a recording without the channels that only the plant may know."""
    with source.open("rb") as stream, target.open("wb") as sink:
        reader, writer = make_reader(stream), Writer(sink)
        writer.start()
        schemas, channels = {}, {}
        for schema, channel, message in reader.iter_messages():
            if channel.topic.startswith("/truth/"):
                continue
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time,
                message.sequence,
            )  # fmt: skip
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        writer.finish()


def test_diagnosis_does_not_look_at_the_truth(foam, tmp_path):
    out, _ = foam
    source = out / "first" / "recording.mcap"
    blind = tmp_path / "recording.mcap"
    without_truth(source, blind)
    assert read_topics(source, ["/truth/plant"])
    assert not read_topics(blind, ["/truth/plant"])
    answers = []
    for path in (source, blind):
        answer = diagnose(load_any(path, OWN), effects=(LIBRARY[4], LIBRARY[5])).answer
        del answer["seconds"]
        answers.append(json.dumps(answer))
    assert answers[0] == answers[1]


def test_what_the_plant_hides_is_not_in_the_trial_as_run(foam):
    out, _ = foam
    assert "undeclared" not in (out / "first" / "trial.yaml").read_text()
    truth = json.loads((out / "first" / "truth.json").read_text())
    assert truth["undeclared"][0]["effect"] == "nonlinear_stiffening"


def test_an_extended_model_that_does_not_fit_the_trial_is_refused(foam, tmp_path):
    model = foam[0] / "model.yaml"
    extended = f"extended_model={model}"
    other = load(FOAM, extended, "estimation.models=[hunt-crossley]")
    with pytest.raises(ExtendedModelError, match="kelvin-voigt is not among"):
        trial_extension(other)
    with pytest.raises(ConfigError, match="extended_model: no file"):
        load(FOAM, "extended_model=nowhere.yaml")
    broken = tmp_path / "model.yaml"
    broken.write_text("effects: []\n")
    with pytest.raises(ConfigError, match=r"extended_model.base: is required"):
        load(FOAM, f"extended_model={broken}")


@pytest.mark.parametrize(
    ("hidden", "words"),
    [
        ("[{effect: backlas}]", r"undeclared\.0: effect: .* 'backlas'; did you mean 'backlash'\?"),
        ("[{effect: 3}]", r"there is no '3'; one of: nonlinear_stiffening, second_layer, .*"),
        ("[{gap_m: 0.001}]", r"names no effect: add effect, one of: nonlinear_stiffening, .*"),
        ("[{effect: backlash}]", r"undeclared\.0\.gap_m \(backlash\): is required and missing"),
        ("[{effect: backlash, gap: 0.1}]", r"the key lacks its unit: write gap_m"),
        ("[{effect: backlash, gap_m: -1}]", r"gap_m \(backlash\): .* greater than 0 \(it is -1\)"),
        ("[{effect: stress_relaxation, arms: [{stiffness_N_per_m: 3}]}]",
         r"arms\.0\.time_constant_s \(stress_relaxation\): is required and missing"),
        ("3", r"plant\.undeclared: must be a list \(it is 3\)"),
    ],
)  # fmt: skip
def test_an_effect_that_no_plant_can_hide_is_refused_with_one_line(hidden, words):
    override = f"plant.undeclared={hidden}"
    with pytest.raises(ConfigError) as refused:
        load(FOAM, override)
    (problem,) = refused.value.problems
    assert problem.where == f"--set {override}"
    assert re.fullmatch(rf".*{words}", problem.message)
