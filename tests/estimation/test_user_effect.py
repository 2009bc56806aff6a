"""The worked example of an effect of one's own, from the documentation's page to the hand."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.contact.effect import MOST_SHAPES
from teleop_rt.contact.effects.user import library
from teleop_rt.contact.fitted import code_of
from teleop_rt.estimation.extension import extension_from
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.rows import rows_for
from teleop_rt.link.messages import ModelEffect, ModelMessage
from teleop_rt.master.rendered_effects import RenderedEffects
from teleop_rt.master.walls import wall_of
from teleop_rt.trial.estimators import trial_extension
from teleop_rt_dev.estimation.plant import Press, kelvin_voigt, record
from teleop_rt_dev.paths import SILICONE

HOWTO = Path(__file__).parents[2] / "docs" / "howto" / "effect.md"
PRESS = Press(duration=6.0)
GRAIN, DEPTH = 4e7, 0.006


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    """The file that the page describes."""
    path = tmp_path_factory.mktemp("user") / "mine.py"
    path.write_text(HOWTO.read_text().split("```python\n")[1].split("```")[0])
    return path


def test_the_example_is_estimated_on_line_beside_the_model(mine):
    samples = record(
        PRESS, lambda x, v: kelvin_voigt(x, v) + GRAIN * np.maximum(x - DEPTH, 0.0) ** 3
    )
    parameters = {"grain": 0.7 * GRAIN, "depth": DEPTH}
    document = {
        "base": {"model": "kelvin-voigt"},
        "effects": [{"name": "buried_grain", "law": "", "parameters": parameters}],
    }
    extension = extension_from("model.yaml", document, str(mine))
    settings = PipelineSettings(
        period_s=1e-3, position_resolution=5e-6, force_noise=0.05, onset_force=0.4,
        release_force=0.2, force_lag_s=1e-3,
    )  # fmt: skip
    rows = extension.rows(rows_for(["kelvin-voigt"], ["direct"], ["rls"]))
    pipeline = Pipeline(rows, extension.settings(settings))
    pipeline.run(*samples)
    names, values, _ = pipeline.estimate(1)
    found = dict(zip(names, values, strict=True))
    assert found["buried_grain"] == pytest.approx(GRAIN, rel=0.03)
    assert found["k"] == pytest.approx(3600, rel=0.01)


def test_the_example_is_rendered_where_the_master_has_the_file_and_only_there(mine):
    effect = library(mine)[-1]
    streamed = ModelEffect(code_of(effect), GRAIN, (DEPTH, *(MOST_SHAPES - 1) * (0.0,)))
    rendered = RenderedEffects(library(mine), 0.1, 1.5)
    terms = rendered.terms([streamed], 0.0)
    wall = wall_of(ModelMessage("kelvin-voigt", 1, 1, 0.0, k=3600.0, effects=(streamed,)), terms)
    rendered.advance(0.016, 0.0, 0.0, 1e-3)
    assert wall.force(0.016, 0.0) == pytest.approx(3600 * 0.016 + GRAIN * 0.01**3)
    assert RenderedEffects(library(), 0.1, 1.5).terms([streamed], 0.0) is None


def test_a_trial_finds_the_file_and_the_model_beside_itself(mine, tmp_path, monkeypatch):
    """`effects_file` and `extended_model` are relative to the trial, wherever the command runs."""
    (tmp_path / "mine.py").write_text(mine.read_text())
    effect = {"name": "buried_grain", "law": "", "parameters": {"grain": GRAIN, "depth": DEPTH}}
    model = {"base": {"model": "kelvin-voigt"}, "effects": [effect]}
    (tmp_path / "model.yaml").write_text(yaml.safe_dump(model))
    own = yaml.safe_load(SILICONE.read_text()) | {
        "effects_file": "mine.py", "extended_model": "model.yaml",
        "rig": str(SILICONE.parents[1] / "rigs" / "simulated_canopen.yaml"),
    }  # fmt: skip
    (tmp_path / "trial.yaml").write_text(yaml.safe_dump(own))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    trial = load_trial_file(tmp_path / "trial.yaml", None)
    (fitted,) = trial_extension(trial).terms
    assert (fitted.effect.name, fitted.amplitude) == ("buried_grain", pytest.approx(GRAIN))
