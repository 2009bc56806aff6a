from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from teleop_rt.study import delay
from teleop_rt.study.delay_measures import true_force
from teleop_rt.study.delay_report import winners, write_report
from teleop_rt.study.delay_world import Cell, Material, World, run_cell

CELLS = (
    Cell("model-mediated", "foam", 30.0, 0.1, 1),
    Cell("model-mediated", "silicone", 2000.0, 0.1, 2),
    Cell("model-mediated", "stiff", 150.0, 0.0, 1),
    Cell("model-mediated", "step", 270.0, 0.1, 1),
    Cell("direct", "silicone", 0.0, 0.0, 1),
    Cell("direct", "silicone", 270.0, 0.0, 1),
    Cell("tdpa", "silicone", 0.0, 0.0, 1),
    Cell("four-channel", "silicone", 0.0, 0.0, 1),
)


@pytest.fixture(scope="module")
def results() -> dict[Cell, dict[str, Any]]:
    return {cell: delay.evaluate(cell) for cell in CELLS}


@pytest.mark.parametrize("cell", CELLS[:4], ids=lambda cell: cell.environment)
def test_a_rendered_model_is_stable_and_true(
    results: dict[Cell, dict[str, Any]], cell: Cell
) -> None:
    told = results[cell]
    assert told["stable"], told["unstable_because"]
    assert told["nrmse"] <= 0.05
    assert told["energy_min_J"] >= -told["epsilon_J"]
    if cell.environment != "step":
        assert abs(told["lag_ms"]) <= 1.0
        assert told["slave_force_max_N"] <= 40.0
    assert told["models_sent"] <= 0.1 * told["ticks"]


@pytest.mark.parametrize("index", [4, 6, 7])
def test_every_baseline_works_without_delay(
    results: dict[Cell, dict[str, Any]], index: int
) -> None:
    told = results[CELLS[index]]
    assert told["stable"], told["unstable_because"]
    assert told["nrmse"] <= 0.02


def test_direct_reflection_is_found_unstable_under_delay(
    results: dict[Cell, dict[str, Any]],
) -> None:
    told = results[CELLS[5]]
    assert not told["stable"]
    assert "gives energy" in told["unstable_because"]


def test_the_impedance_felt_is_the_true_one_where_the_motion_excites_it(
    results: dict[Cell, dict[str, Any]],
) -> None:
    impedance = results[CELLS[1]]["impedance"]
    hertz = np.array(impedance["frequency_hz"])
    expected = np.abs(20.0 + 3600.0 / (2j * math.pi * hertz))
    np.testing.assert_allclose(impedance["true"], expected)
    here = hertz < 5
    assert here.sum() >= 5
    np.testing.assert_allclose(np.array(impedance["felt"])[here], expected[here], rtol=0.05)


def test_table_and_page_hold_every_cell(
    results: dict[Cell, dict[str, Any]], tmp_path: Path
) -> None:
    gains = {("direct", "silicone"): 1.0}
    delay.write_table(tmp_path, gains, list(results.values()))
    told = json.loads((tmp_path / "delay.json").read_text())
    assert len(told["cells"]) == len(CELLS)
    with (tmp_path / "delay.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["mode"] for row in rows] == [cell.mode for cell in CELLS]
    assert int(rows[0]["packets_master"]) > 10_000
    write_report(tmp_path, gains, list(results.values()))
    page = (tmp_path / "delay.html").read_text()
    assert "model-mediated: stable in 4 of 4 cells" in page
    assert (tmp_path / "felt_force.svg").stat().st_size > 10_000
    assert (tmp_path / "impedance.svg").stat().st_size > 10_000


def test_only_a_mode_that_is_stable_with_every_seed_can_win() -> None:
    def told(mode: str, seed: int, nrmse: float, *, stable: bool) -> dict[str, Any]:
        place = {"environment": "foam", "round_trip_ms": 0.0, "loss": 0.0}
        return place | {"mode": mode, "seed": seed, "nrmse": nrmse, "stable": stable}

    won = winners(
        [
            told("direct", 1, 0.01, stable=True),
            told("direct", 2, 0.01, stable=False),
            told("tdpa", 1, 0.04, stable=True),
            told("tdpa", 2, 0.06, stable=True),
        ]
    )
    assert won[0]["winner"] == "tdpa"
    assert won[0]["nrmse"] == {"tdpa": pytest.approx(0.05)}


def test_a_cell_is_the_same_again_and_another_seed_is_not() -> None:
    def motion(seed: int) -> np.ndarray:
        world = World(Cell("model-mediated", "silicone", 30.0, 0.1, seed))
        rows = []
        for _ in range(800):
            world.step()
            rows.append(world.master.row.copy())
        world.close()
        return np.array(rows)

    first = motion(1)
    np.testing.assert_array_equal(first, motion(1))
    assert not np.array_equal(first, motion(2), equal_nan=True)


def test_the_reference_is_the_environments_law_at_the_hands_own_place() -> None:
    traces = run_cell(Cell("direct", "foam", 0.0, 0.0, 1))
    x = traces.signals["position"] - traces.signals["offset"] - 0.0083
    v = traces.signals["velocity"]
    expected = np.where(x > 0, np.maximum(0.0, 400.0 * x + 3.0 * v), 0.0)
    np.testing.assert_allclose(true_force(traces), expected, atol=1e-12)
    assert expected.max() > 5


def test_a_deadband_saves_models_at_no_loss_of_truth() -> None:
    every, *others = (
        delay.evaluate(Cell("model-mediated", "silicone", 150.0, 0.0, 3, deadband=kind))
        for kind in ("none", "noise", "just-noticeable")
    )
    assert every["models_sent"] > 0.8 * (every["ticks"] - 3000)
    for few in others:
        assert few["models_sent"] <= 0.1 * few["ticks"]
        assert few["nrmse"] <= every["nrmse"] + 0.01


def test_the_study_tells_its_cost_first(call, tmp_path: Path) -> None:
    code, _, told = call("study", "delay", "--out", "out", "--cost", "--seeds", "2")
    assert code == 0
    assert "512 cells" in told
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("wrong", ["x", "1,,2", "-5", "99999"])
def test_wrong_round_trips_are_refused(call, wrong: str) -> None:
    assert call("study", "delay", "--out", "out", f"--round-trips={wrong}")[0] == 2


def test_material_never_pulls() -> None:
    assert Material(100.0, 50.0).force(0.01, -1.0) == 0.0
    assert Material(100.0, 50.0).force(-0.01, 1.0) == 0.0
