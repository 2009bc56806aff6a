"""A drive that was left under power is stopped by a program that knows nothing of who left it."""

import threading
import time

import pytest

from teleop_rt.axis import Sample
from teleop_rt.cli.wiring import load_trial_file
from teleop_rt_dev.paths import SILICONE
from teleop_rt_drivers import opening
from teleop_rt_drivers.simulated import servo


@pytest.fixture
def overrides(tmp_path, monkeypatch):
    monkeypatch.setenv("TELEOP_RT_RUN_DIR", str(tmp_path / "run"))
    return ["rig=../rigs/simulated_serial.yaml", f"rig.axis.folder={tmp_path}/ports"]


def test_an_abandoned_drive_is_stopped(overrides, call, monkeypatch):
    monkeypatch.setattr(servo, "WATCHDOG_NS", 10**15)  # or the drive would stop by itself
    trial = load_trial_file(SILICONE, overrides)
    rig = opening.open_rig(trial.rig, trial.plant, time.monotonic_ns, 1)
    served = threading.Event()
    serving = threading.Thread(target=rig.serve, args=(served.is_set,))
    serving.start()
    try:
        left = opening.open_axis(trial.rig, time.monotonic_ns)
        left.configure()
        left.arm()
        sample = Sample()
        while not rig.drive.powered:
            left.read_into(sample)
            left.write(sample.position)
            threading.Event().wait(0.001)
        for port in left._ports:
            port.close()
        assert rig.drive.powered
        changes = [part for override in overrides for part in ("--set", override)]
        code, out, errors = call("make-safe", SILICONE, *changes)
        assert (code, errors) == (0, "")
        assert "stopped" in out
        while rig.drive.powered:
            threading.Event().wait(0.001)
    finally:
        served.set()
        serving.join()
        rig.close()


def test_a_rig_that_does_not_answer_is_reported(overrides, call):
    changes = [part for override in overrides for part in ("--set", override)]
    code, _, errors = call("make-safe", SILICONE, *changes)
    assert code == 2
    assert "cannot open the serial port" in errors
