from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from teleop_rt.config.operator import HandOperator, ProfileOperator, RecordedOperator
from teleop_rt.master.build import make_operator
from teleop_rt.master.hand import Hand
from teleop_rt.master.operators import Operator, Profile
from teleop_rt.master.recorded import OperatorError, Recorded

T = 0.001
WALL = 0.02
PROFILE = ProfileOperator(
    kind="profile",
    start=0.001,
    approach_speed=0.04,
    mean=0.012,
    amplitude=0.008,
    frequency_hz=3.0,
    felt_force=0.5,
    lift_off_height=0.005,
)
HAND = HandOperator(
    kind="hand",
    intention=PROFILE,
    mass=0.3,
    stiffness=600.0,
    damping=12.0,
    tremor=0.2,
    grip_change=0.3,
)


def against_wall(operator: Operator, ticks: int, k: float = 3600.0, b: float = 20.0) -> np.ndarray:
    """Rows of position, velocity and force against a wall at WALL that is felt at once."""
    rows = np.empty((ticks, 3))
    force = 0.0
    for tick, row in enumerate(rows):
        x, v = operator.update(tick * T, force)
        depth = x - WALL
        force = max(0.0, k * depth + b * v) if depth > 0 else 0.0
        row[:] = x, v, force
    return rows


def test_the_profile_approaches_until_it_feels_the_wall() -> None:
    rows = against_wall(Profile(PROFILE), 400)
    assert rows[0, 0] == 0.001
    np.testing.assert_allclose(np.diff(rows[:, 0]), 0.04 * T, atol=1e-12)
    free = Profile(PROFILE)
    assert [free.update(t, 0.5)[0] for t in (0.0, 10.0)] == pytest.approx([0.001, 0.401])


def test_the_profile_then_presses_in_the_stated_sinusoid_from_where_it_felt_the_wall() -> None:
    rows = against_wall(Profile(PROFILE), 4000)
    felt = np.argmax(rows[:, 2] > 0.5) + 1
    origin = 0.001 + 0.04 * T * felt
    late = np.arange(2000, 4000)
    expected = origin + 0.012 + 0.008 * np.sin(2 * np.pi * 3.0 * (late - felt) * T)
    np.testing.assert_allclose(rows[late, 0], expected, atol=1e-9)


def test_the_profile_moves_without_jumps_and_its_velocity_is_that_of_its_position() -> None:
    rows = against_wall(Profile(PROFILE), 20_000)
    steps = np.diff(rows[:, 0]) / T
    mean_velocity = (rows[1:, 1] + rows[:-1, 1]) / 2
    wrong = np.abs(steps - mean_velocity) > 0.005
    assert np.count_nonzero(wrong) <= 10, "only where an approach begins, twice a cycle"
    assert np.abs(steps).max() < 0.04 + 0.008 * 2 * np.pi * 3 * 1.5
    assert np.abs(np.diff(rows[:, 1])).max() <= 0.04 + 1e-9


def test_the_profile_stays_in_contact_until_it_lifts_off_and_comes_back() -> None:
    rows = against_wall(Profile(PROFILE), 20_000)
    inside = rows[:, 0] > WALL
    onsets = np.flatnonzero(np.diff(inside.astype(int)) == 1)
    releases = np.flatnonzero(np.diff(inside.astype(int)) == -1)
    assert len(onsets) >= 4
    held_s = (releases - onsets[: len(releases)]) * T
    assert held_s.min() > 4.0
    assert held_s.max() < 4.7
    lifted = min(rows[releases[0] : onsets[1], 0])
    assert lifted == pytest.approx(WALL - 0.005, abs=0.0002)


def test_the_profile_is_the_same_after_a_reset() -> None:
    operator = Profile(PROFILE)
    first = against_wall(operator, 6000)
    operator.reset()
    np.testing.assert_array_equal(against_wall(operator, 6000), first)


def test_the_hand_presses_where_its_push_and_the_wall_balance() -> None:
    calm = HAND.model_copy(update={"tremor": 0.0, "grip_change": 0.0})
    rows = against_wall(Hand(calm, T, np.random.default_rng(1)), 5000, b=5.0)
    pressing = rows[2500:4500, 2]
    # Quasi-static: 600 (x_i - x) = 3600 (x - WALL), with x_i - WALL about 12 mm and the travel
    # of a reaction time, 6 mm, on top.
    assert pressing.mean() == pytest.approx(600 * 3600 / 4200 * 0.018, rel=0.1)


def test_the_hand_feels_one_reaction_time_late() -> None:
    late, prompt = (
        Hand(
            HAND.model_copy(update={"reaction_ms": ms, "tremor": 0.0}), T, np.random.default_rng(1)
        )
        for ms in (200.0, 0.0)
    )
    depths = [against_wall(hand, 3000)[:, 2].max() for hand in (prompt, late)]
    assert depths[1] > depths[0] + 600 * 3600 / 4200 * 0.04 * 0.15


def test_tremor_has_the_stated_force_and_frequency() -> None:
    hand = Hand(HAND, T, np.random.default_rng(1))
    tremor = np.array([hand.intend(k * T, 0.0).tremor for k in range(1, 60_001)])
    assert tremor.std() == pytest.approx(0.2, rel=0.1)
    spectrum = np.abs(np.fft.rfft(tremor)) ** 2
    frequency = np.fft.rfftfreq(tremor.size, T)
    centre = (spectrum * frequency).sum() / spectrum.sum()
    assert 8.0 < centre < 11.0


def test_the_hand_repeats_itself_for_a_seed_and_after_a_reset() -> None:
    hand = Hand(HAND, T, np.random.default_rng(5))
    first = against_wall(hand, 3000)
    hand.reset()
    np.testing.assert_array_equal(against_wall(hand, 3000), first)
    other = against_wall(Hand(HAND, T, np.random.default_rng(6)), 3000)
    assert np.abs(other - first).max() > 1e-4


def test_the_hand_is_stable_on_a_wall_that_the_bound_admits() -> None:
    rows = against_wall(Hand(HAND, T, np.random.default_rng(2)), 30_000, k=3600.0, b=20.0)
    assert np.isfinite(rows).all()
    early, late = rows[2000:8000, 2], rows[-6000:, 2]
    assert late.max() < 1.3 * early.max()


def write_csv(path: Path) -> None:
    t = np.arange(2000) * 0.001
    table = np.column_stack([t + 46.0, np.sin(2 * np.pi * t), 1e3 * t])
    np.savetxt(path, table, delimiter=",", header="t_s,xm_rad,other", comments="")


def recorded(folder: Path, **keys: object) -> Recorded:
    values = {"kind": "recorded", "file": "run.csv", "position_column": "xm_rad", **keys}
    return Recorded(RecordedOperator.model_validate(values), folder)


def test_a_recording_is_played_by_its_time_and_stays_at_its_end(tmp_path: Path) -> None:
    write_csv(tmp_path / "run.csv")
    operator = recorded(tmp_path, position_scale=-2.0)
    for t in (0.1, 0.1234, 1.7):
        x, v = operator.update(t, 0.0)
        assert x == pytest.approx(-2 * np.sin(2 * np.pi * t), abs=1e-4)
        assert v == pytest.approx(-4 * np.pi * np.cos(2 * np.pi * t), abs=0.01)
    x, v = operator.update(5.0, 0.0)
    assert x == pytest.approx(-2 * np.sin(2 * np.pi * 1.999))
    assert v == 0.0


def test_a_recording_that_cannot_be_played_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_csv(tmp_path / "run.csv")
    (tmp_path / "text.csv").write_text("t_s,xm_rad\n1,two\n")
    (tmp_path / "nan.csv").write_text("t_s,xm_rad\n1,nan\n")
    (tmp_path / "short.csv").write_text("t_s,xm_rad\n1,1\n2,2\n")
    monkeypatch.delenv("TELEOP_RT_DATA", raising=False)
    for keys, message in (
        ({"file": "none.csv"}, "none.csv"),
        ({"position_column": "xs"}, "no column 'xs'.*xm_rad"),
        ({"file": "text.csv"}, "not a table"),
        ({"file": "nan.csv"}, "not finite"),
        ({"file": "short.csv"}, "21 samples"),
        ({"file": "${TELEOP_RT_DATA}/a.csv"}, "TELEOP_RT_DATA"),
    ):
        with pytest.raises(OperatorError, match=message):
            recorded(tmp_path, **keys)


def test_the_measured_masters_motion_can_be_played() -> None:
    if "TELEOP_RT_DATA" not in os.environ:
        pytest.skip("TELEOP_RT_DATA is not set: no measured data")
    operator = recorded(Path(), file="${TELEOP_RT_DATA}/tue_teleop/run_a_spring.csv")
    assert operator.update(0.0, 0.0)[0] == pytest.approx(-0.0252584)
    times = np.arange(0, operator.duration_s, 0.0005)
    motion = np.array([operator.update(t, 0.0) for t in times])
    np.testing.assert_allclose(
        np.cumsum(motion[:, 1]) * 0.0005, motion[:, 0] - motion[0, 0], atol=2e-3
    )


@pytest.mark.parametrize(("config", "kind"), [(PROFILE, Profile), (HAND, Hand)])
def test_a_trials_operator_is_built(config, kind: type) -> None:
    operator = make_operator(config, folder=Path(), period_s=T, rng=np.random.default_rng(1))
    assert isinstance(operator, kind)


def test_a_hand_pulls_with_no_more_than_an_adult_can_and_else_as_before() -> None:
    calm = HAND.model_copy(update={"tremor": 0.0, "grip_change": 0.0, "force_max": 40.0})
    free = calm.model_copy(update={"force_max": 400.0})
    hands = [Hand(config, T, np.random.default_rng(1)) for config in (calm, free)]
    held = [[hand.update(tick * T, 0.0) for tick in range(100)] for hand in hands]
    assert held[0] == held[1]
    for hand in hands:  # against 60 N, of which the first cannot give more than 40
        for tick in range(100, 1100):
            hand.update(tick * T, 60.0)
    velocity = [hand.update(1.1, 60.0)[1] for hand in hands]
    assert velocity[0] < -20.0
    assert abs(velocity[1]) < 0.5
