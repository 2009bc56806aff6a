"""Noise as instruments have it: a sensor's resonance, and noise that grows with the force."""

from __future__ import annotations

import pytest

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.plants import make


def answer(seed: int, effects: tuple[str, ...], kind: str) -> tuple[str, list[list[str]]]:
    """Return verdict and class of a recording with noise of an eighth of its force."""
    record = make(seed, effects, size=0.25, noise=0.12, kind=kind)
    recording = from_arrays("noisy", record.t, record.position, record.force)
    found = diagnose(recording, record.base).answer
    return found["verdict"], found["class"]


@pytest.mark.parametrize(("seed", "kind"), [(3, "resonant"), (4, "growing")])
def test_noise_of_an_instrument_is_no_missing_effect(seed: int, kind: str) -> None:
    assert answer(seed, (), kind) == ("no_missing_effect", [])


@pytest.mark.parametrize(("seed", "kind"), [(4, "resonant"), (3, "growing")])
def test_a_bias_is_named_in_the_noise_of_an_instrument(seed: int, kind: str) -> None:
    assert answer(seed, ("force_bias",), kind) == ("named", [["force_bias"]])
