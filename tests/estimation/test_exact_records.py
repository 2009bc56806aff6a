"""Exact records of one contact, by formulas of their own: every row ends at the truth.

The tool stays in the body throughout and its surface is given, so nothing but the regressions, the
solvers and their gate is under test.
"""

import numpy as np
import pytest

from teleop_rt.offline.replay import Choice, replay
from teleop_rt.offline.table import Table

SECONDS, PERIOD_S = 10.0, 1e-3
WITHIN = 0.08
LINEARISED = 0.05
"""Largest b v / k of Hunt-Crossley: its regressions take ln(1 + q) for q."""
DEEP = {"frequency_hz": 5.0, "mean": 14.8e-3, "amplitude": 6.1e-3, "exponent": 1.41}
SHALLOWER = DEEP | {"mean": 10.4e-3, "amplitude": 6.2e-3}


def exact_record(model, rng, **given):
    """Return time, position and force of a sinusoid inside a body, and the body's parameters."""
    mean = rng.uniform(4e-3, 16e-3)
    drawn = {
        "frequency_hz": np.exp(rng.uniform(np.log(0.8), np.log(6.0))),
        "mean": mean,
        "amplitude": mean * rng.uniform(0.3, 0.8),
        "exponent": rng.uniform(1.0, 2.0),
    } | given
    mean, amplitude, n = drawn["mean"], drawn["amplitude"], drawn["exponent"]
    omega = 2.0 * np.pi * drawn["frequency_hz"]
    t = np.arange(0.0, SECONDS, PERIOD_S)
    angle = omega * t + rng.uniform(0.0, 2.0 * np.pi)
    x = mean + amplitude * np.sin(angle)
    v = amplitude * omega * np.cos(angle)
    stiffness = np.exp(rng.uniform(np.log(300.0), np.log(6000.0)))
    least_force_over_speed = stiffness * (mean - amplitude) / (amplitude * omega)
    if model == "hunt-crossley":
        k = stiffness * 8e-3 ** (1.0 - n)
        share = rng.uniform(0.01, LINEARISED) / (amplitude * omega)
        return t, x, k * x**n * (1.0 + share * v), {"k": k, "b": k * share, "n": n}
    b = least_force_over_speed * rng.uniform(0.2, 0.6)
    if model == "mass-spring-damper":
        m = stiffness / omega**2 * rng.uniform(0.02, 0.3)
        return t, x, m * (mean - x) * omega**2 + stiffness * x + b * v, {
            "m": m, "k": stiffness, "b": b
        }  # fmt: skip
    dragging = np.maximum(v, 0.0) if model == "kelvin-voigt-unilateral" else v
    return t, x, stiffness * x + b * dragging, {"k": stiffness, "b": b}


def rows_off(path, model, record):
    """Return the rows of a replay that do not end near the truth."""
    t, x, force, truth = record
    np.savez(path, t_s=t, position_m=x, force_N=force)
    answer, _ = replay(path, Choice(models=[model], surface=0.0), Table({}, {}, None))
    off = []
    for row in answer["estimators"]:
        found = {name: row["parameters"][name]["value"] for name in truth}
        near = all(
            value is not None and abs(value / truth[name] - 1.0) < WITHIN
            for name, value in found.items()
        )
        if not near:
            off.append((row["regression"], row["solver"], row["status"], found))
    return off, len(answer["estimators"])


@pytest.mark.parametrize("given", [DEEP, SHALLOWER], ids=["deep", "shallower"])
def test_hunt_crossley_is_found_wherever_in_the_body_the_motion_stays(tmp_path, given):
    record = exact_record("hunt-crossley", np.random.default_rng(3), **given)
    off, rows = rows_off(tmp_path / "record.npz", "hunt-crossley", record)
    assert off == []
    assert rows == 10


@pytest.mark.parametrize(
    ("model", "rows"),
    [
        ("kelvin-voigt", 10),
        ("kelvin-voigt-unilateral", 5),
        ("mass-spring-damper", 10),
        ("hunt-crossley", 10),
    ],
)
def test_every_row_ends_at_the_truth_of_any_exact_record(tmp_path, model, rows):
    rng = np.random.default_rng(20)
    for number in range(5):
        record = exact_record(model, rng)
        off, count = rows_off(tmp_path / f"{number}.npz", model, record)
        assert off == [], record[3]
        assert count == rows
