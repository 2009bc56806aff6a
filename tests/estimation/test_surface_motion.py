"""A surface that moves by itself is followed, under a straight law and a curved one."""

import numpy as np
import pytest

from teleop_rt.estimation.surface_motion import SurfaceMotion

T, NOISE, SURFACE = 1e-3, 0.05, 0.0137
K, B = 3600.0, 20.0
SECONDS = 8
T_S = np.arange(round(SECONDS / T)) * T
BREATH = 2.5e-3 * np.sin(2 * np.pi * 0.3 * T_S) + 1e-4 * T_S


def strokes(hz: float = 3.0) -> np.ndarray:
    """Positions of a tool that strokes 12 +- 8 mm deep, and lifts off every two seconds."""
    off = np.clip(np.abs((T_S % 2.0) - 1.0) / 0.1 - 9.0, 0.0, 1.0)
    return SURFACE + (1 - off) * (0.012 + 0.008 * np.sin(2 * np.pi * hz * T_S)) - 0.01 * off


def answer(position: np.ndarray, moved: np.ndarray, exponent: float = 1.0) -> np.ndarray:
    """Force of a body whose surface has moved away, 43 N at 12 mm."""
    depth = np.maximum(position - SURFACE - moved, 0.0)
    rate = np.gradient(position - moved, T)
    force = np.maximum(0.0, (K * 0.012) * (depth / 0.012) ** exponent + B * rate * (depth > 0))
    return force + NOISE * np.random.default_rng(7).standard_normal(force.size)


def follow(position: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray, SurfaceMotion]:
    """Return the estimated place and speed of the surface, and those of its follower."""
    motion = SurfaceMotion(3.0, T, 0.4, NOISE, 5e-3)
    found = []
    for x, f in zip(position, force, strict=True):
        motion.update(x, f, SURFACE if found or f > 0.4 else np.nan, in_contact=f > 0.4)
        found.append((-motion.shift, motion.velocity))
    moved, velocity = np.array(found).T
    return moved, velocity, motion


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("hz", [3.0, 0.7])
def test_breath_is_followed_beside_strokes_of_any_speed(hz):
    position = strokes(hz)
    moved, velocity, _ = follow(position, answer(position, BREATH))
    pressed = (position > SURFACE + BREATH + 1e-3) & (T_S > 2.0)
    assert rms((moved - BREATH)[pressed]) < 0.18e-3, "a tenth of the swing"
    assert rms((velocity - np.gradient(BREATH, T))[pressed]) < 0.8e-3, "of 4.8 mm/s"


def test_a_surface_that_stands_still_stays():
    position = strokes()
    moved, velocity, motion = follow(position, answer(position, 0 * BREATH))
    assert motion.ready
    pressed = (position > SURFACE + 1e-3) & (T_S > 2.0)
    assert rms(moved[pressed]) < 0.05e-3
    assert rms(velocity[pressed]) < 0.3e-3


def test_a_body_that_stiffens_is_not_taken_for_one_that_moves():
    position = strokes()
    moved, velocity, _ = follow(position, answer(position, 0 * BREATH, exponent=1.5))
    assert np.abs(moved).max() < 0.3e-3, "an apparent motion before the curve was seen"
    assert rms(velocity[2000:]) < 0.3e-3, "as of a straight body that stands still"


def curved(position: np.ndarray, moved: np.ndarray, n: float, seed: int) -> np.ndarray:
    """Force of a body after Hunt and Crossley, 43 N at 12 mm, at rest or with a moving surface."""
    depth = np.maximum(position - SURFACE - moved, 0.0) / 0.012
    force = depth**n * 0.012 * (K + B / 0.012 * np.gradient(position - moved, T))
    noise = NOISE * np.random.default_rng(seed).standard_normal(force.size)
    return np.maximum(0.0, force) + noise


@pytest.mark.parametrize("hz", [3.0, 0.7])
@pytest.mark.parametrize("n", [1.2, 1.35, 1.5, 1.62, 1.8])
def test_breath_of_a_body_that_stiffens_is_followed_and_one_at_rest_stays(n, hz):
    """As still bodies these were off by the breath itself, 2 mm, and slow strokes by 3 mm."""
    position = strokes(hz)
    for breath in (BREATH, 0 * BREATH):
        moved, _, _ = follow(position, curved(position, breath, n, seed=11))
        pressed = (position > SURFACE + breath + 1e-3) & (T_S > 2.0)
        assert rms((moved - breath)[pressed]) < (0.5e-3 if hz == 3.0 else 1.1e-3)


def foam(position: np.ndarray) -> np.ndarray:
    """Force of a foam at rest that locks at 30 mm."""
    depth = np.clip(position - SURFACE, 0.0, 0.029)
    force = 1000.0 * (depth + depth**2 / (0.03 - depth)) + B * np.gradient(depth, T)
    noise = NOISE * np.random.default_rng(11).standard_normal(force.size)
    return np.maximum(0.0, force) + noise


@pytest.mark.parametrize("hz", [3.0, 0.7])
def test_a_foam_that_locks_is_no_power_law_and_stays(hz):
    position = strokes(hz)
    moved, _, motion = follow(position, foam(position))
    assert not motion.ready
    assert np.abs(moved).max() < 0.3e-3


def test_a_tool_that_feels_nothing_has_the_surface_before_it():
    position = strokes()
    force = answer(position, BREATH)
    gone = T_S >= 5.0
    position[gone], force[gone] = SURFACE + 0.008, 0.0
    moved, _, motion = follow(position, force)
    assert motion.ready
    assert moved[T_S > 5.5].min() > 0.0075


def test_what_is_no_sample_changes_nothing():
    position = strokes()
    force = answer(position, BREATH)
    plain, _, _ = follow(position[:3000], force[:3000])
    motion = SurfaceMotion(3.0, T, 0.4, NOISE, 5e-3)
    for x, f in zip(position[:3000], force[:3000], strict=True):
        motion.update(x, f, SURFACE, in_contact=f > 0.4)
        before = motion.shift
        for wild in ((np.nan, f), (x, np.inf), (1e12, f)):
            assert motion.update(*wild, SURFACE, in_contact=True) == before
    assert motion.shift == pytest.approx(-plain[-1], abs=0.2e-3)
    motion.reset()
    assert (motion.shift, motion.velocity, motion.ready) == (0.0, 0.0, False)
