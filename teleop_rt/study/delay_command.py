"""The command of the delay study: any part of its grid, taken up again where it was left."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from teleop_rt.batch.bar import bar
from teleop_rt.extras import install_command
from teleop_rt.study.sweep_commands import (
    AsJson,
    Jobs,
    Out,
    Scheduler,
    Seeds,
    numbers,
    print_result,
    run_cases,
    workers_of,
)

if TYPE_CHECKING:
    from pathlib import Path

    from teleop_rt.batch.workers import Result, Workers
    from teleop_rt.study.delay import Gains, Grid

Modes = Annotated[str, typer.Option("--mode", help="modes, comma-separated")]
Environments = Annotated[str, typer.Option("--environment", help="environments, comma-separated")]
RoundTrips = Annotated[str, typer.Option("--round-trip-ms", help="round trips, comma-separated")]
Losses = Annotated[str, typer.Option("--loss", help="shares of packets lost, comma-separated")]
Cost = Annotated[
    bool, typer.Option("--cost", help="print the number of cells and the time they take, and exit")
]


def delay(
    out: Out,
    modes: Modes = "model-mediated,direct,tdpa,four-channel",
    environments: Environments = "foam,silicone,stiff,step",
    round_trips: RoundTrips = "0,30,150,270,700,1000,2000,4000",
    losses: Losses = "0,0.1",
    seeds: Seeds = 3,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    dry_run: Cost = False,
    as_json: AsJson = False,
) -> None:
    """Compare the operator's felt force in every mode, at every delay, loss and environment.

    Finished cells in the folder are kept: the same command resumes an interrupted study.
    """
    with bar("loading the study", counts=False):
        from teleop_rt.study import delay as study  # noqa: PLC0415 - compiles and imports for seconds

    grid = study.Grid(
        modes=_some(modes, study.MODES, "--mode"),
        environments=_some(environments, study.ENVIRONMENTS, "--environment"),
        round_trips_ms=numbers(round_trips, "--round-trip-ms", 0.0, 10_000.0),
        losses=numbers(losses, "--loss", 0.0, 0.9),
        seeds=tuple(range(1, seeds + 1)),
    )
    workers = workers_of(jobs, scheduler)
    Console(stderr=True).print(study.forecast(grid, out, workers.count), highlight=False)
    if not dry_run:
        _study(grid, out, workers, as_json=as_json)


def _study(grid: Grid, out: Path, workers: Workers, *, as_json: bool) -> None:
    """Run the cells that the folder lacks, write table and page, and print the result."""
    from teleop_rt.batch.sweep import open_folder  # noqa: PLC0415 - as above
    from teleop_rt.study import delay as study  # noqa: PLC0415 - as above

    folder = open_folder(out, "study delay")
    gains = study.find_gains(
        grid, lambda cases: run_cases("shares", folder, study.evaluate, cases, workers)
    )
    cases = study.cell_cases(grid, gains)
    results = run_cases("cells", folder, study.evaluate, cases, workers)
    with bar("writing the page", counts=False):
        study.write_table(folder, gains, results)
        found = _report(folder, grid, gains, results)
    print_result(folder, "delay", found, as_json=as_json)


def _report(folder: Path, grid: Grid, gains: Gains, results: list[Result]) -> dict[str, Any]:
    """Write figures and page where the extra `report` is installed; return who wins where."""
    from teleop_rt.study.delay import overview  # noqa: PLC0415 - as above

    try:
        from teleop_rt.study.delay_report import write_report  # noqa: PLC0415 - an extra
    except ImportError:
        print(f"no figures: `{install_command('report')}` adds them", file=sys.stderr)
    else:
        write_report(folder, gains, results)
    return overview(grid, results)


def _some(text: str, known: Sequence[Any], option: str) -> tuple[Any, ...]:
    """Return the names of a comma-separated option, each of them known."""
    names = tuple(text.split(","))
    for name in names:
        if name not in known:
            raise typer.BadParameter(
                f"{name!r} is not one of {', '.join(known)}", param_hint=option
            )
    return names
