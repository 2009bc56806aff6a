"""A body of two layers beside another effect, where no approach shows the surface clearly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.screening import screen
from teleop_rt.diagnosis.inference.search import fit_base, fit_start
from teleop_rt.diagnosis.inference.starts import extended
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.samples.preparation import pose
from teleop_rt.recordings.recording import from_arrays

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


def test_a_rounded_lump_in_a_foam_needs_no_stiffening_beside_it() -> None:
    dt_s = 2.0 * DT
    t = np.arange(0.0, 12.0, dt_s)
    ways = ((0.0042, 0.41, 0.2), (0.0021, 1.07, 1.4), (0.0009, 2.6, 2.9))
    x = sum(size * np.sin(2 * np.pi * hz * t + phase) for size, hz, phase in ways)
    depth = np.maximum(x, 0.0)
    foam = depth**1.6 * (2.4e4 + 900.0 * np.gradient(x, dt_s))
    force = np.maximum(foam + 6.0e4 * np.maximum(depth - 0.0032, 0.0) ** 1.5, 0.0)
    force += 0.004 * np.std(force) * np.random.default_rng(5).standard_normal(t.size)
    answer = diagnose(from_arrays("lump", t, x, force), "hunt-crossley").answer
    assert answer["class"] == [["second_layer"]]
    depth_m = answer["effects"][0]["parameters"]["depth"]
    assert abs(depth_m["value"] - 0.0032) < 4.0 * depth_m["std"] < 3e-4


def test_a_layer_that_begins_gradually_leaves_noise_alone_beside_a_dry_guide() -> None:
    t = np.arange(0.0, 24.0, DT)
    presses = np.sin(np.pi * t / 3.0) ** 2 * (0.6 + 0.4 * np.sin(0.9 * t)) ** 2
    x = -0.002 + 0.011 * presses + 2e-4 * np.sin(2.0 * np.pi * 2.3 * t)
    v, depth = np.gradient(x, DT), np.maximum(x, 0.0)
    # The interface lies at depths of 3.7 to 4.7 mm, as often at each.
    places = np.linspace(0.0037, 0.0047, 41)
    layer = 1900.0 * np.mean([np.maximum(depth - place, 0.0) for place in places], axis=0)
    body = np.where(x > 0.0, np.maximum(850.0 * depth + 9.0 * v + layer, 0.0), 0.0)
    force = body + 0.7 * np.tanh(v / 0.0015)
    force += 0.02 * np.random.default_rng(8).standard_normal(t.size)
    answer = diagnose(from_arrays("graded", t, x, force), "kelvin-voigt").answer
    assert [set(names) for names in answer["class"]] == [{"second_layer", "coulomb_friction"}]
    layer_found = next(e for e in answer["effects"] if e["name"] == "second_layer")
    assert abs(layer_found["parameters"]["depth"]["value"] - 0.0042) < 2e-4
    assert layer_found["law"] == "gradual"
    assert answer["error"]["after_over_floor"] < 1.02


@pytest.mark.parametrize("spread_m", [1e-6, 1e-4])
@pytest.mark.parametrize(("base", "power"), [("kelvin-voigt", 1.0), ("hunt-crossley", 1.5)])
def test_a_softer_body_below_a_crust_is_a_second_layer(
    base: str, power: float, spread_m: float
) -> None:
    t = 2e-3 * np.arange(6000)
    x = 1e-3 + 2.2e-3 * np.sin(2 * np.pi * 0.31 * t - 1.2) + 1.2e-3 * np.sin(2 * np.pi * 0.83 * t)
    depth = np.maximum(x, 0.0)
    inner = spread_m * np.logaddexp(0.0, (x - 1.5e-3) / spread_m)
    dragged = (
        8.0 * np.gradient(x, 2e-3) * (depth / 2e-3) ** (power if power > 1.0 else 0.0) * (x > 0.0)
    )
    force = 1500.0 * depth * (depth / 4e-3) ** (power - 1.0) + dragged - 600.0 * inner
    force += 0.02 * np.random.default_rng(5).standard_normal(t.size)
    answer = diagnose(from_arrays("crust", t, x, force), base).answer
    assert answer["class"] == [["second_layer"]]
    assert answer["error"]["after_over_floor"] < 1.02
    found = answer["effects"][0]["parameters"]
    assert found["depth"]["value"] == pytest.approx(1.5e-3, rel=0.01)
    assert found["layer_stiffness"]["value"] == pytest.approx(600.0, rel=0.02)
