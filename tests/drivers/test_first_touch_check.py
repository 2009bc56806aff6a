"""`check` states how stiff an unknown wall may be, and at which speed it is met."""

import re

import pytest

from teleop_rt_dev.trial.files import silicone
from teleop_rt_drivers.check import check_first_touch

CAP = "slave.force_cap 90 N is kept on an unknown wall of up to "
SPEED = re.compile(r"([\d.]+) N/m: the tool is no faster than ([\d.]+) m/s where it has not been")
STIFFNESS = re.compile(r"(\d+) N/m, at up to ([\d.]+) m/s; limits.stiffness_max_N_per_m would")


def stated(*changes: str, form: re.Pattern[str] = SPEED) -> tuple[float, float]:
    (found,) = check_first_touch(silicone(*changes))
    assert found.severity == "ok"
    assert found.what.startswith(CAP)
    said = form.match(found.what.removeprefix(CAP))
    assert said is not None, found.what
    return float(said[1]), float(said[2])


def test_the_stiffest_wall_of_the_rig_is_met_at_the_speed_that_the_theory_states():
    assert stated() == (40e3, 0.215)


def test_a_softer_bound_allows_a_faster_tool_up_to_the_rig_s_own():
    speeds = [stated(f"rig.limits.stiffness_max_N_per_m={k}")[1] for k in (40e3, 20e3, 10e3, 10.0)]
    assert speeds == sorted(set(speeds))
    assert speeds[-1] == silicone().rig.limits.velocity_max


def test_without_a_bound_the_stiffest_wall_at_full_speed_is_stated_and_how_to_slow_the_tool_down():
    stiffness, fastest = stated("rig.limits.stiffness_max_N_per_m=null", form=STIFFNESS)
    assert fastest == silicone().rig.limits.velocity_max
    bounded = stated(f"rig.limits.stiffness_max_N_per_m={stiffness}")[1]
    assert bounded == pytest.approx(fastest, rel=0.01)


def test_a_mode_without_a_model_makes_no_such_promise():
    assert check_first_touch(silicone("mode=direct")) == []
