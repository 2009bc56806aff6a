"""The command line of the studies."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from teleop_rt.study import sweep_commands

if TYPE_CHECKING:
    from teleop_rt.study.delay import Gains, Result

app = typer.Typer(no_args_is_help=True, help="Repeatable studies.")
for sweep_command in (
    sweep_commands.chapter4,
    sweep_commands.noise,
    sweep_commands.time_varying,
    sweep_commands.excitation,
):
    app.command()(sweep_command)

RoundTrips = Annotated[str, typer.Option(help="round trips in ms, comma-separated")]
Losses = Annotated[str, typer.Option(help="shares of packets lost, comma-separated")]


@app.command()
def delay(
    out: Annotated[Path, typer.Option(help="folder to write; must be empty")],
    round_trips: RoundTrips = "0,30,150,270,700,1000,2000,4000",
    losses: Losses = "0,0.1",
    seeds: Annotated[int, typer.Option(min=1, help="seeds of each cell")] = 3,
    jobs: Annotated[int, typer.Option(min=0, help="cores to use; 0 takes all")] = 0,
    dry_run: Annotated[bool, typer.Option("--cost", help="print the cost, and stop")] = False,
) -> None:
    """Compare what the operator feels in every mode, at every delay, loss and environment."""
    from teleop_rt.study import delay as study  # noqa: PLC0415 - compiles and imports for seconds
    from teleop_rt.trial.folder import make_folder  # noqa: PLC0415 - as above

    grid = study.Grid(
        round_trips_ms=_numbers(round_trips, "--round-trips", 10_000.0),
        losses=_numbers(losses, "--losses", 0.9),
        seeds=tuple(range(1, seeds + 1)),
    )
    jobs = jobs or study.default_jobs()
    cells = list(grid.cells())
    forecast_min = study.cost_s(cells, jobs) / 60
    console = Console(stderr=True)
    console.print(
        f"{len(cells)} cells on {jobs} cores: about {forecast_min:.0f} min, and a few for the gains"
    )
    if dry_run:
        return
    folder = make_folder(out, "delay")
    gains = study.find_gains(grid, jobs)
    with Progress(console=console, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("cells", total=len(cells))
        results = study.evaluate_all(
            study.tuned(grid, gains), jobs, lambda done: bar.update(task, completed=done)
        )
    study.write_table(folder, gains, results)
    _report(folder, gains, results)
    console.print(f"files in {folder}", highlight=False)


def _report(folder: Path, gains: Gains, results: list[Result]) -> None:
    """Write figures and page where the extra `report` is installed."""
    try:
        from teleop_rt.study.delay_report import write_report  # noqa: PLC0415 - an extra
    except ImportError:
        print("no figures: pip install 'teleop-rt[report]' adds them", file=sys.stderr)
        return
    write_report(folder, gains, results)


def _numbers(text: str, option: str, most: float) -> tuple[float, ...]:
    """Return the numbers of a comma-separated option, between 0 and `most`."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is no list of numbers", param_hint=option) from None
    if not all(0 <= number <= most for number in numbers):
        raise typer.BadParameter(f"every number lies between 0 and {most:g}", param_hint=option)
    return numbers
