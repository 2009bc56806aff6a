"""The energy at the hand's port, and the watch for a handle that oscillates by itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from teleop_rt.master.energy import GIVEN_BACK, PassivityObserver
from teleop_rt.master.shaking import SOFTENINGS, ShakeGuard
from teleop_rt.master.swings import Shaking, SwingWatch
from teleop_rt.master.walls import Wall

T = 0.001


def test_the_observer_sees_the_energy_that_the_hand_gives_and_gets() -> None:
    observer = PassivityObserver(0.0, T, 0.05, 0.0)
    wall = Wall(0.0, 1000.0)
    for tick in range(2001):
        x = 0.01 * math.sin(math.pi * tick / 2000)
        observer.update(x, 0.0, wall.force(x, 0.0))
        if tick == 1000:
            assert observer.energy_J == pytest.approx(0.05, rel=0.01)
    assert observer.energy_J == pytest.approx(0.0, abs=2e-4)
    assert observer.injected_J == 0.0


@pytest.mark.parametrize("latency_ms", [0.0, 0.4, 1.0, 2.7])
def test_the_force_that_counts_is_the_one_that_acts(latency_ms: float) -> None:
    """Against the integral of force and motion of one instant, at a thousand times the rate."""
    observer, stiffness, fine = PassivityObserver(1e-3 * latency_ms, T, 1e9, 0.0), 3000.0, 1000
    t = np.arange(500 * fine) * T / fine
    x = 0.004 * (1 - np.cos(2 * math.pi * 6 * t))
    late = round(latency_ms * fine)
    acting = np.concatenate((np.zeros(late), np.repeat(stiffness * x[::fine], fine)))[: x.size]
    true_J = float((acting[:-1] * np.diff(x)).sum())
    for position in x[::fine]:
        observer.update(position, 0.0, stiffness * position)
    assert true_J < -1e-3
    assert observer.energy_J == pytest.approx(true_J, rel=0.02)


def test_credit_of_one_contact_is_none_of_the_next() -> None:
    observer = PassivityObserver(0.0, T, 0.01, 0.0)
    for tick in range(1000):
        observer.update(1e-4 * tick, 0.1, 20.0, 0.0)
    assert 0.0 < observer.energy_J <= 0.01, "of 2 J taken, no more is lent than the tank holds"
    for _ in range(100):
        observer.update(0.1, 0.0, 0.0, 0.0)
    observer.update(0.1, 0.0, 20.0, 0.0)
    observer.update(0.099, -1.0, 20.0, 0.0)
    assert observer.energy_J == pytest.approx(-0.02)


def given_back(observer: PassivityObserver, wall: Wall, path: np.ndarray) -> tuple[float, float]:
    """Energy that a wall gave on a path, and the largest share of its force that was kept back."""
    given = kept = force = 0.0
    before = float(path[0])
    for x in path.tolist():
        given -= force * (x - before)
        before = x
        wanted = wall.force(x, 0.0)
        force = observer.update(x, 0.0, wanted, wall.energy(x), 0.0)
        kept = max(kept, 1 - force / wanted if wanted > 0 else 0.0)
    return given, kept


def test_a_wall_gives_no_more_than_the_hand_and_the_tank_gave() -> None:
    """A wall that a hand finds itself in, with 0.25 J in it, on a device without damping to add."""
    observer, wall = PassivityObserver(0.0, T, 0.01, 0.0), Wall(0.0, 5000.0)
    out = np.concatenate((np.full(50, 0.01), np.linspace(0.01, -0.001, 1000)))
    given, _ = given_back(observer, wall, out)
    assert 0.005 < given < 0.0105


def test_a_wall_that_the_hand_pressed_keeps_nothing_back() -> None:
    observer, wall = PassivityObserver(0.0, T, 0.01, 0.0), Wall(0.0, 5000.0)
    t = np.linspace(0.0, np.pi, 1000)
    given, kept = given_back(observer, wall, 0.01 * np.sin(t) - 0.0005)
    assert abs(given) < 0.005
    assert kept == 0.0


def test_the_controller_damps_an_active_wall_until_the_deficit_is_paid() -> None:
    plain, guarded = (run_active_wall(control=control) for control in (False, True))
    assert plain[-1] < -0.2
    assert guarded.min() > plain.min() / 2
    assert guarded[-1] > -0.06


def run_active_wall(*, control: bool) -> np.ndarray:
    """Energy given to a port that pushes along with the hand's velocity: a motor, no wall."""
    observer = PassivityObserver(0.0, T, 0.01, 0.0)
    energies, energy, force = [], 0.0, 0.0
    x_before = 0.0
    for tick in range(1, 4001):
        x = 0.01 * math.sin(2 * math.pi * 2 * tick * T)
        v = 0.01 * 2 * math.pi * 2 * math.cos(2 * math.pi * 2 * tick * T)
        energy += force * (x - x_before)
        energies.append(energy)
        x_before = x
        active = -8.0 * v
        force = observer.update(x, v, active, 0.0, 10.0)
        if not control:
            force = active
    return np.array(energies)


def bounce(*, guarded: bool, damping: float = 0.3) -> tuple[np.ndarray, ShakeGuard]:
    """Turns of a mass that bounces on a wall rendered 2.5 ms late, with next to no damping."""
    stiffness, mass, latency = 3000.0, 0.5, 2
    observer, guard = PassivityObserver(latency * T, T, 0.05, 0.005), ShakeGuard(T, 5.0)
    x, v, force, queue, turns = 0.0, 0.05, 0.0, [0.0] * latency, [0.0]
    for _ in range(3000):
        rendered = guard.trust * stiffness * max(0.0, x)
        if guarded:
            stored = 0.5 * guard.trust * stiffness * max(0.0, x) ** 2
            rendered = observer.update(x, v, rendered, stored, 0.0)
            guard.update(x, v, rendered, observer.made_J)
            observer.bounded = guard.bounding
            rendered = 0.0 if guard.lets_go else rendered
        queue.append(rendered)
        force = queue.pop(0)
        for _ in range(20):
            before = v
            v += T / 20 / mass * (200.0 * (0.002 - x) - damping * v - force)
            x += T / 20 * v
            if before * v < 0:
                turns.append(x)
    return np.abs(np.diff(turns)), guard


def test_a_growing_oscillation_is_stopped_within_two_of_its_swings() -> None:
    swings, _ = bounce(guarded=False)
    assert swings[-1] > 3 * swings[3]
    held, guard = bounce(guarded=True)
    assert guard.boundings > 0
    assert held.max() < 2.5 * held[2]
    assert np.all(np.diff(held[4:16]) < 0)


def swing(watch: SwingWatch, hz: float, size: float, made: float, seconds: float) -> set[Shaking]:
    """The watch's finding for a sinusoid whose wall generates `made` of 5 N s/m's dissipation."""
    found = set()
    for tick in range(round(seconds / T)):
        angle = 2 * math.pi * hz * tick * T
        v = size * math.pi * hz * math.cos(angle)
        x = 0.5 * size * math.sin(angle)
        found.add(watch.update(x, v, 3000 * x, made * 5.0 * v * v * T))
    return found


@pytest.mark.parametrize(
    ("hz", "size", "made", "shakes"),
    [
        (8.0, 1e-3, 0.5, True),
        (3.2, 5e-3, 0.5, True),
        (35.0, 0.3e-3, 0.5, True),
        (2.9, 5e-3, 0.5, False),
        (45.0, 0.3e-3, 0.5, False),
        (8.0, 0.15e-3, 0.5, False),
        (9.0, 1e-3, -0.5, False),
        (9.0, 1e-3, 0.0, False),
    ],
)
def test_sustained_is_three_to_forty_hertz_large_enough_and_fed_by_the_wall(
    hz: float, size: float, made: float, shakes: bool
) -> None:
    found = swing(SwingWatch(T, 5.0), hz, size, made, 3.0)
    assert (Shaking.SUSTAINED in found) is shakes


def shake(guard: ShakeGuard, seconds: float, size: Callable[[float], float]) -> None:
    """Move a device at 8 Hz by `size(t)`, on a wall that makes the energy its damping takes."""
    for tick in range(round(seconds / T)):
        angle = 2 * math.pi * 8 * tick * T
        x, v = size(tick * T) * math.sin(angle), 50 * size(tick * T) * math.cos(angle)
        guard.update(x, v, 3000 * x, 5.0 * v * v * T)


def test_an_oscillation_that_nothing_stops_is_softened_three_times_and_let_go() -> None:
    guard = ShakeGuard(T, 5.0)
    shake(guard, 8.0, lambda _: 1e-3)
    assert guard.softenings == SOFTENINGS
    assert guard.trust == pytest.approx(0.5**SOFTENINGS)
    assert guard.lets_go


def test_one_that_bounding_stops_and_that_comes_back_is_softened() -> None:
    guard = ShakeGuard(T, 5.0)
    shake(guard, 6.0, lambda _: 1e-5 if guard.bounding else 1e-3)
    assert guard.softenings > 0


@pytest.mark.parametrize("seed", range(4))
def test_a_trembling_hand_on_an_honest_device_keeps_its_wall(seed: int) -> None:
    """Noise of 0.6 mm through a resonance of quality 5 at 9 Hz, for 20 s."""
    rng, angle = np.random.default_rng(seed), 2 * math.pi * 9 * T
    radius = math.exp(-angle / 10)
    poles = [1.0, -2 * radius * math.cos(angle), radius**2]
    x = np.asarray(lfilter([1.0], poles, rng.standard_normal(20_000)))
    x *= 0.6e-3 / x.std()
    v = np.gradient(x, T)
    guard = ShakeGuard(T, 5.0)
    for position, velocity in zip(x, v, strict=True):
        guard.update(position, velocity, 6000 * position, 0.9 * 5.0 * velocity**2 * T)
    assert guard.boundings > 0
    assert guard.softenings == 0


def test_what_bounding_keeps_grows_without_a_step_from_where_the_hand_turned() -> None:
    observer = PassivityObserver(0.0, T, 1.0, 0.0)
    forces, given, before = [], 0.0, 0.0
    for tick in range(1001):
        x = 0.01 * math.sin(math.pi * tick / 1000)
        observer.bounded = tick > 500
        force = observer.update(x, 0.0, 2000 * x, 1000 * x * x)
        given += force * (x - before) if tick > 500 else 0.0
        before = x
        forces.append(force)
    assert np.abs(np.diff(forces)).max() < 0.15
    assert -given == pytest.approx(GIVEN_BACK * 1000 * 0.01**2, rel=0.02)


def test_a_hand_at_rest_that_gave_too_little_does_not_chatter() -> None:
    """A wall holds more than the hand gave; each turn gave or took the force of 8 N whole."""
    observer = PassivityObserver(T, T, 0.05, 0.005)
    observer.bounded, x, forces = True, 0.0, []
    for tick in range(400):
        x = min(0.001, 1e-5 * tick) + 1e-5 * math.sin(0.8 * tick)
        wall_N = 4000.0 * (x + 0.001)
        held_J = 0.5 * 4000.0 * (x + 0.001) ** 2
        forces.append(observer.update(x, 0.0, wall_N, held_J))
    assert max(abs(b - a) for a, b in pairwise(forces[200:])) < 1.0


def test_the_end_of_a_bounding_is_no_kick() -> None:
    """A wall comes nearer to a trembling hand: 6 N that it did not feel were there in 20 ms."""
    observer, forces = PassivityObserver(T, T, 0.05, 0.005), []
    for tick in range(2000):
        observer.bounded = 200 <= tick < 1200
        nearer = 1.5e-3 * min(1.0, max(0.0, (tick - 300) / 300))
        x = 5e-5 * math.sin(2 * math.pi * 9.0 * T * tick)
        depth = 5e-4 + nearer + x
        forces.append(observer.update(x, 0.0, 4000.0 * depth, 2000.0 * depth**2))
    assert max(forces[1100:1200]) < 3.0
    assert np.diff(forces[1199:]).max() < 0.05
    assert forces[-1] == pytest.approx(4000.0 * depth)
