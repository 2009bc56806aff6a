from __future__ import annotations

import json
from pathlib import Path

import pytest

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.realtime.ring_folder import LAST_FAULT, describe
from teleop_rt.realtime.state_file import leave
from teleop_rt.trial.estimators import recording_metadata
from teleop_rt.trial.recorder_main import recorder_main
from teleop_rt_dev.paths import SILICONE


def test_what_a_device_said_of_its_fault_is_logged_once_each_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    describe(tmp_path, recording_metadata(load_trial_file(SILICONE, [])))
    said = "drive: emergency 8130h, heartbeat of this daemon ended"
    left = iter([8, 8, 9])

    def over() -> bool:
        """Leave the fault again, at last once more, as after a reset."""
        stamp_ns = next(left, None)
        if stamp_ns is not None:
            leave(tmp_path / LAST_FAULT, {"stamp_ns": stamp_ns, "fault": "emergency", "said": said})
        return stamp_ns is None

    recorder_main(tmp_path, tmp_path, over, lambda *_, **__: None)
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert events == [{"said": said, "stamp_ns": stamp, "event": "device"} for stamp in (8, 9)]
