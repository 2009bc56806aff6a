"""Stalls of the slave's loop on simulated time: hold, no step after the gap, stop.

The drive executes its last command within a period and then stands there, so the velocity that a
command asks for after a gap counts from rest.
"""

from contextlib import closing

import pytest

from teleop_rt.slave.faults import State
from teleop_rt_dev.faults.world import FaultWorld

HARDWARE = ("rig.realtime.late={hold_ms: 5, stop_ms: 20, stop_share: 0.2}",)
UNKNOWN_ZEROS = ("plant.sensors.encoder_zero_m=-0.0213", "plant.drive.zero_m=0.0087")
PERIOD_S = 1e-3
AFTER = 60
"""Ticks looked at after the gap: the axis has caught up by then."""


class Commands:
    """Every position that the drive is commanded to, with the tick at which it is."""

    def __init__(self, world: FaultWorld) -> None:
        self.sent: list[tuple[int, float]] = []
        write = world.axis.write

        def writing(position: float) -> None:
            self.sent.append((world.slave.tick, position))
            write(position)

        world.axis.write = writing

    def check(self, limits) -> float:
        """Assert the limits at each command; return the fastest velocity after a gap."""
        (_, first), (_, second) = self.sent[:2]
        velocity, fastest = (second - first) / PERIOD_S, 0.0  # it was moving already
        for (before_tick, before), (tick, position) in zip(self.sent, self.sent[1:], strict=False):
            if tick - before_tick > 1:
                velocity = 0.0  # the drive has stood
            asked = (position - before) / PERIOD_S
            assert abs(asked) <= limits.velocity_max * (1 + 1e-9)
            assert abs(asked - velocity) <= limits.acceleration_max * PERIOD_S * (1 + 1e-6)
            velocity, fastest = asked, max(fastest, abs(asked))
        return fastest


def led_into(tmp_path, phase, *overrides):
    return closing(FaultWorld(tmp_path, "canopen", 1, *overrides).lead_to(phase))


@pytest.mark.parametrize("phase", ["approach", "contact", "release"])
@pytest.mark.parametrize("stall_ms", [3, 8, 15])
def test_after_a_stall_the_axis_goes_on_by_its_own_limits_while_the_master_moves_on(
    tmp_path, stall_ms, phase
):
    with led_into(tmp_path, phase, *HARDWARE) as world:
        commands = Commands(world)
        world.until(lambda: False, 5)
        before = commands.sent[-1][1]
        world.jump(stall_ms)
        world.tick()
        held = stall_ms >= 5
        assert world.state is (State.HOLD if held else State.RUN)
        if held:
            assert commands.sent[-1][1] == before
        assert world.until(lambda: world.state is State.RUN, 2) == 1
        assert world.until(lambda: world.state is not State.RUN, AFTER) == -1
        fastest = commands.check(world.trial.rig.limits)
    assert fastest > 0.0


@pytest.mark.parametrize(("stall_ms", "stops_at"), [(30, 20), (60, 50)])
def test_a_stall_as_long_as_the_rig_allows_stops_within_the_tick_and_commands_no_more(
    tmp_path, stall_ms, stops_at
):
    late = f"rig.realtime.late={{hold_ms: 5, stop_ms: {stops_at}, stop_share: 1}}"
    with led_into(tmp_path, "contact", late) as world:
        world.jump(stops_at - 1)
        world.tick()
        assert world.state is State.HOLD
        assert world.until(lambda: False, 30) == -1
        commands = Commands(world)
        world.jump(stall_ms)
        world.tick()
        assert (world.state, world.fault) == (State.SAFE_STOP, "late_ticks")
        world.until(lambda: False, 300)
        assert commands.sent == []
        assert world.axis.last == "stop"
        assert world.stopped


def test_stalls_that_come_often_stop_hardware_and_not_the_simulated_rig(tmp_path):
    def until_stopped(folder, *overrides) -> int:
        folder.mkdir()
        with led_into(folder, "contact", *overrides) as world:
            for count in range(60):
                world.jump(4)
                world.until(lambda: False, 10)
                if world.fault == "late_ticks":
                    return count + 1
            return 0

    assert until_stopped(tmp_path / "hardware", *HARDWARE) == 50  # 200 of 1000 ticks
    assert until_stopped(tmp_path / "simulated") == 0


def test_homing_goes_on_from_rest_after_a_stall(tmp_path):
    slowly = "rig.limits.acceleration_max_m_per_s2=5"  # ten ticks to the speed of homing
    world = FaultWorld(tmp_path, "unreferenced", 1, *HARDWARE, *UNKNOWN_ZEROS, slowly)
    with closing(world):
        world.slave.configure()
        world.reach(lambda: world.state is State.DISARMED and world.slave.reference.tared)
        assert world.slave.arm()
        world.reach(lambda: world.slave.sample.enabled)
        world.until(lambda: False, 100)  # it seeks its switch at full speed
        commands = Commands(world)
        world.until(lambda: False, 5)
        world.jump(8)
        world.until(lambda: False, 50)
        assert world.state is State.ARMED
        assert commands.check(world.trial.rig.limits) == pytest.approx(0.05, rel=0.01)
