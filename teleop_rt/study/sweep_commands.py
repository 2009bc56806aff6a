"""The studies that sweep cases and can be taken up again: their commands."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from teleop_rt.batch.bar import bar
from teleop_rt.shipped import example, trial_file
from teleop_rt.trial.folder import plain_json

if TYPE_CHECKING:
    from teleop_rt.batch.workers import Case, Evaluate, Result, Workers
    from teleop_rt.study.chapter4_wiring import Wiring

Out = Annotated[Path, typer.Option(help="folder to write, or to resume")]
Jobs = Annotated[int, typer.Option(min=0, help="cores to use; 0 takes all")]
Scheduler = Annotated[str | None, typer.Option(help="a Dask scheduler, tcp://HOST:PORT")]
AsJson = Annotated[bool, typer.Option("--json", help="print the result as one JSON object")]
Seeds = Annotated[int, typer.Option(min=1, help="seeds of each case")]
Duration = Annotated[float, typer.Option(min=1.0, help="length of each case, in seconds")]
Frequencies = Annotated[str, typer.Option(help="frequencies [Hz], comma-separated")]
TrialFile = Annotated[
    Path,
    typer.Option(
        "--trial",
        metavar="TRIAL",
        parser=trial_file,
        show_default="silicone_cube, which ships",
        help="the trial that presses the cube",
    ),
]
CubeSeconds = Annotated[
    float,
    typer.Option(min=0.0, help="length of the cube's trial, in seconds; 0 leaves the cube out"),
]
ApproachTrips = Annotated[str, typer.Option("--round-trip-ms", help="round trips, comma-separated")]
ApproachSpeeds = Annotated[
    str, typer.Option("--hand-mm-per-s", help="speeds of the hand, comma-separated")
]
HandleTrial = Annotated[
    Path,
    typer.Option(
        "--trial",
        metavar="TRIAL",
        parser=trial_file,
        show_default="handle, which ships",
        help="the trial of a simulated handle",
    ),
]
_CUBE = example("trials", "silicone_cube")
_HANDLE = example("trials", "handle")
LONGEST_CONTACT = "operator.lift_off_every_s=86400.0"
"""The report's profile never lifts off."""


def chapter4(
    context: typer.Context,
    out: Out,
    frequencies: Frequencies = "0.5,1,3,5,10",
    duration: Duration = 10.0,
    trial: TrialFile = _CUBE,
    cube_s: CubeSeconds = 12.0,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Repeat the report's chapter 4, and compare each of its statements with the result."""
    with bar("loading the study", counts=False):
        from teleop_rt.batch.sweep import open_folder  # noqa: PLC0415 - as above
        from teleop_rt.batch.workers import Workers  # noqa: PLC0415 - as above
        from teleop_rt.study import chapter4 as study  # noqa: PLC0415 - compiles for seconds
        from teleop_rt.study.chapter4_report import write_report  # noqa: PLC0415 - as above
        from teleop_rt.study.chapter4_silicone import Specimen  # noqa: PLC0415 - as above

    cases = study.cases(numbers(frequencies, "--frequencies", 0.01, 100.0), duration)
    wiring: Wiring = context.obj
    loaded = None
    if cube_s:
        loaded = wiring.load_trial(trial, [f"duration_s={cube_s!r}", LONGEST_CONTACT])
    folder = open_folder(out, "study chapter4")
    workers = workers_of(jobs, scheduler)
    simulated = run_cases("simulations", folder, study.simulate, cases, workers)
    pressed = []
    if loaded is not None:
        cube = Specimen(loaded, trial, wiring.open_bench, folder / "cube")
        pressed = run_cases("cubes", folder, cube.press, cube.cases(), Workers(jobs=1))
    with bar("writing the page", counts=False):
        statements = [one.plain() for one in write_report(folder, simulated, pressed)]
    print_result(folder, "chapter4", {"statements": statements}, as_json=as_json)
    if not as_json:
        for one in statements:
            print(f"{one['verdict']:>10}  {one['text']}")


def noise(
    out: Out,
    seeds: Seeds = 3,
    duration: Duration = 8.0,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Sweep estimator x force noise x encoder step x lag of the force."""
    with bar("loading the study", counts=False):
        from teleop_rt.study import noise as study  # noqa: PLC0415 - compiles for seconds

    cases = study.cases(seeds=range(1, seeds + 1), duration_s=duration)
    _sweep("noise", study.evaluate, cases, out, workers_of(jobs, scheduler), as_json=as_json)


def time_varying(
    out: Out,
    seeds: Seeds = 3,
    duration: Duration = 10.0,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Sweep stiffness steps and ramps, and report how late each solver follows."""
    with bar("loading the study", counts=False):
        from teleop_rt.study import time_varying as study  # noqa: PLC0415 - compiles for seconds

    cases = study.cases(seeds=range(1, seeds + 1), duration_s=duration)
    _sweep("time-varying", study.evaluate, cases, out, workers_of(jobs, scheduler), as_json=as_json)


def excitation(
    out: Out,
    duration: Duration = 4.0,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Report which models one sinusoid excites, by offset, amplitude, frequency and force bias."""
    with bar("loading the study", counts=False):
        from teleop_rt.study import excitation as study  # noqa: PLC0415 - compiles for seconds

    cases = study.cases(duration_s=duration)
    _sweep("excitation", study.evaluate, cases, out, workers_of(jobs, scheduler), as_json=as_json)


def approach(
    context: typer.Context,
    out: Out,
    round_trips: ApproachTrips = "150,500,1000,2000",
    speeds: ApproachSpeeds = "10,40",
    trial: HandleTrial = _HANDLE,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Report the force on a hand before the first touch is known, with the leash and without."""
    with bar("loading the study", counts=False):
        from teleop_rt.study import approach as study  # noqa: PLC0415 - compiles for seconds

    trips = numbers(round_trips, "--round-trip-ms", 0.0, 10_000.0)
    cases = study.cases(trips, numbers(speeds, "--hand-mm-per-s", 1.0, 1000.0))
    wiring: Wiring = context.obj
    walking = study.Approach(wiring.load_trial, wiring.open_bench, trial)
    options = {"trial": str(trial)}
    _sweep(
        "approach", walking.walk, cases, out, workers_of(jobs, scheduler), options, as_json=as_json
    )


def _sweep(
    study: str,
    evaluate: Evaluate,
    cases: Sequence[Case],
    out: Path,
    workers: Workers,
    options: Mapping[str, Any] | None = None,
    *,
    as_json: bool,
) -> None:
    """Run a study's cases, or those still missing, and write its tables, figures and page."""
    from teleop_rt.batch.sweep import open_folder  # noqa: PLC0415 - imports for seconds
    from teleop_rt.study.sweep_report import write_study  # noqa: PLC0415 - as above

    folder = open_folder(out, f"study {study}", options)
    results = run_cases(study, folder, evaluate, cases, workers)
    with bar("writing the page", counts=False):
        summary = write_study(folder, study, results)
    print_result(folder, study, summary, as_json=as_json)


def run_cases(
    what: str, folder: Path, evaluate: Evaluate, cases: Sequence[Case], workers: Workers
) -> list[Result]:
    """Run the cases that are missing under a progress bar."""
    from teleop_rt.batch.sweep import sweep  # noqa: PLC0415 - imports for seconds

    with bar(what) as progress:
        return sweep(folder, evaluate, cases, workers, progress)


def workers_of(jobs: int, scheduler: str | None) -> Workers:
    """Return where the cases run."""
    from teleop_rt.batch.workers import Workers  # noqa: PLC0415 - imports for seconds

    return Workers(jobs, scheduler)


def print_result(folder: Path, study: str, found: dict[str, Any], *, as_json: bool) -> None:
    """Print the one JSON object, or where the files are."""
    if as_json:
        print(json.dumps(plain_json({"study": study, "folder": str(folder)} | found)))
    else:
        Console(stderr=True).print(f"files in {folder}", highlight=False)


def numbers(text: str, option: str, least: float, most: float) -> tuple[float, ...]:
    """Return the numbers of a comma-separated option, each from `least` to `most`."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a list of numbers", param_hint=option) from None
    if not all(least <= number <= most for number in found):
        raise typer.BadParameter(
            f"every number lies between {least:g} and {most:g}", param_hint=option
        )
    return found
