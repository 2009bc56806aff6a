"""A surface in a rhythm is predicted over the delay; one that leaves its rhythm is not."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from teleop_rt.master.rhythm import Rhythm

NEWS_S, NOISE = 0.05, 2e-5
Motion = Callable[[float], float]


def sine(t: float) -> float:
    return 1e-4 * t + 2.5e-3 * math.sin(2 * math.pi * 0.3 * t)


def breath(t: float) -> float:
    """Breath after Lujan: it rests when the air is out."""
    return 6e-3 * math.cos(math.pi * t / 4.2) ** 4


def replay(
    motion: Motion, late_s: float, lasts_s: float, felt: Callable[[float], bool] = lambda _: True
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return times, errors of the straight line, errors as rendered, and whether predicted."""
    rhythm, rng, rows = Rhythm(), np.random.default_rng(1), []
    for now in np.arange(1.0 + late_s, lasts_s, NEWS_S):
        then = now - late_s
        speed = (motion(then + 1e-3) - motion(then - 1e-3)) / 2e-3
        seen = motion(then) + NOISE * rng.standard_normal()
        line = seen + speed * late_s
        found = rhythm.follow(now, seen, late_s, line, felt=felt(then))
        is_now = line if found is None else found.surface
        rows.append((now, line - motion(now), is_now - motion(now), found is not None))
    t, of_line, rendered, predicted = np.array(rows).T
    return t, of_line, rendered, predicted > 0


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


@pytest.mark.parametrize("motion", [sine, breath])
@pytest.mark.parametrize(("late_s", "share"), [(0.25, 0.4), (0.5, 0.25), (1.0, 0.15)])
def test_a_rhythm_is_predicted_over_the_delay(motion: Motion, late_s: float, share: float) -> None:
    t, of_line, rendered, predicted = replay(motion, late_s, 40.0)
    late = t > 20.0
    assert predicted[late].all()
    assert rms(rendered[late]) < share * rms(of_line[late])


def test_a_rhythm_goes_on_while_the_tool_is_away() -> None:
    """The tool presses for 2 s of every 3 s; in between the news of the surface are guesses."""
    t, _, rendered, predicted = replay(sine, 0.5, 50.0, felt=lambda s: s % 3.0 < 2.0)
    late = t > 30.0
    assert predicted[late].mean() > 0.9
    assert rms(rendered[late & predicted]) < 3e-4


@pytest.mark.parametrize("late_s", [0.5, 1.0])
@pytest.mark.parametrize("at", [0.0, 0.25, 0.5, 0.8])
def test_a_held_breath_is_found_within_a_fraction_of_a_breath(at: float, late_s: float) -> None:
    """From a period after the start `at` of a cycle on, the surface stands still."""
    begin, period = (12.0 + at) / 0.3, 1 / 0.3

    def held(t: float) -> float:
        return sine(min(t, begin))

    t, _, _, predicted = replay(held, late_s, begin + 6.0)
    news = begin + late_s
    assert predicted[(t > begin - 3.0) & (t < begin)].all()
    assert not predicted[(t > news + 0.15 * period) & (t < news + period)].any()


@pytest.mark.parametrize("seed", range(4))
def test_irregular_breath_is_no_worse_than_a_straight_line(seed: int) -> None:
    """Each breath has a length and a depth of its own, by 15 % and 20 %."""
    rng = np.random.default_rng(seed)
    lengths = 3.5 * (1 + 0.15 * rng.standard_normal(40))
    depths = 2.5e-3 * (1 + 0.2 * rng.standard_normal(40))
    starts = np.concatenate(([0.0], np.cumsum(lengths)))

    def motion(t: float) -> float:
        i = int(np.searchsorted(starts, t, side="right")) - 1
        share = (t - starts[i]) / lengths[i]
        return float(depths[i] * (1 - math.cos(2 * math.pi * share)))

    _, of_line, rendered, _ = replay(motion, 0.5, 90.0)
    assert rms(rendered) <= 1.05 * rms(of_line)


@pytest.mark.parametrize("seed", range(3))
def test_a_surface_without_a_rhythm_is_not_predicted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    steps = np.cumsum(np.cumsum(rng.standard_normal(4000)) * 1e-6)
    smooth = np.convolve(steps, np.ones(40) / 40, "same")

    def motion(t: float) -> float:
        return float(np.interp(t, np.arange(4000) * 0.025, smooth))

    _, of_line, rendered, _ = replay(motion, 0.5, 60.0)
    assert rms(rendered) <= 1.05 * rms(of_line)
