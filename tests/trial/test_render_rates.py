"""Rendering faster than the slave's loop, up to 4 kHz."""

import json

import numpy as np
import pytest
from trial_files import SILICONE, silicone

from teleop_rt.cli import open_bench
from teleop_rt.realtime.recording import read_topics
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_drivers.simulated.reference import environment_force


@pytest.mark.parametrize("rate_hz", [2000, 4000])
def test_the_true_wall_is_felt_at_every_tick_of_a_faster_master(tmp_path, rate_hz):
    trial = silicone("duration_s=4.5", f"master.rate_hz={rate_hz}", "link.round_trip_ms=30")
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, SILICONE, open_bench, tmp_path, lambda _: None)
    summary = summarise(tmp_path, trial, outcome, environment_force)
    felt = summary["master"]
    assert summary["safety"]["fault"]["code"] == 0
    assert abs(felt["lag_ms"]) <= 1000.0 / rate_hz
    assert felt["nrmse"] <= 0.05
    assert felt["largest_force_step"] <= trial.master.force_step * 1000.0 / rate_hz + 1.0
    passivity = felt["rendering"]["passivity"]
    assert passivity["energy_min_J"] >= -passivity["epsilon_J"]
    assert passivity["stiffness_max"] > passivity["stiffness"]["rendered"]
    assert felt["rendering"]["mass"]["rendered"] == 0.0
    assert "measures no acceleration" in felt["rendering"]["mass"]["reason"]
    master = read_topics(tmp_path / "recording.mcap", ["/master"])["/master"]
    assert np.median(np.diff(master["stamp_ns"])) == 1e9 / rate_hz
    assert master["tick"].size == pytest.approx(4.5 * rate_hz, rel=0.02)
    events = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    adopted = [event for event in events if event["event"] == "adoption"]
    assert sum(event["energy_J"] for event in adopted) == pytest.approx(
        felt["rendering"]["adoption"]["energy_J"], abs=1e-3
    )


def test_a_faster_master_may_render_a_stiffer_wall(tmp_path):
    stiffest = []
    for rate_hz in (1000, 4000):
        folder = tmp_path / str(rate_hz)
        folder.mkdir()
        trial = silicone("duration_s=0.02", f"master.rate_hz={rate_hz}")
        outcome = run_lockstep(trial, SILICONE, open_bench, folder, lambda _: None)
        stiffest.append(outcome["rendering"]["passivity"]["stiffness_max"])
    assert stiffest[1] == pytest.approx(4 * stiffest[0], rel=1e-6)


def test_a_port_that_gave_energy_is_noted(tmp_path):
    trial = silicone("duration_s=0.3")
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, SILICONE, open_bench, tmp_path, lambda _: None)
    assert not any("gave energy" in n for n in summarise(tmp_path, trial, outcome, None)["notes"])
    outcome["rendering"]["passivity"] |= {"energy_min_J": -1.0, "epsilon_J": 0.05}
    (note,) = (n for n in summarise(tmp_path, trial, outcome, None)["notes"] if "gave energy" in n)
    assert "-1 J, below -0.05 J" in note
