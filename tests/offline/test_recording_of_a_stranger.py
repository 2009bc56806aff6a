"""A recording may come from anybody: it is read, and no program that it names is run."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.estimation.pipeline import PipelineSettings
from teleop_rt.estimation.rows import rows_for
from teleop_rt.offline.commands import print_replay
from teleop_rt.offline.load import load_any
from teleop_rt.offline.replay import Choice, replay
from teleop_rt.offline.table import Table
from teleop_rt.realtime.recording import ONLINE, RecordingWriter
from teleop_rt.signals import SLAVE, SLAVE_TOPIC
from teleop_rt.trial.estimators import online_metadata

SAMPLES = 3000
AS_IT_IS = Table({}, {}, None)
HOWTO = Path(__file__).parents[2] / "docs" / "howto" / "effect.md"


@pytest.fixture
def program(tmp_path):
    """The effect of the documentation, and a trace in the file system that its file was run."""
    ran, path = tmp_path / "ran", tmp_path / "mine.py"
    example = HOWTO.read_text().split("```python\n")[1].split("```")[0]
    path.write_text(f"{example}\nopen({str(ran)!r}, 'w').close()\n")
    return path, ran


def recording(path: Path, effect: str, program: Path, **changes: str) -> Path:
    """Write a press on a spring, said to have run with an effect of that program."""
    now = np.arange(SAMPLES) * 1e-3
    x = 0.012 + 0.008 * np.sin(9.0 * now)
    columns = dict.fromkeys((one.name for one in SLAVE), np.zeros(SAMPLES)) | {
        "tick": np.arange(SAMPLES), "valid": np.ones(SAMPLES), "position": x,
        "stamp_ns": 1e9 * (1 + now), "sample_stamp_ns": 1e9 * (1 + now),
        "force": 3600.0 * np.maximum(0.0, x - 0.008), "surface": np.full(SAMPLES, 0.008),
    }  # fmt: skip
    extended = {"base": {"model": "kelvin-voigt"}, "effects": [{"name": effect, "law": "",
                "parameters": {"grain": 4e7, "depth": 0.006}}]}  # fmt: skip
    settings = settings_of_a_run()
    rows = rows_for(["kelvin-voigt"], ["direct"], ["rls"])
    metadata = online_metadata(settings, rows, ("m", "N"), extended, str(program)) | changes
    writer = RecordingWriter(path, Units(position="m", force="N"), {ONLINE: metadata})
    writer.add_topic(SLAVE_TOPIC, SLAVE)
    writer.write_rows(SLAVE_TOPIC, np.column_stack(list(columns.values())))
    writer.close()
    return path


def settings_of_a_run() -> PipelineSettings:
    return PipelineSettings(
        period_s=1e-3, position_resolution=5e-6, force_noise=0.05, onset_force=0.4,
        release_force=0.2,
    )  # fmt: skip


def test_a_program_that_a_recording_names_is_run_only_when_the_reader_names_it(tmp_path, program):
    path, ran = program
    file = recording(tmp_path / "run.mcap", "buried_grain", path)
    assert load_any(file, AS_IT_IS).position.size == SAMPLES
    with pytest.raises(RecordingError, match=r"effects of .*mine.py: read that program"):
        replay(file, Choice(), AS_IT_IS)
    assert not ran.exists()
    answer, _ = replay(file, Choice(), AS_IT_IS, path)
    assert ran.exists()
    assert any("buried_grain" in str(row) for row in answer["estimators"])


def test_settings_of_another_program_are_refused_in_a_sentence(tmp_path, program):
    for settings in ('{"nope": 1}', "[]", "{"):
        file = tmp_path / f"run{len(settings)}.mcap"
        recording(file, "buried_grain", program[0], settings=settings)
        with pytest.raises(RecordingError, match="settings"):
            load_any(file, AS_IT_IS)


def test_the_name_of_a_file_is_printed_as_it_is():
    printed = Console(file=StringIO(), width=200)
    answer = {"recording": "a[/bold]x[red].csv", "samples": 1, "estimators": []}
    answer |= {"selected": None, "notes": []}
    print_replay(printed, answer, every=False)
    assert "a[/bold]x[red].csv: 1 samples" in printed.file.getvalue()
