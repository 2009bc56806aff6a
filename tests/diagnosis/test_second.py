"""A second effect is named where no other form of the first one's law could make its force."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.foreign_plants import foreign
from teleop_rt_dev.diagnosis.motions import rich
from teleop_rt_dev.diagnosis.plants import make

Array = NDArray[np.float64]
EVERY = 10


def stiffening(seed: int) -> tuple[Array, Array, Array]:
    """Return time, penetration, and the force of a body that densifies: not a power of depth."""
    rng = np.random.default_rng(seed)
    x = rich(rng, 5e-3)[::EVERY]
    t = np.arange(x.size) * 1e-3
    depth = np.maximum(x, 0.0)
    force = 2500.0 * depth / (1.0 - depth / 0.012) + np.where(x > 0.0, 8.0 * np.gradient(x, t), 0.0)
    return t, x, force + 0.02 * rng.standard_normal(t.size)


def best(t: Array, x: Array, force: Array) -> set[str]:
    found = diagnose(from_arrays("two", t, x, force), surface=0.0).answer["class"]
    return set(found[0]) if found else set()


def test_hum_beside_a_much_larger_effect_is_named() -> None:
    t, x, force = stiffening(1)
    hum = 0.03 * np.sin(2.0 * np.pi * 50.0 * t + 1.0)
    assert best(t, x, force + hum) == {"nonlinear_stiffening", "periodic_disturbance"}


def test_a_bias_that_free_air_shows_is_named_beside_a_much_larger_effect() -> None:
    t, x, force = stiffening(2)
    assert best(t, x, force + 0.05) == {"nonlinear_stiffening", "force_bias"}


def test_the_residual_of_another_form_of_the_law_is_no_second_effect() -> None:
    assert best(*stiffening(2)) == {"nonlinear_stiffening"}


def neck(seed: int) -> tuple[Array, Array, Array]:
    """Return time, penetration, and force of a body whose neck of glue grows in 20 ms of contact.

    No law of the library grows: its pull is there at once.
    """
    rng = np.random.default_rng(seed)
    x, step, grown = rich(rng, 5e-3), 1e-4, 0.0
    force = np.where(x > 0.0, 2500.0 * x + 50.0 * np.gradient(x, step), 0.0)
    for i, depth in enumerate(x.tolist()):
        if depth > 0.0:
            grown += (1.0 - grown) * step / 0.02
        elif depth < -2.22e-3:
            grown = 0.0
        force[i] -= 1.5 * grown * np.exp(min(depth, 0.0) / 3.7e-4)
    t, x, force = (step * np.arange(x.size))[::40], x[::40], force[::40]
    return t, x, force + 0.05 * rng.standard_normal(t.size)


def test_what_the_form_of_an_adhesion_misses_at_each_touch_is_no_second_layer() -> None:
    """A layer beside it takes seven tenths of that."""
    assert best(*neck(5)) == {"adhesion"}


def stroke(seed: int) -> tuple[np.random.Generator, Array, Array, Array]:
    """Return the generator, and time [s], penetration [m] and speed [m/s] of a rich motion."""
    rng = np.random.default_rng(seed)
    x = rich(rng, 5e-3)[::EVERY]
    t = np.arange(x.size) * 1e-3
    return rng, t, x, np.gradient(x, t)


def drifting(seed: int) -> tuple[Array, Array, Array]:
    """Return time, penetration, and the force of a body whose glue pulls, beside a large drift."""
    rng, t, x, v = stroke(seed)
    whole = t / t[-1]
    force = np.where(x > 0.0, 2500.0 * x + 12.0 * v, 0.0) + whole - 0.3 * whole**2
    pulls = (x > -4e-4) & (v < 0.0)
    reach = np.exp(np.minimum(x, 0.0) / 2e-4 - np.maximum(x, 0.0) / 1.5e-3)
    force -= 0.4 * np.where(pulls, reach, 0.0)
    return t, x, force + 0.02 * rng.standard_normal(t.size)


def test_an_adhesion_of_two_percent_beside_a_drift_is_named() -> None:
    assert best(*drifting(1)) == {"force_drift", "adhesion"}


def in_red_noise(seed: int) -> tuple[Array, Array, Array]:
    """Return time, penetration, and force of a stiffening body under a mass, in slow noise."""
    rng, t, x, v = stroke(seed)
    depth = np.maximum(x, 0.0)
    force = np.where(x > 0.0, 2500.0 * x + 12.0 * v + 9e6 * depth**3, 0.0) + 0.3 * np.gradient(v, t)
    slow, kept = np.zeros(t.size), np.exp(-2.0 * np.pi * 15.0 * 1e-3)
    white = rng.standard_normal(t.size)
    for i in range(1, t.size):
        slow[i] = kept * slow[i - 1] + white[i]
    return t, x, force + 0.15 * slow / np.std(slow) + 0.02 * rng.standard_normal(t.size)


def test_slow_noise_that_free_air_shows_hides_neither_of_two_effects() -> None:
    """The noise is five times that of the fastest differences.

    It hides whether the body stiffens or a joint that has seated.
    """
    t, x, force = in_red_noise(1)
    found = diagnose(from_arrays("two", t, x, force), surface=0.0).answer["class"]
    assert ["nonlinear_stiffening", "tool_inertia"] in [sorted(names) for names in found]
    assert all("tool_inertia" in names for names in found)


def uneven_friction(seed: int) -> tuple[Array, Array, Array]:
    """Return time, penetration, and force beside a friction that varies along the stroke."""
    rng, t, x, v = stroke(seed)
    friction = 0.8 * (1.0 + 0.3 * np.sin(900.0 * x)) * np.tanh(v / 2e-3)
    force = np.where(x > 0.0, 2500.0 * x + 12.0 * v, 0.0) + friction
    return t, x, force + 0.02 * rng.standard_normal(t.size)


def test_a_friction_that_varies_along_the_stroke_is_one_effect() -> None:
    assert best(*uneven_friction(1)) == {"coulomb_friction"}


def test_a_second_effect_is_searched_with_each_of_its_laws() -> None:
    """Beside a delay that is not yet where it belongs, another law of adhesion showed more."""
    record = make(1341903219, ("adhesion", "channel_delay"), "foam", size=0.108, noise=0.0034)
    assert best(record.t, record.position, record.force) == {"adhesion", "channel_delay"}


def test_backlash_under_a_mass_is_named() -> None:
    """Its impacts last less than a sample, and drowned the rest of the recording."""
    record = foreign(1088047660, ("backlash",))
    recording = from_arrays("play", record.t, record.position, record.force)
    assert diagnose(recording, record.base).answer["class"] == [["backlash"]]


def bristles(seed: int) -> tuple[Array, Array, Array]:
    """Return time, position and force of a fixed spring with LuGre friction, damped bristles."""
    rng, step = np.random.default_rng(seed), 1e-4
    t = np.arange(250_000) * step
    rates = np.geomspace(0.13, 2.1, 6)
    x = sum(4e-3 / (i + 2) * np.sin(2.0 * np.pi * f * t + rng.uniform(0, 6))
            for i, f in enumerate(rates))  # fmt: skip
    v, stiffness, damping = np.gradient(x, step), 2.2e4, 25.0
    bent, friction = 0.0, np.empty(t.size)
    most = (0.56 + 0.49 * np.exp(-((v / 6e-3) ** 2))) / stiffness
    for i, (speed, limit) in enumerate(zip(v.tolist(), most.tolist(), strict=True)):
        rate = speed - abs(speed) * bent / limit
        friction[i] = stiffness * bent + damping * rate
        bent += step * rate
    force = 900.0 * x + 30.0 * v + friction + 0.5
    t, x, force = t[::EVERY], x[::EVERY], force[::EVERY]
    return t, x, force + 0.007 * rng.standard_normal(t.size)


def test_the_damping_of_a_frictions_bristles_is_no_delay() -> None:
    """A negative delay absorbs it whole, 1e-4 of the friction's energy, and was named at 0.97."""
    answer = diagnose(from_arrays("bristles", *bristles(5)), "spring,viscous,bias").answer
    assert answer["class"] == [["stribeck_friction"]]
    assert answer["error"]["after_over_floor"] < 1.05
