"""The folder of a run: its date, and that one that could not begin leaves none."""

from __future__ import annotations

import os
import sys
from datetime import datetime
from types import FrameType
from typing import Any

import pytest

from teleop_rt.config.section import Units
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.trial import folder
from teleop_rt.trial.estimators import recording_metadata
from teleop_rt_dev.trial.files import silicone


class InterruptedAt:
    """Presses Ctrl-C before the n-th line that the folder's module executes, until it is left."""

    def __init__(self, line: int) -> None:
        self._left = line
        self._before = sys.gettrace()
        sys.settrace(self._trace)

    def leave(self) -> None:
        sys.settrace(self._before)

    def press(self) -> None:
        self.leave()
        raise KeyboardInterrupt

    def _trace(self, frame: FrameType, event: str, _given: Any) -> Any:
        if frame.f_code.co_filename != folder.__file__:
            return None
        if event == "line":
            self._left -= 1
            if self._left == 0:
                raise KeyboardInterrupt
        return self._trace


@pytest.mark.parametrize("there_before", [False, True])
@pytest.mark.parametrize("made", [folder.new_folder, folder.folder_if_filled])
def test_an_interrupt_at_any_line_before_the_run_begins_leaves_no_folder(
    tmp_path, made, there_before
):
    out = tmp_path / "run"
    if there_before:
        out.mkdir()
    interrupted_at, began = 0, False
    while not began:
        interrupted_at += 1
        tracing = InterruptedAt(interrupted_at)
        try:
            with made(out, "trial"):
                began = True
                tracing.press()
        except KeyboardInterrupt:
            tracing.leave()
        assert list(tmp_path.rglob("*")) == [out] * there_before, f"at line {interrupted_at}"
    assert interrupted_at > 5


def test_a_folder_that_was_filled_stays(tmp_path):
    with folder.folder_if_filled(tmp_path / "loop", "trial") as given:
        (given / "first").mkdir()
    assert (tmp_path / "loop" / "first").is_dir()


def test_the_date_of_a_run_is_that_of_its_recording_whatever_its_files_have(tmp_path):
    trial = silicone()
    began = "2026-01-02T03:04:05+00:00"
    for name, date in (("real", began), ("simulated", None)):
        place = tmp_path / name
        place.mkdir()
        folder.write_trial(place, trial)
        os.utime(place / folder.TRIAL, (1e9, 1e9))
        units = Units(position="m", force="N")
        RecordingWriter(place / folder.RECORDING, units, recording_metadata(trial, date)).close()
    assert folder.began_at(tmp_path / "real") == began
    copied = datetime.fromisoformat(str(folder.began_at(tmp_path / "simulated")))
    assert copied.timestamp() == 1e9
