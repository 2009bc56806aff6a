"""Two measurements of one quantity must agree while there is power, on every driver."""

from __future__ import annotations

import math

import pytest

from teleop_rt.axis import Sample
from teleop_rt.config.rig import Limits
from teleop_rt.config.supervision import SupervisionConfig
from teleop_rt.slave import faults
from teleop_rt.slave.faults import State
from teleop_rt.slave.record import TickRecord
from teleop_rt.slave.supervision import Supervision, beyond_friction
from teleop_rt.trial.bench import Bench
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_dev.trial.files import SILICONE, silicone
from teleop_rt_drivers import opening
from teleop_rt_drivers.simulated.plant import Plant

TWO_ENCODERS = ("canopen", "serial", "raw_can", "mixed")
MAKERS = ("odrive", "damiao", "robstride", "moteus", "vesc", "dynamixel", "feetech")
RIGS = (*TWO_ENCODERS, *MAKERS)
LIMITS = Limits(
    position_min=-0.06, position_max=0.06, velocity_max=1.5, acceleration_max=60.0, force_max=120.0
)
MS = 1_000_000


class Rig:
    """The silicone trial in lock-step, its master followed, with hands on the plant."""

    def __init__(self, folder, rig: str, *changes: str) -> None:
        trial = silicone(f"rig=../rigs/simulated_{rig}.yaml", "link.round_trip_ms=0", *changes)
        self.trial = LockstepTrial(trial, SILICONE.parent, self.open, folder)
        self.slave = self.trial.slave
        self.slave.configure()
        while self.slave.safety.state != State.RUN:
            self.trial.step()
        self.ticks(300)

    def open(self, trial, now_ns) -> Bench:
        axis, self.rig = opening.open_lock_step(trial.rig, trial.plant, now_ns, trial.seed)
        return Bench(axis)

    @property
    def plant(self):
        return self.rig.plant

    def ticks(self, count: int, each=lambda: None) -> int:
        """Step so many ticks, or until the axis stops; return how many it took."""
        first = self.slave.tick
        while self.slave.tick - first < count and self.slave.safety.fault is faults.NO_FAULT:
            self.trial.step()
            each()
        return self.slave.tick - first

    def lead(self, velocity: float) -> None:
        """Let the master lead at this velocity from here on, whatever the slave feels."""
        first, here = self.slave.tick, self.slave.limiter.position

        class Led(type(self.trial.slave_endpoint)):
            def poll(led) -> None:
                super().poll()
                heard = led.newest_motion.stored[0]
                heard.target = here + velocity * (self.slave.tick - first) * 1e-3
                heard.contact_id = 2**62

        self.trial.slave_endpoint.__class__ = Led
        self.slave.record.tick.force_cap = math.inf  # no guard

    @property
    def stopped(self) -> tuple[str, State]:
        self.trial.step()
        return self.slave.safety.fault.name, self.slave.safety.state


@pytest.mark.parametrize("rig", RIGS)
def test_a_jammed_tool_stops_the_axis_before_it_shoots_off(tmp_path, rig):
    world = Rig(tmp_path, rig)
    stuck = world.plant.position
    world.lead(-0.2)

    def jam() -> None:
        world.plant.place(stuck, 0.0)

    assert world.ticks(400, jam) < 200
    assert world.stopped[0] in {"following_error", "force_mismatch"}
    fastest = 0.0
    for _ in range(300):
        world.trial.step()
        fastest = max(fastest, abs(world.plant.velocity))
    assert not world.rig.drive.powered
    assert fastest < 1.5


@pytest.mark.parametrize("rig", RIGS)
def test_a_tool_that_is_torn_away_stops_the_axis(tmp_path, rig):
    world = Rig(tmp_path, rig)

    def tear() -> None:
        world.plant.place(world.plant.position - 2.3e-3, -2.3)

    assert world.ticks(100, tear) <= 30
    assert world.stopped[0] in {"overspeed", "position_mismatch"}


@pytest.mark.parametrize("rig", TWO_ENCODERS)
def test_a_coupling_that_slips_stops_the_axis(tmp_path, rig, monkeypatch):
    world = Rig(tmp_path, rig)
    kind, slipped = type(world.plant), [0.0]
    counts = kind.drive_counts.fget
    per_m = 1.0 / world.plant.config.drive.position_resolution
    monkeypatch.setattr(kind, "drive_counts", property(lambda p: counts(p) + slipped[0] * per_m))

    def slip() -> None:
        slipped[0] += 2e-5

    assert world.ticks(1000, slip) < 400
    assert world.stopped[0] == "position_mismatch"


@pytest.mark.parametrize("rig", ["canopen", "mixed"])
def test_a_drive_whose_status_never_comes_stops_the_axis_while_its_heartbeat_is_alive(
    tmp_path, rig
):
    world = Rig(tmp_path, rig)
    world.rig.inject("mute_pdo", "drive")
    assert world.ticks(200) <= 30
    assert world.stopped[0] == "drive_silent"


@pytest.mark.parametrize("rig", MAKERS)
def test_a_force_sensor_that_gives_a_hundredth_stops_the_axis_by_the_drives_torque(tmp_path, rig):
    world = Rig(tmp_path, rig, "rig.axis.parts.sensor.force.scale_N_per_unit=0.01")
    world.lead(0.02)
    forces = []
    world.ticks(4000, lambda: forces.append(world.plant.force))
    assert world.stopped[0] == "force_mismatch"
    assert 20.0 < max(forces) < 60.0, "it pressed, and stopped far below force_max"


@pytest.mark.parametrize("rig", ["canopen", "unreferenced"])
def test_a_force_sensor_that_sticks_stops_the_axis_by_the_drives_torque(tmp_path, rig):
    world = Rig(tmp_path, rig)
    world.rig.inject("freeze", "force sensor")
    world.lead(0.02)
    forces = []
    world.ticks(4000, lambda: forces.append(world.plant.force))
    assert world.stopped[0] == "force_mismatch"
    assert 20.0 < max(forces) < 60.0, "it pressed, and stopped far below force_max"


GUIDE_N = 40.0
NARROW = "rig.supervision.force_difference_max_N=20.0"
KNOWN = f"rig.supervision.coulomb_friction_N={GUIDE_N}"


@pytest.fixture
def tight_guide(monkeypatch):
    """Let the drive's force hold dry friction, too, of which the force sensor feels nothing."""
    kind = Plant
    force = kind.servo_force.fget
    monkeypatch.setattr(
        kind,
        "servo_force",
        property(lambda plant: force(plant) + math.copysign(GUIDE_N, plant.velocity)),
    )


@pytest.mark.usefixtures("tight_guide")
@pytest.mark.parametrize("rig", ["canopen", "unreferenced"])
def test_friction_that_is_declared_is_no_difference_and_a_stuck_sensor_still_is(tmp_path, rig):
    world = Rig(tmp_path, rig, KNOWN, NARROW)
    world.ticks(700)
    assert world.slave.safety.fault is faults.NO_FAULT
    world.rig.inject("freeze", "force sensor")
    world.lead(0.02)
    before = world.plant.force
    assert world.ticks(4000) < 4000
    assert world.stopped[0] == "force_mismatch"
    assert world.plant.force - before < 2 * 20.0


@pytest.mark.usefixtures("tight_guide")
def test_friction_that_is_not_declared_is_a_difference(tmp_path):
    world = Rig(tmp_path, "canopen", NARROW)
    world.ticks(700)
    assert world.stopped[0] == "force_mismatch"


@pytest.mark.parametrize(
    ("velocity", "friction"),
    [(0.5, 14.0), (-0.5, -14.0), (0.02, 12.08), (0.01, 12.04), (0.01, -11.96), (0.0, 5.0)],
)
def test_friction_is_against_the_motion_and_of_either_sign_at_rest(velocity, friction):
    config = SupervisionConfig(coulomb_friction=12.0, viscous_friction=4.0)
    record = TickRecord()
    Supervision(config, LIMITS, 1000, record=record)
    assert beyond_friction(record.tick, friction, velocity) == pytest.approx(0.0, abs=1e-12)
    assert abs(beyond_friction(record.tick, -40.0, velocity)) > 25.0
    assert math.isnan(beyond_friction(record.tick, math.nan, velocity))
    assert math.isnan(beyond_friction(record.tick, 1.0, math.nan))


def agreeing() -> Sample:
    return Sample(enabled=True, drive_position=0.0, drive_force=0.0, position_stamp_ns=0)


def checked(change, ticks: int = 400) -> faults.Fault | None:
    """The first fault of a supervision whose sample `change` spoils after 100 ticks."""
    supervision = Supervision(SupervisionConfig(), LIMITS, 1000)
    sample = agreeing()
    for tick in range(ticks):
        sample.position_stamp_ns += MS
        position, command = change(sample) if tick > 100 else (0.0, 0.0)
        position += 1e-9 * (tick % 2)  # a living sensor
        fault = supervision.check(sample, position, command, follows=True)
        if fault is not None:
            return fault
    return None


def spoil(**values):
    def change(sample: Sample) -> tuple[float, float]:
        for name, value in values.items():
            setattr(sample, name, value)
        return 0.0, 0.0

    return change


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (spoil(), None),
        (spoil(force=30.0, drive_force=45.0), None),
        (spoil(force=0.0, drive_force=45.0), faults.FORCE_MISMATCH),
        (spoil(force=60.0, drive_force=0.6), faults.FORCE_MISMATCH),
        (spoil(drive_force=math.nan), faults.FORCE_MISMATCH),
        (spoil(force=math.nan), faults.FORCE_MISMATCH),
        (spoil(drive_position=0.005), None),
        (spoil(drive_position=0.007), faults.POSITION_MISMATCH),
        (spoil(drive_position=math.nan), faults.POSITION_MISMATCH),
        (spoil(enabled=False), faults.DRIVE_SILENT),
        (lambda _: (0.0, 0.0061), faults.FOLLOWING_ERROR),
        (lambda _: (0.0, 0.0059), None),
        (lambda _: (0.0, math.nan), faults.FOLLOWING_ERROR),
        (lambda _: (math.nan, 0.0), faults.OVERSPEED),
    ],
)
def test_each_comparison_has_its_bound_and_no_number_that_is_none_passes_one(change, fault):
    assert checked(change) is fault


def repeated(moved: float, step: float = 0.0, every_ms: int = 1, **settings) -> int | None:
    """Return after how many ms a position that stays is found; the command moves at 0.11 m/s.

    It moves on for `moved`; `step` changes the position by so much now and then, and a new sample
    comes `every_ms`.
    """
    alone = ("position_comparison", "force_comparison")
    supervision = Supervision(SupervisionConfig(**settings), LIMITS, 1000, alone, resolution=4e-5)
    sample = Sample(enabled=True)
    for tick in range(1000):
        if tick % every_ms == 0:
            sample.position_stamp_ns = (1 + tick) * MS
        command, position = min(1.1e-4 * tick, moved), step * (tick // 20 % 2)
        if fault := supervision.check(sample, position, command, follows=True):
            assert fault is faults.POSITION_REPEATED
            return tick
    return None


def test_a_position_that_is_one_number_while_the_command_moves_is_an_old_answer():
    assert repeated(0.0013) == 11 + 51  # beyond 1.2 mm of 120, then more than 50 ms
    assert repeated(0.0011) is None
    assert repeated(0.0013, step=4e-5) is None, "a step of the sensor is motion"
    assert repeated(0.003, repeated_position_max=0.002) == 19 + 51
    assert repeated(0.003, repeated_position_ms=100) == 11 + 101


@pytest.mark.parametrize(("moved", "found"), [(0.0, None), (0.0013, faults.POSITION_REPEATED)])
def test_before_the_first_command_no_position_is_an_old_answer(moved, found):
    alone = ("position_comparison", "force_comparison")
    supervision = Supervision(SupervisionConfig(), LIMITS, 1000, alone)
    sample, seen = Sample(enabled=True), None
    for tick in range(200):
        sample.position_stamp_ns = (1 + tick) * MS
        command = float("nan") if tick == 0 else moved if tick > 50 else 0.0
        seen = seen or supervision.check(sample, 0.0, command, follows=True)
    assert seen is found


def test_a_slow_sensor_is_judged_by_its_new_values_alone():
    assert repeated(0.0013, every_ms=45) == 135  # 45 ms is the first since the command has left
    assert repeated(0.0013, every_ms=60) == 120
    assert repeated(0.0013, every_ms=600) is None


@pytest.mark.parametrize("rig", MAKERS)
def test_a_drive_that_repeats_its_last_answer_is_found_before_the_axis_is_far(tmp_path, rig):
    world = Rig(tmp_path, rig)
    world.rig.inject("freeze", "drive")
    here = world.plant.position
    furthest = []
    assert world.ticks(400, lambda: furthest.append(abs(world.plant.position - here))) < 400
    assert world.stopped[0] in {"position_repeated", "force_mismatch", "samples_lost"}
    assert max(furthest) < 0.008


@pytest.mark.parametrize(("velocity", "fault"), [(1.8, None), (1.9, faults.OVERSPEED)])
def test_the_measured_velocity_has_a_bound(velocity, fault):
    alone = ("position_comparison", "force_comparison")
    supervision = Supervision(SupervisionConfig(), LIMITS, 1000, alone)
    sample = Sample(enabled=True, position_stamp_ns=MS)
    found = None
    for tick in range(60):
        sample.position_stamp_ns += MS
        position = velocity * tick * 1e-3
        found = found or supervision.check(sample, position, position, follows=True)
    assert found is fault


@pytest.mark.parametrize(("settings", "ticks"), [({}, 3000), ({"drive_enable_ms": 200}, 200)])
def test_an_armed_axis_waits_for_its_drive_s_power_no_longer_than_enabling_may_take(
    settings, ticks
):
    supervision = Supervision(SupervisionConfig(**settings), LIMITS, 1000)
    off = Sample(enabled=False, drive_position=None, drive_force=None)
    for _ in range(3):
        supervision.reset()
        found = [supervision.check(off, 0.0, 0.0, follows=False) for _ in range(ticks + 1)]
        assert found == [*[None] * ticks, faults.DRIVE_SILENT]


@pytest.mark.parametrize("rig", ["damiao", "robstride", "dynamixel", "feetech"])
def test_a_drive_that_refuses_power_does_not_get_it_minutes_later(tmp_path, rig):
    trial = silicone(f"rig=../rigs/simulated_{rig}.yaml", "rig.supervision.drive_enable_ms=300")
    opened = []

    def open_bench(trial, now_ns) -> Bench:
        axis, simulated = opening.open_lock_step(trial.rig, trial.plant, now_ns, trial.seed)
        opened.append(simulated)
        return Bench(axis)

    world = LockstepTrial(trial, SILICONE.parent, open_bench, tmp_path)
    (simulated,) = opened
    simulated.inject("refuse_enable", "drive")
    world.slave.configure()
    ticks = 0
    while world.slave.safety.state != State.FAULT:
        world.step()
        ticks += 1
        assert ticks < 1000
    assert world.slave.safety.fault is faults.DRIVE_SILENT
    simulated.heal("drive")
    for _ in range(300):
        world.step()
        assert not simulated.drive.powered


def test_an_axis_without_power_or_a_second_measurement_has_nothing_to_compare():
    supervision = Supervision(SupervisionConfig(), LIMITS, 1000)
    off = Sample(enabled=False, drive_position=None, drive_force=None)
    for _ in range(1000):
        assert supervision.check(off, 0.0, 1.0, follows=False) is None
