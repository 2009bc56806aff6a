"""Force from the motor's torque: freed of friction and mass, on CANopen and on makers' drives."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass, field

import numpy as np
import pytest
from framed_bench import RIGS, FramedBench, load
from rig_bench import MS, plant_config
from test_trial_on_every_rig import TRIAL, kelvin_voigt, open_bench

from teleop_rt.api.values import Parameter
from teleop_rt.axis import AxisError
from teleop_rt.config.loader import load_rig, load_trial
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_drivers import registry
from teleop_rt_drivers.calibration import work
from teleop_rt_drivers.calibration.drivetrain import drivetrain_keys
from teleop_rt_drivers.calibration.rig_file import with_values
from teleop_rt_drivers.calibration.torque_lag import STEPS_SHARE
from teleop_rt_drivers.calibration.weights import CalibrationError
from teleop_rt_drivers.doctor import examine_axis
from teleop_rt_drivers.drivetrain import Drivetrain, DrivetrainConfig
from teleop_rt_drivers.rig_text import rig_text
from teleop_rt_drivers.simulated.reference import environment_force

FILE = RIGS / "simulated_canopen_drive.yaml"
THRESHOLDS = [
    "contact.onset_force_N=2", "contact.release_force_N=1", "operator.felt_force_N=2",
]  # fmt: skip


def freed(config: DrivetrainConfig, motion, force, count=400, period_ns=MS):
    """Forces freed of the drivetrain beside those at the tool, at the times that they belong to."""
    drivetrain = Drivetrain(config, 1.0, period_ns)
    pairs = []
    for k in range(count):
        t = k * period_ns * 1e-9
        drivetrain.take(k * period_ns, motion(t), force(t))
        if k > 20:
            pairs.append((drivetrain.force, drivetrain.stamp_ns * 1e-9))
    return np.array(pairs)


def test_a_constant_force_is_freed_of_friction_and_mass_of_a_known_motion():
    w = 2 * np.pi * 3.0
    config = DrivetrainConfig(coulomb_friction=3.0, viscous_friction=5.0, mass=2.0)

    def motor(t):
        v, a = 0.02 * w * np.cos(w * t), -0.02 * w**2 * np.sin(w * t)
        return 7.0 + 3.0 * np.clip(v / 0.01, -1, 1) + 5.0 * v + 2.0 * a

    found = freed(config, lambda t: 0.02 * np.sin(w * t), motor)
    turning = np.abs(np.cos(w * found[:, 1])) < 0.1
    assert np.max(np.abs(found[~turning, 0] - 7.0)) < 0.06
    # While it turns dry friction goes from one sign to the other within the window.
    assert np.max(np.abs(found[turning, 0] - 7.0)) < 3.0
    # The motor's own force is off by all of it.
    assert np.ptp(motor(np.linspace(0, 1, 1000))) > 20.0


def test_what_a_mass_takes_cancels_also_where_the_command_is_jerky():
    accelerations = np.where(np.arange(400) % 3 == 0, 20.0, -10.0)
    velocities = np.cumsum(accelerations) * 1e-3
    positions = np.cumsum(velocities) * 1e-3
    found = freed(
        DrivetrainConfig(mass=2.0, torque_lag_ms=0.5),
        lambda t: np.interp(t, np.arange(400) * 1e-3, positions),
        lambda t: 2.0 * accelerations[min(round(t * 1e3), 399)],
    )
    assert np.max(np.abs(2.0 * accelerations)) == 40.0
    assert np.max(np.abs(found[:, 0])) < 2.0


def test_a_force_is_late_from_the_first_on_so_that_no_stamp_is_followed_by_an_earlier_one():
    drivetrain, stamps = Drivetrain(DrivetrainConfig(torque_lag_ms=0.5), 1.0, MS), []
    for k in range(40):
        drivetrain.take(k * MS, 0.0, 10.0 * k)
        stamps.append(drivetrain.stamp_ns)
        assert drivetrain.force == pytest.approx(1e-5 * stamps[-1], abs=6.0)
    assert stamps == sorted(stamps)
    assert stamps[-1] == 34 * MS


def test_a_run_calibrates_its_drivetrain_and_the_same_run_twice_changes_nothing(
    tmp_path, call, monkeypatch
):
    # The same recording has the same answer, which takes 4 s of processor time.
    monkeypatch.setattr(work, "diagnose", functools.cache(work.diagnose))
    rig = tmp_path / "rig.yaml"
    rig.write_text(FILE.read_text())
    high = (
        "contact.onset_force_N=5",
        "contact.release_force_N=4",
        "link.loss=0",
        "link.jitter_ms=0",
    )
    before = run(trial(FRICTION, *high, duration_s=4.5), made(tmp_path / "before"))
    for _ in range(2):
        code, _, err = call("calibrate", "drivetrain", rig, tmp_path / "before", "--write")
        assert code == 0, err
        found = load_rig(rig, registry.AXIS_SCHEMAS).axis.drivetrain
        assert found.coulomb_friction == pytest.approx(3.0, abs=0.5)
        assert found.mass == 2.0
    # The first model is twice too stiff: where no tank pays for a softer wall of the same force, it
    # stayed for the whole contact (0.051 in place of 0.008).
    after = run(trial(FRICTION, *high, f"rig={rig}", duration_s=4.5), made(tmp_path / "after"))
    assert after["master"]["nrmse"] < 0.7 * before["master"]["nrmse"]
    assert after["contact"]["surface_found"] == pytest.approx(0.0137, abs=0.5e-3)
    (tmp_path / "before" / "trial.yaml").unlink()
    code, _, err = call("calibrate", "drivetrain", rig, tmp_path / "before")
    assert code == 2
    assert "give the run's folder" in err


@pytest.mark.parametrize("drive", ["canopen", "odrive"])
def test_a_spring_calibrates_the_lag_of_a_drive_s_torque(drive, tmp_path, call):
    """The simulated drives report the mean of a millisecond: half of that late."""
    rig = tmp_path / "rig.yaml"
    text = rig_text(drive, "unix", "drive", None)
    (line,) = (one for one in text.splitlines() if "torque_lag_ms" in one)
    assert "force_lag_ms: 5" in text
    rig.write_text(text.replace(line, line.replace("0.5", "0.0")).replace(
        "force_lag_ms: 5", "force_lag_ms: 4"
    ))  # fmt: skip
    assert load_rig(rig, registry.AXIS_SCHEMAS).sensors.force_lag_ms == 4.0
    # A mass that is taken off half a millisecond late leaves up to 5 N of force in free air.
    felt = ("contact.onset_force_N=8", "contact.release_force_N=5", "operator.felt_force_N=8")
    spring = ("plant.environment.damping_N_s_per_m=0", f"rig={rig}", *felt)
    run(trial(*spring, duration_s=8.0), made(tmp_path / "spring"))
    recording = tmp_path / "spring" / "recording.mcap"
    code, out, err = call("calibrate", "lag", rig, recording, "--write")
    assert code == 0, err
    printed = dict(re.findall(r"^(mass|stiffness) +([\d.]+) (?:kg|N)", out, re.MULTILINE))
    assert float(printed["mass"]) == pytest.approx(2.0, rel=0.1)
    assert float(printed["stiffness"]) == pytest.approx(3600.0, rel=0.05)
    found = load_rig(rig, registry.AXIS_SCHEMAS)
    (written,) = re.findall(r"torque_lag_ms: (\S+)", rig.read_text())
    stated_ms = STEPS_SHARE * 1.0  # the deviation that the calibration states at 1 kHz
    assert float(written) == pytest.approx(0.5, abs=2.0 * stated_ms)
    assert found.sensors.force_lag_ms == 5.0
    assert 0.0 < found.sensors.force_lag_deviation_ms < 0.12


def test_a_run_that_never_presses_shows_no_torque_lag(tmp_path, call):
    rig = tmp_path / "rig.yaml"
    rig.write_text(FILE.read_text())
    air = ("plant.environment.surface_m=0.055", f"rig={rig}")
    run(trial(*air, duration_s=2.0), made(tmp_path / "air"))
    code, _, err = call("calibrate", "lag", rig, tmp_path / "air", "--write")
    assert code == 2
    assert "press on something elastic" in err
    assert rig.read_text() == FILE.read_text()


def made(folder):
    folder.mkdir()
    return folder


def test_the_stamp_is_that_of_the_force_that_is_given():
    found = freed(DrivetrainConfig(), lambda _: 0.0, lambda t: 10.0 * t)
    assert found[:, 0] == pytest.approx(10.0 * found[:, 1], abs=1e-9)
    assert np.diff(found[:, 1]) == pytest.approx(1e-3)


def trial(*changes: str, duration_s: float = 5.0):
    rig = "rig=../rigs/simulated_canopen_drive.yaml"
    duration = f"duration_s={duration_s}"
    return load_trial(
        TRIAL, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, [rig, duration, *THRESHOLDS, *changes]
    )


def run(one, folder):
    write_trial(folder, one)
    outcome = run_lockstep(one, TRIAL, open_bench, folder, lambda _: None)
    return summarise(folder, one, outcome, environment_force)


def test_the_default_trial_finds_the_cube_with_the_drive_alone(tmp_path):
    summary = run(trial(), tmp_path)
    k, b = kelvin_voigt(summary)
    assert summary["safety"]["fault"]["name"] == "none"
    assert k == pytest.approx(3600, rel=0.02)
    assert b == pytest.approx(20, abs=1.0)
    assert summary["contact"]["surface_found"] == pytest.approx(0.0137, abs=0.2e-3)


FRICTION = (
    "plant.undeclared=[{effect: coulomb_friction, friction_force_N: 3.0},"
    " {effect: viscous_friction, damping_N_s_per_m: 5.0}]"
)


def test_friction_that_is_known_to_a_tenth_leaves_the_truth_within_its_interval(tmp_path):
    known = [
        "rig.axis.drivetrain.coulomb_friction_N=3.3",
        "rig.axis.drivetrain.viscous_friction_N_s_per_m=5",
        "rig.sensors.friction_deviation_N=0.33",
    ]
    summary = run(trial(FRICTION, *known, duration_s=8.0), tmp_path)
    (row,) = (row for row in summary["estimators"] if row["model"] == "kelvin-voigt")
    for name, true in (("k", 3600.0), ("b", 20.0)):
        found = row["parameters"][name]
        assert abs(found["value"] - true) < 1.96 * found["std"], name
        assert found["std"] < {"k": 100.0, "b": 5.0}[name]


@dataclass
class Effect:
    name: str
    parameters: dict[str, Parameter]
    belongs_to: str = "rig"


@dataclass
class Answer:
    effects: list[Effect] = field(default_factory=list)
    verdict: str = "no_missing_effect"


def parameter(value: float, unit: str) -> Parameter:
    return Parameter(value, 0.01, unit)


def test_what_diagnosis_finds_is_added_to_the_drivetrain_and_written():
    found = Answer(
        [
            Effect("coulomb_friction", {"friction_force": parameter(3.35, "N")}),
            Effect("tool_inertia", {"mass": parameter(0.25, "kg")}),
        ],
        "named",
    )
    rig = load_rig(FILE, registry.AXIS_SCHEMAS)
    text = with_values(FILE.read_text(), drivetrain_keys(rig, found, rig))
    assert re.search(r"coulomb_friction_N: 3\.35\n", text)
    assert re.search(r"mass_N_s2_per_m: 2\.25\n", text)
    assert re.search(r"friction_deviation_N: 0\.335\n", text)


def test_nothing_is_written_where_nothing_is_found_or_would_be_negative():
    rig = load_rig(FILE, registry.AXIS_SCHEMAS)
    with pytest.raises(CalibrationError, match="no friction and no inertia"):
        drivetrain_keys(rig, Answer(), rig)
    less = Effect("tool_inertia", {"mass": parameter(-3.0, "kg")})
    with pytest.raises(CalibrationError, match="mass would be -1, below 0"):
        drivetrain_keys(rig, Answer([less]), rig)
    sensor = load_rig(RIGS / "simulated_canopen.yaml", registry.AXIS_SCHEMAS)
    with pytest.raises(CalibrationError, match="takes no force from its drive"):
        drivetrain_keys(sensor, Answer([less]), sensor)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('"0x6041", "0x6077", "0x6064"', '"0x6041", "0x6064"'), "needs 0x6077 in drive.tpdo"),
        (("    rated_force_N: 200.0", "    # none"), "needs 0x6077 in drive.tpdo"),
        (("[position_comparison, force_comparison]", "[position_comparison]"), "force_comparison"),
        (("  force: from drive", "  force: from motor"), "axis.force: "),
    ],
)
def test_a_rig_that_cannot_know_its_force_is_refused(change, words, tmp_path):
    file = tmp_path / "rig.yaml"
    text = FILE.read_text()
    assert change[0] in text
    file.write_text(text.replace(*change))
    with pytest.raises(ConfigError, match=words):
        load_rig(file, registry.AXIS_SCHEMAS)


def test_a_wrong_key_of_a_force_sensor_is_named_alone(tmp_path):
    file = tmp_path / "rig.yaml"
    text = (RIGS / "simulated_canopen.yaml").read_text()
    file.write_text(text.replace("    scale_N_per_count: 1.0e-3\n", "    scale_N: 1.0e-3\n"))
    with pytest.raises(ConfigError) as caught:
        load_rig(file, registry.AXIS_SCHEMAS)
    assert "from drive" not in str(caught.value)
    assert "axis.force.scale_N" in str(caught.value)


def test_a_drive_of_another_rated_torque_is_refused(tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text(FILE.read_text().replace("rated_force_N: 200.0", "rated_force_N: 150.0"))
    bench = FramedBench(load_rig(file, registry.AXIS_SCHEMAS))
    with pytest.raises(AxisError, match=r"6076h\) is 200, the rig's config says 150"):
        bench.axis.configure()


@pytest.mark.parametrize("has_sensor", [True, False])
def test_doctor_does_not_take_a_motor_without_power_for_a_sensor_that_hangs(has_sensor):
    bench = FramedBench(load_rig(FILE, registry.AXIS_SCHEMAS))

    def wait():
        bench.now += MS

    found = examine_axis(bench.axis, wait, 150, has_sensor=has_sensor)
    assert any("hangs" in one.next_step for one in found) is has_sensor


@pytest.mark.parametrize("kind", ["odrive", "damiao", "dynamixel"])
def test_a_makers_drive_frees_its_force_of_the_mass(kind):
    config = load(kind)
    drive = config.axis.parts["drive"]
    changes = {"force": "from drive", "drivetrain": DrivetrainConfig(mass=1.0)}
    alone = config.model_copy(update={"axis": drive.model_copy(update=changes), "rate_hz": 1000.0})
    bench = FramedBench(alone, plant=plant_config(start=0.0, environment={"surface": 1.0}))
    bench.axis.configure()
    bench.axis.arm()
    bare, left = [], []
    for k in range(700):
        sample = bench.cycle(0.005 * (1 - np.cos(2 * np.pi * 5e-3 * max(0, k - 100))))
        if k > 200:
            bare.append(bench.simulated.plant.servo_force)
            left.append(sample.force)
    assert np.std(bare) > 1.0
    assert np.std(left) < 0.35 * np.std(bare)
