"""Walls beyond the bound, and the part of them that is rendered."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from teleop_rt.master.passivity import CALM_SHARE, STIFFEST_SHARE, PassivityBound, Port
from teleop_rt.master.wall_limiter import WallLimiter, largest_slopes
from teleop_rt.master.walls import Wall

T = 0.001
DIFFERENCE = Port(T, damping=5.0, velocity="difference")


@settings(deadline=None)
@given(
    st.floats(0, 1e6),
    st.floats(0, 1e4),
    st.floats(0, 50),
    st.sampled_from(["measured", "difference"]),
    st.floats(0, 0.01),
    st.sampled_from([0.0, 30.0, 200.0]),
)
def test_what_is_left_after_reduction_satisfies_the_bound(
    k: float, b: float, available: float, velocity: str, delay_s: float, cutoff_hz: float
) -> None:
    port = Port(T, available, velocity=velocity, delay_s=delay_s, cutoff_hz=cutoff_hz)
    bound = PassivityBound(port)
    reduced_k, reduced_b = bound.reduce(k, b)
    assert 0 <= reduced_k <= k
    assert 0 <= reduced_b <= b
    assert bound.required_damping(reduced_k, reduced_b) <= available * (1 + 1e-4) + 1e-9
    if bound.required_damping(k, b) <= available:
        assert (reduced_k, reduced_b) == (k, b)


def test_damping_is_reduced_before_stiffness() -> None:
    bound = PassivityBound(DIFFERENCE)
    assert bound.reduce(3600.0, 20.0) == pytest.approx((3600.0, 3.2), rel=1e-3)
    stiffness, damping = bound.reduce(STIFFEST_SHARE * 10_000.0, 20.0)
    assert stiffness == pytest.approx(STIFFEST_SHARE * 10_000.0, rel=1e-6)
    assert damping == pytest.approx(0.0, abs=0.01)


def test_beside_a_raw_difference_little_fits_and_a_tenth_of_the_bound_is_all_that_is_given() -> (
    None
):
    bound = PassivityBound(DIFFERENCE)
    assert bound.reduce(20_000.0, 20.0) == pytest.approx((CALM_SHARE * 10_000.0, 0.5), rel=1e-3)


LATE = [(8.0, 0.00045), (12.0, 0.00045), (12.0, 0.001), (12.0, 0.0015)]
"""Damping and latency about as the shipped handles have them."""


def late_port(damping: float, delay_s: float) -> Port:
    return Port(T, damping, "difference", 30.0, delay_s)


@pytest.mark.parametrize(("device", "delay_s"), LATE)
@pytest.mark.parametrize("wall", [Wall(0.0, 20_000.0), Wall(0.0, 6e4, 9e3, 1.2, damping_power=1.2)])
def test_a_wall_beyond_the_bound_gives_back_the_damping_that_its_latency_takes(
    wall: Wall, device: float, delay_s: float
) -> None:
    """Of the device's friction nothing was left at the bound, and a hand rang by itself.

    At 0.999 of the bound no more than 0.7 of it fitted, and a hand that reacts late rang on.
    """
    limiter = WallLimiter(late_port(device, delay_s), 100.0, 1.5)
    rendered = limiter.apply(wall)
    stiffness, damping = largest_slopes(rendered, 100.0, 1.5)
    bound = PassivityBound(late_port(device, delay_s))
    assert stiffness >= CALM_SHARE * bound.stiffness_max
    assert bound.required_damping(stiffness, damping) <= device * (1 + 1e-6)
    shallow = rendered.force(1e-4, 1e-6) - rendered.force(1e-4, 0.0)
    taken = stiffness * (delay_s + 0.5 * T)
    assert shallow / 1e-6 >= 0.99 * taken


@pytest.mark.parametrize("power", [0.0, 1.2])
def test_damping_that_calms_a_wall_is_reported_as_rendered_beyond_the_true_one(
    power: float,
) -> None:
    wall = Wall(0.0, 6e4 if power else 20_000.0, 0.0, 1.2 if power else 1.0)
    limiter = WallLimiter(late_port(12.0, 0.001), 100.0, 1.5)
    rendered = limiter.apply(replace(wall, damping_power=power))
    bound = limiter.rendered_bound
    assert bound.true_damping == rendered.b == 0.0
    assert bound.rendered_damping == rendered.calming > 0.0


@pytest.mark.parametrize(("device", "delay_s"), LATE)
def test_damping_makes_no_step_where_an_estimate_crosses_the_bound(
    device: float, delay_s: float
) -> None:
    limiter = WallLimiter(late_port(device, delay_s), 100.0, 1.5)
    most = limiter.stiffness_max
    dampings = []
    for stiffness in np.linspace(0.98 * most, 1.2 * most, 221):
        rendered = limiter.apply(Wall(0.0, float(stiffness), 0.0))
        dampings.append(rendered.b + rendered.calming)
    assert dampings[0] == 0.0
    assert dampings[-1] > 0.4 * device
    assert max(np.abs(np.diff(dampings))) < 0.02 * device


def ringing(damping: float, wall: Wall, device: float, delay_s: float) -> float:
    """Return how much of a swing of a hand of 2.65 kg is left after one period, on a late device.

    2000 N/m and 14 N s/m hold it; motion is sampled, and force answers it a latency later.
    """
    h, mass, grip = T / 20, 2.85, 2000.0
    x, v, rate, before = 1e-3, 0.0, 0.0, 1e-3
    force, due = 0.0, []
    pole = math.exp(-2 * math.pi * 30.0 * T)
    tops = [x]
    for step in range(8000):
        if step % 20 == 0:
            rate += (1 - pole) * ((x - before) / T - rate)
            before = x
            due.append((step + round(delay_s / h), wall.force(x, rate)))
        while due and due[0][0] <= step:
            force = due.pop(0)[1]
        was = v
        v += (-force - grip * x - (damping + device) * v) / mass * h
        x += v * h
        if was > 0.0 >= v:
            tops.append(x)
    return tops[1] / tops[0]


@pytest.mark.parametrize(("device", "delay_s"), LATE)
def test_a_heavy_hand_on_a_softened_wall_rings_about_as_on_an_ideal_one(
    device: float, delay_s: float
) -> None:
    limiter = WallLimiter(late_port(device, delay_s), 100.0, 1.5)
    wall = replace(limiter.apply(Wall(0.0, 20_000.0)), bilateral=True)
    kept = ringing(14.0, wall, device, delay_s)
    ideal = math.exp(-2 * math.pi * (14.0 + device) / (2 * math.sqrt((wall.k + 2000.0) * 2.85)))
    bare = ringing(14.0, replace(wall, calming=0.0), device, delay_s)
    assert math.log(bare) > 0.75 * math.log(ideal), "the latency takes the device's friction"
    assert math.log(kept / bare) < 0.5 * math.log(ideal / bare)


def test_true_and_rendered_values_are_reported() -> None:
    limiter = WallLimiter(DIFFERENCE, 100.0, 1.5)
    wall = limiter.apply(Wall(0.0, 3600.0, 20.0))
    bound = limiter.rendered_bound
    assert bound.reduced
    assert (bound.true_stiffness, bound.true_damping) == (3600.0, 20.0)
    assert (wall.k, wall.b) == (bound.rendered_stiffness, bound.rendered_damping)
    assert bound.required_damping == pytest.approx(21.8, rel=1e-3)
    passive = Wall(0.0, 3600.0, 2.0)
    assert limiter.apply(passive) is passive
    assert not limiter.rendered_bound.reduced


@settings(deadline=None)
@given(st.floats(100, 1e6), st.floats(0, 1000), st.floats(1, 2.5))
def test_a_reduced_hunt_crossley_wall_is_passive_over_its_whole_range(
    k: float, b: float, n: float
) -> None:
    limiter = WallLimiter(DIFFERENCE, 100.0, 1.5)
    wall = limiter.apply(Wall(0.0, k, b, n, damping_power=n))
    slopes = largest_slopes(wall, 100.0, 1.5)
    assert PassivityBound(DIFFERENCE).required_damping(*slopes) <= 5.0 * (1 + 1e-6)


@settings(deadline=None, max_examples=30)
@given(st.floats(1e3, 1e8), st.floats(0, 1000), st.one_of(st.just(1.0), st.floats(1, 4)))
@example(31_000.0, 10.0, 1.0)
@example(1000.0, 10.0, 1.0 + 2e-16)
@example(31_000.0, 10.0, 1.0 + 2e-16)
def test_a_wall_too_stiff_at_depth_is_rendered_as_it_is_above(k: float, b: float, n: float) -> None:
    """Also with the exponent 1 that an estimate below it is rendered with."""
    limiter = WallLimiter(DIFFERENCE, 100.0, 1.5)
    true = Wall(0.0, k, b, n, damping_power=n)
    wall = limiter.apply(true)
    depths = np.linspace(0.0, limiter.apply(true).position_of(100.0), 400)
    force = np.array([wall.elastic_force(x) for x in depths])
    expected = np.array([true.elastic_force(x) for x in depths])
    slope = np.gradient(expected, depths)
    shallow = slope < 0.99 * CALM_SHARE * limiter.stiffness_max
    assert np.allclose(force[shallow], expected[shallow], rtol=1e-9)
    assert np.diff(force).max() <= limiter.stiffness_max * depths[1] * (1 + 1e-9)
    energy = np.array([wall.energy(x) for x in depths])
    work = np.concatenate(([0.0], np.cumsum(0.5 * (force[1:] + force[:-1])) * depths[1]))
    assert np.allclose(energy, work, rtol=1e-2, atol=1e-3 * energy[-1])
    assert wall.position_of(force[-1]) == pytest.approx(depths[-1])


def test_a_wall_that_was_limited_before_may_be_limited_again() -> None:
    """Its calming was taken for damping that grows with depth, which left a negative spring."""
    once = Wall(
        0.00909, 5450752.230522032, 2.3149915747711183, 1.962107672593025,
        damping_power=1.962107672593025, stiffest=3989.0560661181958,
        damped_depth=0.003855106945674473, calming=11.126095445084276,
    )  # fmt: skip
    again = WallLimiter(late_port(6.6, 0.001), 100.0, 1.5).apply(once)
    assert again.stiffest == pytest.approx(once.stiffest, rel=0.1)


@settings(deadline=None)
@given(
    st.floats(0, 1e12), st.floats(0, 1e15), st.one_of(st.just(1.0), st.floats(1, 5)),
    st.floats(0, 50),
)  # fmt: skip
def test_no_wall_is_too_odd_to_be_limited(k: float, b: float, n: float, calming: float) -> None:
    limiter = WallLimiter(DIFFERENCE, 100.0, 1.5)
    wall = limiter.apply(Wall(0.0, k, b, n, damping_power=n, calming=calming))
    forces = [wall.force(x, v) for x in (0.0, 1e-4, 0.02) for v in (-1.0, 0.0, 1.0)]
    assert all(math.isfinite(force) for force in forces)
    assert wall.elastic_force(0.02) >= 0.0


def test_largest_slopes_match_finite_differences_of_the_force() -> None:
    wall = Wall(0.0, 1500.0, 50.0, 1.5, damping_power=1.5)
    depth = (100 / 1500) ** (1 / 1.5)
    h = 1e-7
    by_position = (wall.force(depth + h, 1.5) - wall.force(depth - h, 1.5)) / (2 * h)
    by_velocity = (wall.force(depth, h) - wall.force(depth, -h)) / (2 * h)
    assert largest_slopes(wall, 100.0, 1.5) == pytest.approx((by_position, by_velocity), rel=1e-5)


def mass_on_wall(wall: Wall, damping: float, *, raw_difference: bool) -> float:
    """Largest amplitude late over early, of a free mass on a bilateral wall rendered at 1/T."""
    mass, x, v, force, previous = 0.05, 0.01, 0.0, 0.0, 0.01
    early = late = 0.0
    for tick in range(4000):
        rate = (x - previous) / T if raw_difference else v
        previous, force = x, wall.force(x, rate)
        for _ in range(20):
            v += (-force - damping * v) / mass * (T / 20)
            x += v * (T / 20)
        early = max(early, abs(x)) if tick < 400 else early
        late = max(late, abs(x)) if tick > 3600 else late
    return late / early


@pytest.mark.parametrize("raw_difference", [False, True])
def test_a_free_mass_settles_on_a_reduced_wall_and_not_on_one_far_too_stiff(
    raw_difference: bool,
) -> None:
    damping = 2.0
    port = Port(T, damping, velocity="difference" if raw_difference else "measured")
    wild = Wall(0.0, 30_000.0, bilateral=True)
    if raw_difference:
        wild = Wall(0.0, 3600.0, 120.0, bilateral=True)
    assert mass_on_wall(wild, damping, raw_difference=raw_difference) > 1.0
    wall = WallLimiter(port, 100.0, 1.5).apply(wild)
    assert mass_on_wall(wall, damping, raw_difference=raw_difference) < 0.1
