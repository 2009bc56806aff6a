"""Of laws that explain each of two recordings alone, those that hold from one to the other stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.offline.carry_over import Diagnosed, carried_over, holds_farther
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt_dev.diagnosis.plants import make

DEPTHS_M = (0.006, 0.012)


def pressed(depth: float, drift: float, seed: int) -> Recording:
    """A foam that stiffens, tapped at 0.7 Hz to the given depth."""
    rng = np.random.default_rng(seed)
    t = np.arange(5000) / 1000.0
    x = depth * (0.8 * np.sin(2 * np.pi * 0.7 * t - 1.5) + 0.2 * np.sin(2 * np.pi * 2.9 * t))
    inside = np.maximum(x, 0.0)
    force = 800.0 * inside * (1.0 + inside / 0.02) + 6.0 * np.gradient(x, t) * (x > 0.0)
    force += drift * (1.0 - np.exp(-t / 3.0)) + 0.01 * rng.standard_normal(t.size)
    return from_arrays("foam", t, 1e-6 * np.round(x / 1e-6), force)


def laws(*names: str) -> tuple[Effect, ...]:
    return tuple(effect for effect in LIBRARY if effect.name in names)


def undecided(recording: Recording, sets: list[list[str]]) -> Diagnosed:
    """Diagnose a recording as if it could not distinguish these sets."""
    names = (name for one in sets for name in one)
    found = diagnose(recording, surface=0.0, effects=laws(*names))
    left = tuple(r for r in found.candidates if list(r.fit.names) in sets)
    assert len(left) == len(sets)
    return Diagnosed(recording, replace(found, judgement=replace(found.judgement, sets=left)))


def test_a_law_that_adapted_to_each_motion_is_rejected_on_the_other() -> None:
    both = [["nonlinear_stiffening"], ["mullins_softening"]]
    shallow, deep = (undecided(pressed(d, 0.0, i), both) for i, d in enumerate(DEPTHS_M))
    assert carried_over(shallow, deep, both) == [["nonlinear_stiffening"]]
    assert carried_over(deep, shallow, both) == [["nonlinear_stiffening"]]
    assert holds_farther(deep, shallow, both[0])
    assert not holds_farther(shallow, deep, both[0])


def test_a_law_of_time_is_exempt_on_another_clock() -> None:
    record = make(71, ("force_bias",), "silicone", "sinusoid", size=0.1, noise=0.03)
    force = record.force
    both = [["force_bias"], ["force_drift"]]
    one, other = (
        undecided(from_arrays("on", record.t, record.position, force + shift * np.std(force)), both)
        for shift in (0.0, 5.0)
    )
    assert ["force_drift"] in carried_over(one, other, both)
