"""The motion that separates the members of a class, within the rig's limits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise import whiten
from teleop_rt.diagnosis.samples.motion import RecordedMotion, differentiate
from teleop_rt.recordings.rows import force_noise

SECONDS = 10.0  # s of a proposed motion
_RATE_HZ = 500.0  # Hz at which it is made up
_MOST_RIVALS = 8  # sets of a class that are compared, each with each
_EVALUATIONS = 6  # of a rival's descent; its chi-square is needed, not its exact optimum


@dataclass(frozen=True)
class Reach:
    """The rig's reach [rig units]: deepest penetration, height above the surface, limits."""

    depth: float
    height: float
    velocity: float
    force: float


@dataclass(frozen=True)
class Experiment:
    """A motion, and its separation of the two most similar members."""

    profile: str
    t: Vector
    x: Vector
    separation: float
    why: str

    def entry(self) -> dict[str, Any]:
        """Return its entry in the answer; the writer of the trial fills in `trial`."""
        return {
            "trial": None,
            "profile": self.profile,
            "why": self.why,
            "predicted_separation": round(self.separation, 1),
        }


def _ease(u: Vector) -> Vector:
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2), dtype=np.float64)


def profiles(depth: float, height: float) -> dict[str, Vector]:
    """Return the shapes that are tried: penetration over 10 s, by name.

    Times in s, frequencies in Hz, amplitudes of the depth: within the stroke, and below 10 Hz.
    """
    t = np.arange(round(SECONDS * _RATE_HZ)) / _RATE_HZ
    enter = -height + (0.55 * depth + height) * _ease((t - 0.5) / 0.5)
    tone = 0.4 * depth * _ease((t - 1.2) / 0.3)
    sweep = 2.0 * np.pi * (0.5 * t + 0.5 * t**2)
    # Ever faster and deeper: a surface or a force that moves with a period of its own fits none.
    lifted = 1.0 - np.cos(2.0 * np.pi * (0.5 * t + 0.05 * t**2))
    taps = -height + 0.5 * (depth + height) * (0.6 + 0.4 * t / SECONDS) * lifted
    # Everything once: air, hold, sweep, deeper hold, withdrawal, and tones through the surface.
    deep = (_ease((t - 4.6) / 0.2) - _ease((t - 5.8) / 0.3)) * 0.4 * depth
    leave = (_ease((t - 6.4) / 0.3) - _ease((t - 7.2) / 0.3)) * (0.55 * depth + height)
    swept = 0.2 * depth * _ease((t - 2.2) / 0.3) * _ease((4.5 - t) / 0.3)
    tones = sum(np.sin(2.0 * np.pi * f * t + f) / f**0.5 for f in (0.7, 1.3, 2.9, 5.3))
    late_tones = 0.22 * depth * _ease((t - 7.6) / 0.3) * tones
    return {
        "everything once": enter
        + deep
        - leave
        + swept * np.sin(2.0 * np.pi * (0.5 * (t - 2.2) + 1.3 * (t - 2.2) ** 2))
        + late_tones,
        "approach and slow tone": enter + tone * np.sin(2.0 * np.pi * 0.6 * t),
        "approach and chirp": enter + 0.35 * tone * np.sin(sweep),
        "tapping": taps,
    }


def _within(x: Vector, reach: Reach, sets: list[Fit], found: Problem) -> Vector:
    """Return the motion scaled into stroke, velocity and force, whichever set is true.

    Scaled and never cut off: the corners of a cut hold frequencies that no sensor follows.
    """
    x = differentiate(x, 1.0 / _RATE_HZ, 10)[0]
    x = x * min(1.0, reach.depth / float(np.max(x)))
    fastest = float(np.max(np.abs(np.gradient(x, 1.0 / _RATE_HZ))))
    x = x * min(1.0, reach.velocity / fastest)
    problem = _problem(x, found, 1.0)
    strongest = max(float(np.max(np.abs(fit.force_on(problem.motion)))) for fit in sets)
    return np.asarray(x * min(1.0, reach.force / max(strongest, 1e-300)), dtype=np.float64)


def _problem(x: Vector, found: Problem, noise: float) -> Problem:
    """Return the problem of a motion not yet made, with white noise."""
    dt = 1.0 / _RATE_HZ
    x, v, a = differentiate(x, dt, 10)
    motion = RecordedMotion(
        dt * np.arange(x.size, dtype=np.float64), x, v, a, dt, found.motion.scales
    )
    return Problem(motion, np.zeros(x.size), whiten.white(np.ones(x.size), noise, dt))


def _separation(
    x: Vector, pairs: list[tuple[Fit, Fit]], found: Problem, noise: float, enough: float
) -> float:
    """Return the smallest chi-square of a rival that is refitted to another set's prediction.

    `pairs` hold the set that plays the truth, and a rival. Stops as soon as it is below `enough`:
    the motion then is not the best. The pair that was closest comes first the next time.
    """
    smallest = float("inf")
    white = _problem(x, found, noise)
    problems: dict[int, Problem] = {}
    for pair in list(pairs):
        truth, rival = pair
        if id(truth) not in problems:
            problems[id(truth)] = replace(white, force=truth.force_on(white.motion))
        left = problems[id(truth)].refine(rival.model, rival.zeta, _EVALUATIONS).chi2
        if left < smallest:
            smallest = left
            pairs.remove(pair)
            pairs.insert(0, pair)
        if smallest < enough:
            break
    return smallest


def design(found: Problem, sets: list[Fit], reach: Reach | None = None) -> Experiment | None:
    """Return the motion with the largest of the smallest separations 2 Delta log L.

    Each member in turn plays the truth, and every rival is refitted to its force.
    Without `reach` the motion keeps to the recording's own range. None for fewer than two
    members.
    """
    sets = [fit.elsewhere for fit in sets[:_MOST_RIVALS]]
    if len(sets) < 2:
        return None
    if reach is None:
        depth = found.motion.scales["travel"]
        fastest = 2.0 * float(np.max(np.abs(found.motion.v)))
        reach = Reach(depth, 0.3 * depth, fastest, 1.2 * found.motion.scales["force"])
    noise = max(force_noise(found.force, found.force_step), 1e-9)
    pairs = list(permutations(sets, 2))
    best: Experiment | None = None
    for name, shape in profiles(reach.depth, reach.height).items():
        x = _within(shape, reach, sets, found)
        value = _separation(x, pairs, found, noise, best.separation if best else 0.0)
        if best is None or value > best.separation:
            names = " and ".join("+".join(fit.names).replace("_", " ") for fit in pairs[0])
            why = (
                f'of the motions within reach, "{name}" sets the closest two, {names}, furthest'
                " apart"
            )
            best = Experiment(name, np.arange(x.size) / _RATE_HZ, x, value, why)
    return best
