"""An operator's device that speaks bytes, through the same driver as the slave's axis."""

from __future__ import annotations

import io
import math
import threading
import time

import numpy as np
import pytest
from rich.console import Console
from rig_bench import MS

from teleop_rt.axis import AxisError
from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.config.loader import load_trial
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt.master.device import HeldDevice
from teleop_rt.master.handle_safety import HandleWatch
from teleop_rt.realtime.reading import read_topics
from teleop_rt.signals import HANDLE_TRUTH, columns
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt.trial.table import print_summary
from teleop_rt_dev.faults.handle import CANOPEN, SERIAL, HandleBench
from teleop_rt_drivers import opening, operator_device, registry
from teleop_rt_drivers.ends import DeviceEnds
from teleop_rt_drivers.simulated.reference import environment_force
from teleop_rt_drivers.simulated_rig import hand_on_device

LAG_MS = {CANOPEN: 1.5, SERIAL: 2.5}
"""Latency and half a period, with a little of the lag of the filtered damping."""
BOTH = pytest.mark.parametrize(
    "handle", [CANOPEN, SERIAL], indirect=True, ids=["canopen", "serial"]
)


@pytest.mark.parametrize("file", [CANOPEN, SERIAL], ids=["canopen", "serial"])
def test_the_cube_is_felt_and_found_through_the_device(tmp_path, file):
    """Of its 20 N s/m 3.2 were rendered once: 4.6 ms of lag and 0.8 to 1 % of NRMSE."""
    trial = load_trial_file(file, ["duration_s=5.5"])
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, file, open_bench, tmp_path, lambda _: None)
    summary = summarise(tmp_path, trial, outcome, environment_force)
    assert summary["safety"]["fault"]["name"] == "none"
    (row,) = (row for row in summary["estimators"] if row["model"] == "kelvin-voigt")
    assert row["parameters"]["k"]["value"] == pytest.approx(3600, rel=0.02)
    assert summary["contact"]["surface_found"] == pytest.approx(0.0137, abs=0.2e-3)
    master = read_topics(tmp_path / "recording.mcap", ["/master"])["/master"]
    assert np.nanmax(master["rendered_force"]) > 20.0
    assert summary["master"]["rendering"]["passivity"]["reduced"] is False
    assert abs(summary["master"]["lag_ms"]) < 1.0
    assert summary["master"]["nrmse"] < 0.005
    assert abs(summary["master"]["true_port"]["motor_lag_ms"]) < LAG_MS[file]
    assert summary["master"]["true_port"]["motor_nrmse"] < 0.02


@pytest.mark.parametrize("stiffness", [20_000.0, 1500.0])
def test_the_summary_says_how_much_of_a_stiff_wall_can_be_felt(tmp_path, stiffness):
    """At 20 kN/m a third: the NRMSE of 0.46 is the device's: 0.98 of its 6.7 kN/m."""
    trial = load_trial_file(
        CANOPEN, ["duration_s=3", f"plant.environment.stiffness_N_per_m={stiffness}"]
    )
    write_trial(tmp_path, trial)
    outcome = run_lockstep(trial, CANOPEN, open_bench, tmp_path, lambda _: None)
    summary = summarise(tmp_path, trial, outcome, environment_force)
    out = io.StringIO()
    print_summary(Console(file=out, width=400), summary, trial.rig.units)
    printed = "stiff wall  " in out.getvalue()
    assert printed is (stiffness > 6710.0)
    if printed:
        said = "N/m of the wall's 20000 N/m, its damping included: a stiffer wall would not be"
        assert said in out.getvalue()
        assert "of the wall's 20000 N/m; a wall without damping could have 67" in out.getvalue()
        met = read_topics(tmp_path / "recording.mcap", ["/master"])["/master"]
        unfelt = summary["master"]["unfelt"]
        assert unfelt["pressed"] > 1.5 * unfelt["felt"]
        assert f"{unfelt['felt'] / unfelt['pressed']:.0%} of it" in out.getvalue()
        assert summary["master"]["worst"]["force_error"] < np.nanmax(met["reflected_force"])
        assert summary["master"]["nrmse"] > 0.3


def test_at_2_khz_where_the_bus_carries_it_the_cube_is_felt_with_a_stiffer_bound(tmp_path):
    changes = ["duration_s=3", "master.rate_hz=2000", "operator.rig.rate_hz=2000"]
    trial = load_trial_file(SERIAL, changes)
    rendering = run_lockstep(trial, SERIAL, open_bench, tmp_path, lambda _: None)["rendering"]
    assert rendering["passivity"]["stiffness_max"] > 1.6 * 6097
    assert rendering["passivity"]["reduced"] is False
    assert rendering["handle"]["fault"]["name"] == "none"
    master = read_topics(tmp_path / "recording.mcap", ["/master"])["/master"]
    assert np.nanmax(master["rendered_force"]) > 20.0
    assert np.median(np.diff(master["stamp_ns"])) == 500_000


@pytest.fixture
def handle(request):
    return HandleBench(request.param)


@BOTH
def test_position_and_velocity_are_the_hands_and_the_force_is_against_it(handle):
    position, velocity = handle.update(0.0, 300)
    assert position == pytest.approx(0.04 * 0.298, abs=3e-4)
    assert velocity == pytest.approx(0.04, abs=3e-3)
    position, _ = handle.update(12.0, 20)
    assert handle.plant.servo_force == pytest.approx(-12.0, abs=0.1)
    if handle.network.drive.name == "drive" and hasattr(handle.network.drive, "value"):
        assert handle.network.drive.value(0x6060) == 10
    expected = 0.04 * 0.318 - 12.0 / 3000
    assert handle.update(12.0, 300)[0] - 0.04 * 0.3 == pytest.approx(expected, abs=1.2e-3)


def test_a_first_cycle_that_takes_long_loses_no_device(monkeypatch):
    """Compiling and catching up took 100 ms of it; the devices had spoken meanwhile."""
    handle = HandleBench()
    advance = handle.plant.advance

    def slow(_):
        monkeypatch.setattr(handle.plant, "advance", advance)
        handle.now += 100 * MS
        advance(handle.now)

    monkeypatch.setattr(handle.plant, "advance", slow)
    handle.update(0.0, 20)
    assert handle.watch.fault.name == "none"


def test_a_hand_that_nobody_asked_for_long_is_where_it_would_be_anyway():
    asked, forgotten = HandleBench(), HandleBench()
    asked.update(0.0, 3000)
    forgotten.now += 3000 * MS
    forgotten.plant.advance(forgotten.now)
    assert forgotten.plant.position == pytest.approx(asked.plant.position, abs=1e-4)
    assert abs(forgotten.plant.position) < 0.2


@BOTH
def test_a_hand_whose_device_is_off_pulls_with_no_more_than_an_adult_can(handle):
    handle.plant.power_off()
    end_ns = handle.now + 60_000 * MS
    handle.plant.advance(end_ns)
    column = columns(HANDLE_TRUTH)["hand_force"]
    assert handle.plant.position < 0.3
    assert handle.plant.truth_row[column] == pytest.approx(400.0, rel=0.01)


@BOTH
def test_no_force_is_pushed_before_power_nor_of_a_number_that_is_none(handle):
    handle.update(50.0, 2)
    assert handle.plant.servo_force == pytest.approx(0.0, abs=0.01)
    handle.update(50.0, 20)
    assert handle.plant.servo_force == pytest.approx(-50.0, abs=0.1)
    handle.update(float("nan"), 3)
    assert handle.plant.servo_force == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("fault", ["mute", "emergency", "unplug"])
def test_a_device_with_a_fault_is_stopped_and_stands(fault):
    handle = HandleBench()
    handle.update(10.0, 50)
    handle.network.inject(fault, "encoder")
    handle.update(10.0, 100)
    first = handle.update(10.0)
    assert handle.update(10.0) == (first[0], 0.0)
    for _ in range(200):
        handle.now += MS
        handle.plant.advance(handle.now)
        handle.network.process()
    assert not handle.network.drive.powered


@pytest.mark.parametrize("fault", ["mute", "unplug"])
@pytest.mark.parametrize("device", ["encoder", "drive"])
def test_a_serial_device_with_a_fault_is_stopped_and_stands(fault, device):
    handle = HandleBench(SERIAL)
    handle.update(10.0, 50)
    assert handle.plant.servo_force == pytest.approx(-10.0, abs=0.1)
    handle.network.inject(fault, device)
    handle.update(10.0, 100)
    first = handle.update(10.0)
    assert handle.update(10.0) == (first[0], 0.0)
    handle.network.heal(device)
    for _ in range(200):
        handle.now += MS
        handle.network.process()
    assert not handle.network.drive.powered
    assert handle.plant.servo_force == pytest.approx(0.0, abs=0.01)


def test_no_more_than_the_rigs_force_is_asked_of_a_serial_drive():
    handle = HandleBench(SERIAL)
    handle.update(500.0, 20)
    assert handle.plant.servo_force == pytest.approx(-100.0, abs=0.1)


def test_the_serial_device_speaks_over_pseudo_terminals(tmp_path):
    """Real bytes through a terminal of the operating system, as through /dev/ttyUSB0.

    Two threads share the cores with all else on the machine's clock: a silence that ends in a stop
    by the handle's own limits, of 10 and 60 ms, would be a late thread.
    """
    HandleBench(SERIAL).update(7.0, 20)  # compiles the kernels: the first tick would take long
    axis = "operator.rig.axis"
    longest = {"drive.timeout_ms": 1000, "position.timeout_ms": 1000, "drive.watchdog_ms": 200}
    patient = [f"{axis}.{key}={ms}" for key, ms in longest.items()]
    config = load_trial_file(SERIAL, [f"{axis}.folder={tmp_path}/ports", *patient]).operator
    now_ns = time.monotonic_ns
    network, plant = hand_on_device(config, now_ns, 1, DeviceEnds())
    network.power_on()
    ended = threading.Event()

    def serve():
        while not ended.wait(0.0005):
            network.process()

    serving = threading.Thread(target=serve)
    serving.start()
    try:
        device = operator_device.open_device(replace_hand(config), now_ns, 1)
        watch = HandleWatch(config.rig.limits, 1e-3, lacks=config.rig.axis.unsafe())
        operator = HeldDevice(device, watch, 1e-3)
        operator.configure()
        end_ns = now_ns() + 20_000_000_000
        network_moved = math.nan  # a loaded machine serves the line later than the force
        while now_ns() < end_ns and not (
            plant.servo_force <= -6.995 and abs(network_moved - plant.position) < 0.02
        ):
            network_moved = operator.update(0.0, 7.0)[0]
            operator.push(7.0)
            ended.wait(0.001)
        assert plant.servo_force == pytest.approx(-7.0, abs=0.01)
        assert network_moved == pytest.approx(plant.position, abs=0.02)
        operator.close()
        while network.drive.powered and now_ns() < end_ns:
            ended.wait(0.001)
        assert not network.drive.powered
    finally:
        ended.set()
        serving.join()
        network.close()


def replace_hand(config):
    """The operator as with a real device: nobody simulated holds it in the master's process."""
    return config.model_copy(update={"hand": None})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("operator.rig.axis.driver=wheel", "operator.rig.axis.driver: 'wheel' is not one of"),
        ("operator.rig.axis.drive.torque=null", "drive.torque is missing"),
        ("operator.rig=nowhere.yaml", "operator.rig: no file"),
        ("operator.rig.limits.force_max=3", "the key lacks its unit: write force_max_N"),
    ],
)
def test_a_wrong_device_is_refused_with_its_key(change, said):
    with pytest.raises(ConfigError, match=said):
        load_trial(CANOPEN, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, [change])


@pytest.mark.parametrize(
    ("rig", "driver"),
    [("simulated_handle", "canopen_device"), ("simulated_serial_handle", "serial_device")],
)
def test_a_device_is_no_rig_for_the_slave(rig, driver):
    trial = load_trial_file(CANOPEN, [f"rig=../rigs/{rig}.yaml", "plant=null"])
    with pytest.raises(
        AxisError, match=rf"{driver} measures no force: name this rig in operator\.rig"
    ):
        opening.open_axis(trial.rig, lambda: 0)


@pytest.mark.parametrize("file", [CANOPEN, SERIAL])
def test_the_trial_as_run_loads_again(tmp_path, file):
    trial = load_trial_file(file, None)
    assert load_trial_file(write_trial(tmp_path, trial), None) == trial
