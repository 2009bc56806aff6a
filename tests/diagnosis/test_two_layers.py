"""A body of two layers beside another effect, where no approach shows the surface clearly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.inference.screening import screen
from teleop_rt.diagnosis.inference.search import fit_base, fit_start
from teleop_rt.diagnosis.inference.starts import extended
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.recordings.recording import from_arrays
from teleop_rt.diagnosis.samples.preparation import pose

DT, SURFACE_M, LAYER_M, DRIFT_N, NOISE_N = 4e-3, -0.0045, 0.0087, 3.4, 0.06


def test_a_second_layer_is_found_from_a_surface_that_is_too_deep() -> None:
    t = np.arange(0.0, 10.0, DT)
    ways = ((0.0072, 0.37, 0.3), (0.0031, 0.91, 1.1), (0.0017, 2.3, 2.0))
    x = 0.001 + sum(size * np.sin(2 * np.pi * hz * t + phase) for size, hz, phase in ways)
    depth = x - SURFACE_M
    body = 890.0 * depth + 20.7 * np.gradient(x, DT) + 400.0 * np.maximum(depth - LAYER_M, 0.0)
    force = np.where(depth > 0.0, np.maximum(body, 0.0), 0.0) + DRIFT_N * (1.0 - np.exp(-t / 2.7))
    force += NOISE_N * np.random.default_rng(3).standard_normal(t.size)
    drift, layer = (
        next(e for e in LIBRARY if (e.name, e.law) == effect)
        for effect in (("force_drift", "exponential"), ("second_layer", ""))
    )
    problem, model = pose(from_arrays("layers", t, x, force), base_of("kelvin-voigt"), None)
    # No approach shows the surface: the first estimate is 2 mm outside of it.
    problem = replace(problem, motion=replace(problem.motion, x=problem.motion.x + 0.002))
    base = fit_base(problem, model)
    alone = problem.refine(extended(base.model, drift), np.append(base.zeta - 0.0015, 2.7))
    (start,) = screen(problem, alone, (layer,))
    assert start.gain > 0.9 * alone.chi2
    found = fit_start(problem, start, 3)
    assert found.chi2 < 1.1 * problem.whitener.effective
