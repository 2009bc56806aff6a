"""Masters that are faster than the slave, and rates that a trial does not accept."""

import json

import numpy as np
import pytest

from teleop_rt.cli.wiring import open_bench
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt.realtime.clock import SimulatedClock
from teleop_rt.realtime.reading import read_topics
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import memory_link, run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_dev.trial.files import SILICONE, silicone
from teleop_rt_drivers.simulated.reference import environment_force

MS = 1_000_000
SECONDS = 6


@pytest.mark.parametrize("rate_hz", [2000, 4000])
def test_a_trial_renders_at_the_masters_own_rate_without_lag(tmp_path, rate_hz):
    trial = silicone(f"master.rate_hz={rate_hz}", f"duration_s={SECONDS}")
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, SILICONE, open_bench, tmp_path, lambda _: None)
    summary = summarise(tmp_path, trial, outcome, environment_force)
    assert abs(summary["master"]["lag_ms"]) <= 1e3 / rate_hz
    assert summary["master"]["nrmse"] < 0.01
    assert summary["master"]["rendering"]["passivity"]["stiffness_max"] == pytest.approx(
        2 * trial.master.device_damping * rate_hz, rel=1e-3
    )
    topics = read_topics(tmp_path / "recording.mcap", ["/slave", "/master"])
    assert np.all(np.diff(topics["/master"]["stamp_ns"]) == 1e9 / rate_hz)
    assert np.all(np.diff(topics["/slave"]["stamp_ns"]) == MS)
    pressed = topics["/master"]["rendered_force"][-2 * rate_hz :]
    assert np.count_nonzero(np.diff(pressed[pressed > 1.0])) > rate_hz, "a force of its own"
    json.dumps(summary, allow_nan=False)


@pytest.mark.parametrize(("accepted", "stands"), [("[100, 1000]", False), ("[100, 4000]", True)])
def test_a_peer_of_a_rate_that_the_trial_does_not_accept_gets_no_session(accepted, stands):
    trial = silicone("master.rate_hz=2000", f"link.accepted_rates_hz={accepted}")
    clock = SimulatedClock(1_000_000_000)
    slave, master = memory_link(trial, clock.now_ns)
    for _ in range(1000):
        clock.move_to(clock.now_ns() + MS)
        master.poll()
        slave.poll()
    assert master.connected is stands
    assert ("rate" in (slave.trouble or "")) is not stands


def test_rates_in_the_wrong_order_are_refused():
    with pytest.raises(ConfigError, match="lowest first"):
        silicone("link.accepted_rates_hz=[4000, 100]")
