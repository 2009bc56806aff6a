from __future__ import annotations

import re
from pathlib import Path

import pytest

from teleop_rt.diagnosis.answers.extended import read
from teleop_rt.diagnosis.answers.residuals import residuals_of
from teleop_rt.diagnosis.diagnose import diagnose, narrowed
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.plants import make

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")


def test_a_page_names_the_effect_with_figures_and_model(tmp_path: Path) -> None:
    from teleop_rt.view.diagnosis_page import write  # noqa: PLC0415 - needs the extra

    record = make(31, ("coulomb_friction",), size=0.1, noise=0.01, seconds=5.0)
    recording = from_arrays("run <1>", record.t, record.position, record.force)
    found = diagnose(recording, record.base, surface=0.0)
    paths = write(found.answer, residuals_of(found, recording.units), tmp_path / "out")
    page = paths[0].read_text()
    assert "Dry friction of" in page
    (shown,) = re.findall(r'class="selected">.*</span> ([\d.]+) %', page)
    assert float(shown) == pytest.approx(100.0 * found.answer["effects"][0]["explains"], abs=0.06)
    assert "run &lt;1&gt;" in page
    assert paths[1].read_bytes().startswith(b"\x89PNG")
    assert "<svg" in paths[2].read_text()
    (fitted,) = read(paths[3])
    assert fitted.effect.name == "coulomb_friction"
    force = found.answer["effects"][0]["parameters"]["friction_force"]["value"]
    assert fitted.amplitude == pytest.approx(force)


def test_a_page_names_outliers_which_explain_no_share_of_the_force(tmp_path: Path) -> None:
    from teleop_rt.view.diagnosis_page import write  # noqa: PLC0415 - needs the extra

    record = make(102, ("force_bias", "outliers"), size=0.1, noise=0.01, seconds=5.0)
    recording = from_arrays("run", record.t, record.position, record.force)
    found = diagnose(recording, record.base, surface=0.0)
    assert found.answer["class"] == [["force_bias", "outliers"]]
    page = write(found.answer, residuals_of(found, recording.units), tmp_path / "out")[
        0
    ].read_text()
    assert '<tr class="selected"><td>force bias</td>' in page
    assert "Names joined by + are effects that are added together" in page
    again = narrowed(found, recording, [["force_bias"]])
    assert again.answer["class"] == found.answer["class"]
    assert again.answer["effects"] == found.answer["effects"]


def test_a_doubted_name_is_marked_for_attention_and_a_mass_is_in_kg(tmp_path: Path) -> None:
    from teleop_rt.view.diagnosis_page import write  # noqa: PLC0415 - needs the extra

    record = make(31, ("coulomb_friction",), size=0.1, noise=0.01, seconds=5.0)
    recording = from_arrays("run", record.t, record.position, record.force)
    found = diagnose(recording, record.base, surface=0.0)
    left = residuals_of(found, recording.units)

    def page(**changed: object) -> str:
        return write(found.answer | changed, left, tmp_path)[0].read_text()

    assert found.answer["verdict"] == "named"
    sure, unsure = page(), page(probability={"coulomb_friction": 0.7})
    lost = page(error=found.answer["error"] | {"after": None})
    assert 'class="verdict good"' in sure
    assert re.search(r"tool inertia</td><td class=\"number\">mass [\d.e-]+ kg<", sure)
    for doubted in (unsure, lost):
        assert 'class="verdict attention"' in doubted
        assert "say why to doubt it" in doubted
