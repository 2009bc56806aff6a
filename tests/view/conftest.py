"""A recording that the tests of the live page play."""

import pytest

from teleop_rt.cli.wiring import open_bench
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt_dev.trial.files import SILICONE, silicone


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("live") / "run"
    folder.mkdir()
    trial = silicone("duration_s=3.0")
    write_trial(folder, trial)
    run_lockstep(trial, SILICONE, open_bench, folder, lambda _seconds: None)
    return folder / "recording.mcap"
