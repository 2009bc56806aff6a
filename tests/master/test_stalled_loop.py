"""Stalls of the master's loop while a hand holds its device: no step of force, then let go."""

import pytest

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_dev.paths import SILICONE

HANDLE = SILICONE.parent / "handle.yaml"
MS = 1_000_000
HARDWARE = "operator.rig.realtime.late={hold_ms: 5, stop_ms: 20, stop_share: 0.2}"


class World:
    """Slave and master in lock-step; the master's loop can be held up."""

    def __init__(self, ring_folder, *changes):
        trial = load_trial_file(HANDLE, [HARDWARE, "link.round_trip_ms=20", *changes])
        self.run = LockstepTrial(trial, HANDLE.parent, open_bench, ring_folder)
        self.side = self.run.master
        self.master = self.side.master
        self.device = self.side.operator
        self.limits = trial.master
        self.run.slave.configure()

    @property
    def force(self):
        return self.master.force

    def tick(self, master=True, skipped=0):
        self.run.clock.move_to(self.run.clock.now_ns() + MS)
        self.run.slave.cycle()
        if self.run.slave.safety.state.name == "DISARMED":
            self.run.slave.arm()
        if master:
            self.side.cycle(skipped)

    def press_in(self):
        """Go on until the hand presses on the wall and moves deeper."""
        for _ in range(8000):
            before = self.force
            self.tick()
            if self.force > 10.0 and self.force - before > 0.1:
                return self
        raise AssertionError(f"never pressed: {self.force}")

    def stall(self, ms):
        for _ in range(ms):
            self.tick(master=False)
        self.tick(skipped=ms)


@pytest.fixture
def world(tmp_path):
    made = World(tmp_path)
    yield made.press_in()
    made.side.let_go()


def law(world):
    """The force of the walls at the hand, which nothing limits."""
    return world.master.adoption.elastic_force(world.master.x)


@pytest.mark.parametrize("ms", [8, 15])
@pytest.mark.parametrize("force_step", [0.5, 0.1])
def test_after_a_stall_the_force_makes_up_for_it_by_steps_and_follows_the_hand(
    tmp_path, ms, force_step
):
    """The hand's own motion may change the force by more than a step: it does at 0.1 N."""
    world = World(tmp_path, f"master.force_step_N={force_step}").press_in()
    before, wanted = world.force, law(world)
    world.stall(ms)
    own, beyond = [], []
    for tick in range(60):
        rise, law_rise = world.force - before, law(world) - wanted
        beyond.append(rise - (max(0.0, law_rise) if tick > 2 else 0.0))
        own.append(law_rise if tick > 2 else 0.0)
        before, wanted = world.force, law(world)
        world.tick()
    world.side.let_go()
    assert max(beyond) <= force_step + 0.05  # N, of damping, which `law` leaves out
    assert max(own) > 0.1
    assert world.force > law(world) - 0.05, "all of it is made up for"


def test_a_device_left_on_its_last_force_for_too_long_is_let_go_and_the_cause_reported(world):
    world.stall(20)
    for _ in range(3):
        world.tick()
    assert not world.device.powered
    result = world.side.outcome()["late"]
    assert result["stop"]["bound"] == "stop_ms"
    assert result["stop"]["stall_ms"] == 20.0


def test_a_device_within_its_bounds_is_held_on_to(world):
    world.stall(19)
    for _ in range(100):
        world.tick()
    assert world.device.powered
    result = world.side.outcome()["late"]
    assert (result["holds"], result["stop"]) == (1, None)
