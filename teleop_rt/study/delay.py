"""The delay study: mode x round trip x loss x environment x seed, against the alternatives.

The share of the force that the modes without a model reflect is the largest, in steps of 0.1, with
which the first seeds are stable without delay or loss in the environment at hand: found by the
study itself before it begins, for each of these modes alike, whatever part of the grid is run.
"""

from __future__ import annotations

import csv
import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import mean
from typing import Any, get_args

from teleop_rt.batch.sweep import CASES, finished, key_of
from teleop_rt.batch.workers import Case, Result
from teleop_rt.config.master import Mode
from teleop_rt.study.delay_hand import PRESS_S, STRIDE_S
from teleop_rt.study.delay_measures import measure
from teleop_rt.study.delay_plant import EnvironmentName
from teleop_rt.study.delay_table import tables
from teleop_rt.study.delay_world import (
    MOVING_S,
    SETTLING_S,
    STILL_S,
    Cell,
    run_cell,
)

ROUND_TRIPS_MS = (0.0, 30.0, 150.0, 270.0, 700.0, 1000.0, 2000.0, 4000.0)
LOSSES = (0.0, 0.1)
"""Round trips from one room to beyond the Moon; no loss, and a bad radio link."""
MODES: tuple[Mode, ...] = get_args(Mode)
ENVIRONMENTS: tuple[EnvironmentName, ...] = get_args(EnvironmentName)
GAIN_STEP = 0.1
"""The coupling gain falls by this until it is stable with each of the seeds."""
GAIN_SEEDS = (1, 2)  # a gain at which only one of them is stable is too high
SECONDS_PER_SIMULATED_SECOND = 0.25
"""Of one core of the machine that the README's figures come from; the cost is a forecast."""

Gains = dict[tuple[Mode, EnvironmentName], float]
_COLUMNS = (
    "mode", "environment", "round_trip_ms", "loss", "seed", "gain", "stable", "unstable_because",
    "nrmse", "nrmse_transient", "lag_ms", "lag_to_true_ms", "energy_min_J", "epsilon_J",
    "slave_force_max_N", "models_sent", "ticks",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Grid:
    """The variables of the study."""

    modes: Sequence[Mode] = MODES
    round_trips_ms: Sequence[float] = ROUND_TRIPS_MS
    losses: Sequence[float] = LOSSES
    environments: Sequence[EnvironmentName] = ENVIRONMENTS
    seeds: Sequence[int] = (1, 2, 3)

    def cells(self) -> Iterator[Cell]:
        """Return every cell, a seed after the other, so that a study left early is whole.

        Of a seed the longest delays come first, so that no core is left with one.
        """
        trips = sorted(self.round_trips_ms, reverse=True)
        for seed, trip, mode, name, loss in itertools.product(
            self.seeds, trips, self.modes, self.environments, self.losses
        ):
            yield Cell(mode, name, trip, loss, seed)

    @property
    def reflecting(self) -> list[tuple[Mode, EnvironmentName]]:
        """Every mode without a model, in each environment."""
        modes = [mode for mode in self.modes if mode != "model-mediated"]
        return list(itertools.product(modes, self.environments))


def simulated_s(cell: Cell) -> float:
    """Return about how long a cell lasts in its own time [s]."""
    trip_s = cell.round_trip_ms * 1e-3
    settling_s = (trip_s + SETTLING_S) * (2 if cell.environment == "step" else 1)
    engaging_s, strides_s = 3 * trip_s, 3 * (STRIDE_S + trip_s)
    return engaging_s + strides_s + PRESS_S + settling_s + MOVING_S + trip_s + STILL_S


def cost_s(cells: Iterable[Cell], jobs: int) -> float:
    """Return a forecast of the study's time on this many cores [s]."""
    return SECONDS_PER_SIMULATED_SECOND * sum(map(simulated_s, cells)) / jobs


def forecast(grid: Grid, folder: Path, jobs: int) -> str:
    """Return in words how much there is to do, and how long it takes; done cells are left out.

    Whether a cell of a reflecting mode is done is known by all of it but its share, and so too
    early for those that only helped to find it.
    """
    done = {_place(case) for case in map(json.loads, finished(folder / CASES))}
    cells = list(grid.cells())
    missing = [cell for cell in cells if _place(asdict(cell)) not in done]
    minutes = cost_s(missing, jobs) / 60
    return (
        f"{len(cells)} cells, {len(cells) - len(missing)} of them done: about {minutes:.0f} min on "
        f"{jobs} cores, and a few for the shares of the modes without a model"
    )


def _place(case: Case) -> str:
    return key_of({name: value for name, value in case.items() if name != "gain"})


def evaluate(case: Case) -> Result:
    """Run one cell and measure it."""
    return measure(run_cell(Cell(**case)))


def cell_cases(grid: Grid, gains: Gains) -> list[Case]:
    """Return the cells with their gains, as cases of a sweep."""
    gain_of = {place: max(GAIN_STEP, gain) for place, gain in gains.items()}
    cells = grid.cells()
    return [asdict(replace(c, gain=gain_of.get((c.mode, c.environment), 1.0))) for c in cells]


def find_gains(grid: Grid, run: Callable[[list[Case]], list[Result]]) -> Gains:
    """Return the largest share that is stable without delay at each place, from all of it down.

    Step by step, for a share below an unstable one need not be stable. `run` evaluates cases,
    each of them a cell of its own, so that nothing found is lost. 0 where no share is stable: then
    the mode runs with the smallest step, and is not stable.
    """
    gains = dict.fromkeys(grid.reflecting, 0.0)
    for steps in range(round(1 / GAIN_STEP), 0, -1):
        places = [place for place, gain in gains.items() if not gain]
        for seed in GAIN_SEEDS:
            if places:
                results = run([_without_delay(place, steps, seed) for place in places])
                judged = zip(places, results, strict=True)
                places = [place for place, result in judged if result["stable"]]
        gains |= dict.fromkeys(places, steps * GAIN_STEP)
    return gains


def _without_delay(place: tuple[Mode, EnvironmentName], steps: int, seed: int) -> Case:
    return asdict(Cell(*place, 0.0, 0.0, seed, steps * GAIN_STEP))


def winners(results: Sequence[Result]) -> list[dict[str, Any]]:
    """Return the best mode at each place: of those stable with every seed, the least NRMSE."""
    places = sorted({(r["environment"], r["round_trip_ms"], r["loss"]) for r in results})
    winners = []
    for environment, trip, loss in places:
        here = [
            r for r in results
            if (r["environment"], r["round_trip_ms"], r["loss"]) == (environment, trip, loss)
        ]  # fmt: skip
        errors: dict[str, float] = {}
        for mode in sorted({r["mode"] for r in here}):
            own = [r for r in here if r["mode"] == mode]
            if all(r["stable"] and r["nrmse"] is not None for r in own):
                errors[mode] = mean(r["nrmse"] for r in own)
        best = min(errors, key=errors.__getitem__) if errors else None
        winners.append(
            {"environment": environment, "round_trip_ms": trip, "loss": loss,
             "winner": best, "nrmse": errors}
        )  # fmt: skip
    return winners


def overview(grid: Grid, results: Sequence[Result]) -> dict[str, Any]:
    """Return the result in a few figures: stable cells and wins by mode, and the winners."""
    won = winners(results)
    modes = {}
    for mode in grid.modes:
        own = [r for r in results if r["mode"] == mode]
        modes[mode] = {
            "cells": len(own),
            "stable": sum(r["stable"] for r in own),
            "wins": sum(w["winner"] == mode for w in won),
            "nrmse_max": _largest(own, "nrmse"),
            "lag_ms_max": _largest(own, "lag_ms"),
            "slave_force_max_N": _largest(own, "slave_force_max_N"),
        }
    return {"places": len(won), "modes": modes, "winners": won}


def _largest(results: Iterable[Result], name: str) -> float | None:
    """Return the largest size of a figure over stable cells, None where none has it."""
    found = [abs(r[name]) for r in results if r["stable"] and r[name] is not None]
    return max(found, default=None)


def write_table(folder: Path, gains: Gains, results: list[Result]) -> None:
    """Write delay.json, all there is, delay.csv, a line for each cell, and the tables delay.md."""
    found = [{"mode": mode, "environment": name, "gain": g} for (mode, name), g in gains.items()]
    document = {"gains": found, "cells": results}
    (folder / "delay.json").write_text(json.dumps(document, indent=1, allow_nan=False) + "\n")
    (folder / "delay.md").write_text(tables(results, gains), encoding="utf-8")
    with (folder / "delay.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow((*_COLUMNS, "packets_master", "packets_slave"))
        for result in results:
            row = [result[name] for name in _COLUMNS]
            row[_COLUMNS.index("unstable_because")] = "; ".join(result["unstable_because"])
            writer.writerow((*row, *result["packets"].values()))
