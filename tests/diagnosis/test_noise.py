from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import cases

from teleop_rt.contact.effects import LIBRARY, find
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.inference.tones import shows_tone_or_air_force
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Problem
from teleop_rt.diagnosis.models.least_squares import signed_least_squares
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.noise import whiten
from teleop_rt.diagnosis.noise.encoder import errors_without_jumps, input_floor
from teleop_rt.diagnosis.noise.saturated import basis
from teleop_rt.diagnosis.noise.structure import (
    air_contact_mismatch,
    air_contact_noise,
    lack_of_fit,
    noise_from,
    power_in_time,
    tangent_space,
)
from teleop_rt.diagnosis.samples.motion import differentiate
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt.recordings.rows import force_noise
from teleop_rt_dev.diagnosis.foreign_plants import foreign
from teleop_rt_dev.diagnosis.motions import jumping
from teleop_rt_dev.diagnosis.plants import Record, coloured_noise, make


@pytest.mark.parametrize("kind", ["white", "ar1", "pink", "resonant"])
def test_whitened_noise_has_variance_one_at_every_frequency(kind: str) -> None:
    record = make(11, (), noise=0.02, kind=kind)
    recording = from_arrays("n", record.t, record.position, record.force)
    problem = problem_of(recording, base_of("kelvin-voigt"), 0.0)
    for _ in range(2):
        fit = fit_base(problem, base_of("kelvin-voigt"))
        whitener = noise_from(problem, fit)
        problem = replace(problem, whitener=whitener)
    sigma = record.noise
    rng = np.random.default_rng(0)
    fresh = sigma * np.array([coloured_noise(rng, kind, record.t.size) for _ in range(20)])
    power = problem.whitener(fresh) ** 2
    bins = problem.whitener.bins
    for first, last in ((3, 30), (30, 200), (200, 1000), (1000, bins)):
        assert np.mean(power[:, first:last]) == pytest.approx(1.0, abs=0.35)
    fit = fit_base(problem, base_of("kelvin-voigt"))
    left = lack_of_fit(problem, fit, tangent_space(problem, fit))
    assert abs(left.excess) < 4 * left.deviation


@pytest.mark.parametrize("power", [0.0, 1.0, 1.5])
@pytest.mark.parametrize("hole", [False, True])
def test_noise_that_ends_elsewhere_than_it_began_is_no_drift(power: float, hole: bool) -> None:
    """A spectrum takes it to be periodic, and its jump from end to start for an unlikely one."""
    rng = np.random.default_rng(6)
    size, longer = 4000, 8
    frequency = np.maximum(np.arange(longer * size // 2 + 1), 1.0) / longer
    spectra = np.fft.rfft(rng.standard_normal((150, longer * size))) * frequency ** (-power / 2.0)
    noise = np.fft.irfft(spectra, longer * size)[:, :size]
    mask = np.ones(size)
    mask[:20] = mask[-20:] = 0.0
    if hole:
        mask[1200:1800] = 0.0
    whitener = whiten.white(mask, 1.0, 1e-3)
    bins = np.maximum(np.arange(whitener.bins), 0.25)
    whitener = replace(whitener, density=size * bins**-power)
    t = np.linspace(0.0, 1.0, size)
    drifts = np.array([t, 1.0 - np.exp(-4.0 * t), np.sin(2.5 * t), (t > 0.4) * 1.0])
    along = whitener(drifts)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    loudness = np.mean((whitener(noise) @ along.T) ** 2, axis=0)
    assert np.all(loudness < 3.0)
    assert np.all(loudness > 0.4)
    drawn = np.mean((whitener.draws(100) @ along.T) ** 2, axis=0)
    assert np.mean(drawn) == pytest.approx(1.0, rel=0.8)


def pressed_after_free_air(kind: str) -> tuple[Problem, float]:
    """Return a recording without noise, the noise's spectrum known, and the noise's deviation."""
    t = np.arange(12000) * 1e-3
    x = 5e-3 * np.sin(2 * np.pi * 0.7 * t) + 7e-3
    x[:2000] = np.linspace(-9e-3, x[2000], 2000)
    force = 3000.0 * np.maximum(x, 0.0)
    sigma = 0.005 * float(np.max(force))
    problem = problem_of(from_arrays("air", t, x, force), base_of("stiffness"), 0.0)
    colour = np.ones(problem.whitener.bins)
    if kind == "pink":
        colour = 1.0 / np.arange(0.5, colour.size)
    density = sigma**2 * t.size * colour / np.mean(colour)
    return replace(problem, whitener=replace(problem.whitener, density=density)), sigma


@pytest.mark.parametrize("kind", ["white", "pink"])
def test_noise_is_as_loud_in_a_short_stretch_of_free_air_as_in_contact(kind: str) -> None:
    """Of slow noise a stretch holds few independent values: chance makes one of them louder."""
    rng = np.random.default_rng(2)
    problem, sigma = pressed_after_free_air(kind)
    fit = fit_base(problem, base_of("stiffness"))
    nothing = np.zeros((1, fit.residual.size))
    chance = air_contact_noise(problem, nothing, problem.whitener.draws(24))
    assert chance is not None
    seeds = rng.integers(1000, 1 << 31, 40)
    drawn = [replace(fit, residual=problem.whitener.draws(1, int(seed))[0]) for seed in seeds]
    shares = [air_contact_mismatch(problem, noise, noise, chance) for noise in drawn]
    assert np.mean(np.array(shares) > 0.05) <= 0.025
    x = problem.motion.x
    louder = (
        fit.residual + 3.0 * problem.whitener((rng.standard_normal(x.size) * (x > 0.0))[None])[0]
    )
    assert air_contact_mismatch(problem, fit, replace(fit, residual=sigma * louder), chance) > 0.5


@pytest.mark.parametrize("kind", ["white", "pink"])
def test_noise_alone_shows_no_second_effect_in_free_air_and_a_bias_does(kind: str) -> None:
    problem, sigma = pressed_after_free_air(kind)
    fit = fit_base(problem, base_of("stiffness"))
    noise = problem.whitener.draws(40, 3)
    apart = [shows_tone_or_air_force(problem, replace(fit, residual=row), []) for row in noise]
    assert not any(apart)
    air = sigma * (problem.motion.x < 0.0)
    beside = noise[0] + problem.whitener(2.0 * air[None])[0]
    assert shows_tone_or_air_force(problem, replace(fit, residual=beside), []) is (kind == "white")


def test_power_in_time_of_white_noise_is_that_of_its_samples_within_the_band() -> None:
    rng = np.random.default_rng(1)
    size, dt, sigma = 4000, 1e-3, 0.3
    problem, _ = pressed_after_free_air("white")
    whitener = whiten.white(np.ones(size), 0.1, dt)
    problem = replace(problem, whitener=whitener, force=np.zeros(size))
    rows = whitener(sigma * rng.standard_normal((20, size)))
    power = np.mean([power_in_time(problem, row) for row in rows])
    assert power == pytest.approx(sigma**2 * whitener.bins / (size / 2), rel=0.03)


def test_signs_are_kept_and_the_rest_is_the_optimum() -> None:
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((4, 200))
    rows[1] = 0.9 * rows[0] + 0.1 * rows[1]
    target = 2.0 * rows[0] - 1.0 * rows[1] + 0.5 * rows[2] - 3.0 * rows[3]
    nonnegative = np.array([True, True, True, False])
    theta = signed_least_squares(rows, target, nonnegative)
    gradient = rows @ (target - theta @ rows)
    assert theta[1] == 0.0
    assert np.all(theta[:3] >= 0.0)
    assert gradient[1] <= 0.0
    np.testing.assert_allclose(gradient[[0, 2, 3]], 0.0, atol=1e-9)


def test_two_terms_that_cancel_are_no_larger_than_the_force() -> None:
    """A spring and the weight of a lever made a cube of the angle, each 118 times the force."""
    t = np.arange(4000) * 1e-3
    x = 0.04 * np.sin(2 * np.pi * 0.8 * t)
    force = 3.0 * x + 60.0 * x**3
    recording = from_arrays("lever", t, x, force, units=("rad", "Nm"))
    problem = problem_of(recording, base_of("spring"), 0.0)
    whitener = whiten.white(problem.whitener.mask, 0.01 * float(np.std(force)), 1e-3)
    problem = replace(problem, whitener=whitener)
    fit = problem.solve(CandidateModel(base_of("spring"), (find("gravity_torque"),)), np.zeros(0))
    made = fit.theta * np.linalg.norm(fit.columns, axis=1) / np.linalg.norm(problem.target)
    assert np.max(np.abs(made)) < 15.0
    assert fit.chi2 < 1.1 * fit.effective


def test_derivatives_of_a_fast_tone_are_kept_to_a_ten_thousandth() -> None:
    dt, half = 1e-3, 20
    t = np.arange(3000) * dt
    w = 2.0 * np.pi * 10.0
    found = differentiate(0.3 + np.sin(w * t), dt, half)
    truth = (0.3 + np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t))
    inside = slice(2 * half, -2 * half)
    for row, wanted, size in zip(found, truth, (1.0, w, w * w), strict=True):
        np.testing.assert_allclose(row[inside], wanted[inside], atol=1e-4 * size)


def test_chi_square_counts_the_samples_that_are_left_and_no_others() -> None:
    """Noise has variance 1 along the directions of these samples, for any share left out."""
    rng = np.random.default_rng(8)
    mask = np.ones(8000)
    mask[2000:5000] = 0.0
    noise = 0.3 * rng.standard_normal((200, mask.size))
    whitener = whiten.white(mask, 0.3, 1e-3)
    along = whitener(mask[None, :])[0]
    along /= np.linalg.norm(along)
    rows = whitener(noise)
    assert np.mean((rows @ along) ** 2) == pytest.approx(1.0, abs=0.3)
    assert np.mean(np.sum(rows**2, axis=1)) == pytest.approx(whitener.effective, rel=0.02)
    left = whiten.Left(rows[0], np.zeros(rows.shape[1]))
    found = whiten.estimate(left, left, whitener, 1e-3)
    assert np.mean(found.density) == pytest.approx(0.3**2 * mask.size, rel=0.1)


def test_the_noise_density_is_bounded_by_the_residual() -> None:
    """The power of the lowest octaves that a fit absorbed is extrapolated, within limits."""
    rng = np.random.default_rng(8)
    steps = rng.standard_normal(8000)
    quiet = whiten.white(np.ones(8000), 1.0, 1e-3)
    row = quiet(steps[None, :])[0]
    bins = quiet.bins
    red = 1.0 + 900.0 / np.maximum(np.arange(bins), 1.0) * (np.arange(bins) > 60)
    row *= np.tile(np.sqrt(red), 2)
    eaten = np.tile((np.arange(bins) <= 60).astype(float), 2)
    found = whiten.estimate(
        whiten.Left(row * (1.0 - eaten), eaten), whiten.Left(row, 0.0 * eaten), quiet, 1e-3
    )
    assert np.max(found.density[:32]) < 5.0 * 8000
    loud = replace(quiet, known=np.full(bins, 50.0 * 8000))
    found = whiten.estimate(
        whiten.Left(row * (1.0 - eaten), eaten), whiten.Left(row, 0.0 * eaten), loud, 1e-3
    )
    assert np.all(found.density >= found.known)


@pytest.mark.parametrize("seed", [345627640, 1813360645])
def test_encoder_errors_and_red_noise_at_the_edges_are_no_structure(seed: int) -> None:
    """A heavy tool behind a coarse encoder, and pink noise where samples are left out."""
    record = foreign(seed)
    recording = from_arrays("record", record.t, record.position, record.force)
    assert diagnose(recording, record.base, surface=0.0).answer["verdict"] == "no_missing_effect"


def test_a_sample_that_an_error_moves_across_the_surface_does_not_drown_a_comparison() -> None:
    """A damper's force jumps there; one draw of it is not representative of the recording."""
    problem = problem_of(
        from_arrays("jump", *jumping(0.0, noise=1e-3)), base_of("kelvin-voigt"), 0.0
    )
    problem = problem.keeping(np.ones_like(problem.whitener.mask))
    fit = fit_base(problem, base_of("kelvin-voigt"))
    x = problem.motion.x + 5e-8 * np.random.default_rng(4).standard_normal(problem.motion.x.size)
    crossed = x.copy()
    first = int(np.flatnonzero(np.diff(x > 0.0))[0]) + 1
    crossed[first] = -1e-9 if x[first] > 0.0 else 1e-9
    for errors, drowned in ((input_floor, True), (errors_without_jumps, False)):
        calm, loud = (
            float(np.sum(errors(problem, fit, [replace(problem.motion, x=row)]) ** 2))
            for row in (x, crossed)
        )
        assert (loud > 10.0 * calm) is drowned


def test_a_searched_shape_at_its_bound_counts_in_the_tangent_space() -> None:
    """A Stribeck ratio at its bound fits encoder errors as one in between does."""
    record = make(2142253565, (), "silicone", size=0.03699858580008644, noise=0.001494165428497593)
    recording = from_arrays("record", record.t, record.position, record.force)
    assert diagnose(recording, record.base, surface=0.0).answer["verdict"] == "no_missing_effect"


def test_a_parameter_at_its_bound_explains_nothing_beyond_it() -> None:
    t = np.arange(0.0, 8.0, 2e-3)
    x = 0.004 * np.sin(2 * np.pi * 0.7 * t) + 0.001 * np.sin(2 * np.pi * 3.1 * t)
    force = np.where(x > 0.0, 800.0 * x - 6e4 * x**2, 0.0)
    force += 0.01 * np.random.default_rng(2).standard_normal(t.size)
    problem = problem_of(from_arrays("soft", t, x, force), base_of("stiffness,damping"), 0.0)
    base = problem.refine(CandidateModel(base_of("stiffness,damping")), np.zeros(0))
    soft = next(e for e in LIBRARY if e.name == "force_saturation" and e.law == "soft")
    level = 1.1 * problem.motion.scales["force"]
    fit = problem.refine(CandidateModel(base.model.base, (soft,)), np.array([level, 4.0]))
    before, after = (lack_of_fit(problem, one, tangent_space(problem, one)) for one in (base, fit))
    assert fit.zeta[1] == pytest.approx(4.0)
    gained = base.chi2 - fit.chi2
    assert after.excess > before.excess - gained - 5.0 * before.deviation


def test_energy_beyond_a_model_is_that_of_a_projection_on_description_and_model() -> None:
    record = make(11, ("force_bias",), noise=0.02)
    recording = from_arrays("n", record.t, record.position, record.force)
    problem = problem_of(recording, base_of("kelvin-voigt"), 0.0)
    fit = fit_base(problem, base_of("kelvin-voigt"))
    own = tangent_space(problem, fit)
    whitened = problem.whitener(basis(problem.motion))
    whitened /= np.linalg.norm(whitened, axis=1, keepdims=True)
    _, sizes, both = np.linalg.svd(np.concatenate([whitened, own.T]), full_matrices=False)
    both = both[sizes**2 > 1e-7 * sizes[0] ** 2]
    (energy,), rank = problem.flexible.energy(fit.residual[None, :], own)
    expected = np.sum((both @ fit.residual) ** 2) - np.sum((own.T @ fit.residual) ** 2)
    assert energy == pytest.approx(expected, rel=0.02)
    assert rank == pytest.approx(len(both) - own.shape[1], abs=1)
    left, taken = problem.flexible.beside(fit.residual, own)
    assert left @ left == pytest.approx(fit.chi2 - energy, rel=1e-9)
    assert np.sum(taken) == pytest.approx(rank + own.shape[1], rel=1e-6)


@pytest.mark.parametrize("step", [0.0, 0.1, 0.5, 1.0, 1.4, 2.0])
def test_the_noise_of_readings_in_steps_is_that_of_the_readings(step: float) -> None:
    """The median of differences that lie on a grid would be up to a third off."""
    rng = np.random.default_rng(3)
    smooth = 7.0 * np.sin(2e-3 * np.arange(10_000))
    force = smooth + rng.normal(size=smooth.size)
    if step:
        force = step * np.round(force / step)
    assert force_noise(force) == pytest.approx(float(np.std(force - smooth)), rel=0.06)


def in_steps(record: Record, force: np.ndarray) -> Recording:
    """Return the record with another force, read in steps of a fourteenth of its deviation."""
    step = 0.07 * float(np.std(force))
    return from_arrays("steps", record.t, record.position, step * np.round(force / step))


@pytest.mark.parametrize("seed", cases(11, 13))
def test_pink_noise_as_large_in_free_air_as_in_contact_is_noise_of_any_size(seed: int) -> None:
    """It is a seventh of the force, more than most sensors have."""
    record = make(seed, (), noise=0.14, kind="pink")
    answer = diagnose(in_steps(record, record.force), "kelvin-voigt").answer
    assert answer["verdict"] == "no_missing_effect"


@pytest.mark.parametrize("seed", cases(11, 13))
def test_a_zero_that_jumps_in_free_air_and_contact_is_no_noise(seed: int) -> None:
    record = make(seed, (), noise=0.02)
    jumps = 0.3 * float(np.std(record.force)) * np.sign(np.sin(record.t * 1.9 + 0.3))
    answer = diagnose(in_steps(record, record.force + jumps), "kelvin-voigt", effects=()).answer
    assert answer["verdict"] == "unexplained"
