"""A simulated wall that a trial cannot meet is explained, before the run and after it."""

import pytest

from teleop_rt.config.thousandths import meant_in_thousandths
from teleop_rt.shipped import example, example_names

OUT_OF_REACH = ("plant.environment.surface_m=0.5", "surface at 0.5 m is beyond limits.position_max")
INSIDE = ("plant.environment.surface_m=-1", "the tool starts at 0 m, inside the body, whose")
WALLS = [
    OUT_OF_REACH,
    ("plant.environment.surface_m=13.7", "below it (in mm? 13.7 mm are 0.0137 m)"),
    INSIDE,
    ("plant.start_m=0.02", "set plant.environment.surface_m above plant.start_m"),
    ("plant.environment.surface_m=0.05", "past limits.position_max 0.06 m"),
    ("plant.environment.stiffness_N_per_m=80000", "is above limits.stiffness_max 40000"),
    ("plant.environment.stiffness_N_per_m=80000", "would press with 1600 N"),
]


@pytest.mark.parametrize(("change", "said"), WALLS)
def test_check_warns_of_a_wall_that_is_not_met(change, said, call):
    code, out, _ = call("check", "silicone_cube", "--set", change)
    assert code == 0
    (line,) = (line for line in out.splitlines() if said in line)
    assert line.startswith("warning")


def test_check_is_silent_on_the_walls_of_every_shipped_trial(call, monkeypatch):
    monkeypatch.setenv("TELEOP_RT_DATA", "/nowhere")
    for name in example_names("trials"):
        _, out, _ = call("check", example("trials", name))
        assert not [line for line in out.splitlines() if "plant." in line or " operator:" in line]


@pytest.mark.usefixtures("no_pages")
@pytest.mark.parametrize(("change", "said"), [OUT_OF_REACH, INSIDE])
def test_the_summary_explains_a_wall_that_is_not_met(change, said, call):
    changes = ("--set", change, "--set", "duration_s=0.5")
    _, out, _ = call("run", "silicone_cube", "--clock", "simulated", *changes, "--out", "run")
    lines = out.splitlines()
    assert [line for line in lines if "note" in line and said in line]
    assert [line for line in lines if line.startswith("!  model ") and "none selected" in line]


def test_a_motion_in_millimetres_is_refused_with_its_units_and_a_question(call):
    changes = ("--set", "operator.mean_m=12", "--set", "operator.amplitude_m=8")
    code, _, err = call("check", "silicone_cube", *changes)
    assert code != 0
    assert "make 20 m of penetration, and rig.limits leave a range of 0.12 m: lower them" in err
    assert "(in mm? 12 mm are 0.012 m and 8 mm are 0.008 m)" in err


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((0.5,), ""),
        ((200.0,), ""),
        ((8.0, 0.01), " (in mrad? 8 mrad are 0.008 rad)"),
        ((-8.0,), " (in mrad? -8 mrad are -0.008 rad)"),
    ],
)
def test_only_values_that_fit_as_thousandths_are_asked_for(values, said):
    assert meant_in_thousandths(values, 0.12, "rad") == said
