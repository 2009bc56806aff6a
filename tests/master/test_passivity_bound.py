"""The passivity bound of a port, compared with the worst motion by summation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teleop_rt.master.passivity import PassivityBound, Port

T = 0.001


@given(st.floats(0, 50_000), st.floats(0, 100), st.floats(1e-4, 0.01))
def test_a_raw_difference_needs_half_kt_plus_b(k: float, b: float, period_s: float) -> None:
    bound = PassivityBound(Port(period_s, 1.0, velocity="difference"))
    assert bound.required_damping(k, b) == pytest.approx(k * period_s / 2 + b, rel=1e-3)


def tone_deficit(k: float, b: float, theta: float) -> float:
    """Damping that makes up for the energy which a held wall gives to a tone, by summation."""
    ticks, fine = 400, 50
    t = np.arange(ticks * fine + 1) * T / fine
    omega = theta / T
    phases = np.linspace(0, np.pi, 8, endpoint=False)
    given, squared = 0.0, 0.0
    for phase in phases:
        x = np.sin(omega * t + phase)
        v = omega * np.cos(omega * t + phase)
        force = k * x[:-1:fine] + b * v[:-1:fine]
        given -= (force * np.diff(x[::fine])).sum()
        squared += (v[:-1] ** 2).sum() * T / fine
    return given / squared


@pytest.mark.parametrize(("k", "b"), [(3600.0, 0.0), (3600.0, 20.0), (100.0, 30.0)])
def test_a_measured_velocity_needs_what_the_worst_tone_needs(k: float, b: float) -> None:
    bound = PassivityBound(Port(T, 1.0))
    worst = max(tone_deficit(k, b, theta) for theta in np.linspace(0.05, 3 * np.pi, 150))
    worst = max(worst, tone_deficit(k, 0.0, 0.05))
    assert bound.required_damping(k, b) == pytest.approx(worst, rel=0.01)
    assert PassivityBound(Port(T, 1.0)).required_damping(0.0, 1.0) == pytest.approx(
        0.2172, abs=2e-4
    )
    assert PassivityBound(Port(T, 1.0)).required_damping(3600.0, 0.0) == pytest.approx(
        1.8, rel=1e-3
    )


def test_a_delay_costs_its_stiffness_times_its_length() -> None:
    bound = PassivityBound(Port(T, 1.0, delay_s=0.004))
    assert bound.required_damping(1000.0, 0.0) == pytest.approx(1000 * (0.004 + T / 2), rel=0.01)


def least_damping(port: Port, k: float, b: float) -> float:
    """Damping that the worst of many periodic motions needs, by the work of the held force itself.

    Motion is free within a period: a speed of its own before and after the force changes. The
    loop repeats itself after N periods, so that the filter of the velocity is at rest in it.
    """
    period_s, n = port.period_s, 24
    whole, late = divmod(port.delay_s / period_s, 1)
    pole = math.exp(-2 * math.pi * port.cutoff_hz * period_s) if port.cutoff_hz else 0.0
    spans = np.tile([late, 1 - late], n) * period_s
    moved = np.diag(spans)
    samples = np.zeros((n, 2 * n))
    for index in range(1, n):
        samples[index] = moved[: 2 * index].sum(axis=0)
    back = np.roll(np.eye(n), -1, axis=1)
    step = np.eye(n) - back
    speed = np.linalg.solve(np.eye(n) - pole * back, (1 - pole) * step / period_s)
    force = (k * np.eye(n) + b * speed) @ samples
    acting = np.repeat(np.linalg.matrix_power(back, int(whole)) @ force, 2, axis=0)
    acting[0::2] = acting[(np.arange(0, 2 * n, 2) - 2) % (2 * n) + 1]
    lasting = spans > 0
    work, spans = (moved.T @ acting)[np.ix_(lasting, lasting)], spans[lasting]
    closed = np.linalg.svd(spans[None, :])[2][1:].T  # motions that come back to where they began
    weight = closed.T @ np.diag(spans) @ closed
    symmetric = closed.T @ (work + work.T) @ closed / 2
    values = np.linalg.eigvals(np.linalg.solve(weight, symmetric))
    return float(-values.real.min())


@pytest.mark.parametrize("delay_ms", [0.0, 0.25, 0.6, 1.0, 1.4])
@pytest.mark.parametrize(("k", "b", "cutoff_hz"), [(3600, 0, 0), (3600, 20, 30), (500, 20, 0)])
def test_the_bound_is_what_the_worst_motion_needs_whatever_the_latency(
    delay_ms: float, k: float, b: float, cutoff_hz: float
) -> None:
    port = Port(T, 1.0, "difference", cutoff_hz, 1e-3 * delay_ms)
    needed = PassivityBound(port).required_damping(k, b)
    worst = max(least_damping(port, k, b), least_damping(port, k, 0.0))
    assert worst <= needed * (1 + 1e-4)
    assert worst == pytest.approx(needed, rel=0.05)  # 24 periods hold no slower tone


def test_a_low_pass_lets_more_damping_be_rendered_than_a_raw_difference() -> None:
    filtered = PassivityBound(Port(T, 1.0, velocity="difference", cutoff_hz=60.0))
    assert filtered.required_damping(0.0, 20.0) < 20.0


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_scaling_of_position_and_force_multiplies_the_need(scale: float) -> None:
    bound = PassivityBound(Port(T, 1.0, position_scale=scale, force_scale=2.0))
    assert bound.required_damping(1000.0, 0.0) == pytest.approx(0.5 * scale * 2.0)


@pytest.mark.parametrize("delay_ms", [0.25, 1.7, 4.2])
@pytest.mark.parametrize("cutoff_hz", [0.0, 30.0, 200.0])
def test_the_largest_damping_beside_a_spring_needs_all_that_the_device_has(
    delay_ms: float, cutoff_hz: float
) -> None:
    bound = PassivityBound(Port(T, 5.0, "difference", cutoff_hz, 1e-3 * delay_ms))
    for share in np.linspace(0.0, 0.99, 23):
        k = float(share * bound.stiffness_max)
        most = bound.damping_max(k)
        assert bound.required_damping(k, most) <= 5.0 * (1 + 1e-9)
        assert bound.required_damping(k, 1.001 * most + 1e-6) > 5.0
    for share in (1.001, 1.5, 20.0):
        assert bound.damping_max(float(share * bound.stiffness_max)) == 0.0
