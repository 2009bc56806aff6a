"""The delay study: mode x round trip x loss x environment x seed, against the alternatives.

The share of the force that the modes without a model reflect is the largest, in steps of 0.1, with
which every seed is stable without delay or loss in the environment at hand: found by the study
itself before it begins, for each of these modes alike.
"""

from __future__ import annotations

import csv
import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

from joblib import Parallel, delayed

from teleop_rt.config import Mode
from teleop_rt.study.delay_hand import PRESS_S, STRIDE_S
from teleop_rt.study.delay_measures import measure
from teleop_rt.study.delay_world import (
    MOVING_S,
    SETTLING_S,
    STILL_S,
    Cell,
    EnvironmentName,
    run_cell,
)

ROUND_TRIPS_MS = (0.0, 30.0, 150.0, 270.0, 700.0, 1000.0, 2000.0, 4000.0)
LOSSES = (0.0, 0.1)
MODES: tuple[Mode, ...] = get_args(Mode)
ENVIRONMENTS: tuple[EnvironmentName, ...] = get_args(EnvironmentName)
GAIN_STEP = 0.1
SECONDS_PER_SIMULATED_SECOND = 0.25
"""Of one core of the machine that the README's figures come from; the cost is a forecast."""

Result = dict[str, Any]
Gains = dict[tuple[Mode, EnvironmentName], float]
_COLUMNS = (
    "mode", "environment", "round_trip_ms", "loss", "seed", "gain", "stable", "unstable_because",
    "nrmse", "nrmse_transient", "lag_ms", "energy_min_J", "epsilon_J", "slave_force_max_N",
    "models_sent", "ticks",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Grid:
    """What the study varies."""

    modes: Sequence[Mode] = MODES
    round_trips_ms: Sequence[float] = ROUND_TRIPS_MS
    losses: Sequence[float] = LOSSES
    environments: Sequence[EnvironmentName] = ENVIRONMENTS
    seeds: Sequence[int] = (1, 2, 3)

    def cells(self) -> Iterator[Cell]:
        """Return every cell, the longest delays first, so that no core is left with one."""
        trips = sorted(self.round_trips_ms, reverse=True)
        for trip, mode, name, loss, seed in itertools.product(
            trips, self.modes, self.environments, self.losses, self.seeds
        ):
            yield Cell(mode, name, trip, loss, seed)


def simulated_s(cell: Cell) -> float:
    """Return about how long a cell lasts in its own time [s]."""
    trip_s = cell.round_trip_ms * 1e-3
    settling_s = (trip_s + SETTLING_S) * (2 if cell.environment == "step" else 1)
    return 3 * (STRIDE_S + trip_s) + PRESS_S + settling_s + MOVING_S + trip_s + STILL_S


def cost_s(cells: Iterable[Cell], jobs: int) -> float:
    """Return a forecast of the study's time on this many cores [s]."""
    return SECONDS_PER_SIMULATED_SECOND * sum(map(simulated_s, cells)) / jobs


def evaluate(cell: Cell) -> Result:
    """Run one cell and measure it."""
    return measure(run_cell(cell))


def evaluate_all(cells: Sequence[Cell], jobs: int, progress: Callable[[int], None]) -> list[Result]:
    """Run cells on several cores; results are in the order of the cells."""
    runs = Parallel(n_jobs=jobs, return_as="generator")(delayed(evaluate)(cell) for cell in cells)
    results = []
    for result in runs:
        results.append(result)
        progress(len(results))
    return results


def largest_stable_gain(mode: Mode, environment: EnvironmentName, seeds: Sequence[int]) -> float:
    """Return the largest share of reflected force that is stable without delay, by bisection.

    0 where none is: then the mode runs with the smallest step, and is not stable.
    """
    lowest, highest = 0, round(1 / GAIN_STEP)
    while lowest < highest:
        middle = (lowest + highest + 1) // 2
        cells = (Cell(mode, environment, 0.0, 0.0, s, gain=middle * GAIN_STEP) for s in seeds)
        if all(evaluate(cell)["stable"] for cell in cells):
            lowest = middle
        else:
            highest = middle - 1
    return lowest * GAIN_STEP


def find_gains(grid: Grid, jobs: int) -> Gains:
    """Return the gain of each mode without a model in each environment."""
    places = [
        (mode, name)
        for mode in grid.modes
        if mode != "model-mediated"
        for name in grid.environments
    ]
    found = Parallel(n_jobs=jobs)(
        delayed(largest_stable_gain)(mode, name, grid.seeds) for mode, name in places
    )
    return dict(zip(places, found, strict=True))


def tuned(grid: Grid, gains: Gains) -> list[Cell]:
    """Return the cells with their gains."""
    return [
        replace(cell, gain=max(GAIN_STEP, gains.get((cell.mode, cell.environment), 1.0)))
        for cell in grid.cells()
    ]


def write_table(folder: Path, gains: Gains, results: list[Result]) -> None:
    """Write delay.json, all there is, and delay.csv, a line for each cell."""
    found = [{"mode": mode, "environment": name, "gain": g} for (mode, name), g in gains.items()]
    told = {"gains": found, "cells": results}
    (folder / "delay.json").write_text(json.dumps(told, indent=1, allow_nan=False) + "\n")
    with (folder / "delay.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow((*_COLUMNS, "packets_master", "packets_slave"))
        for result in results:
            row = [result[name] for name in _COLUMNS]
            row[_COLUMNS.index("unstable_because")] = "; ".join(result["unstable_because"])
            writer.writerow((*row, *result["packets"].values()))


def default_jobs() -> int:
    """Return how many cores there are."""
    return os.cpu_count() or 1
