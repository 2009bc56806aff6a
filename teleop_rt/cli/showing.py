"""The commands that show a run: its report, and the live page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer

from teleop_rt.batch.bar import Bar, bar
from teleop_rt.cli.options import LivePort
from teleop_rt.errors import RecordingError
from teleop_rt.extras import install_command
from teleop_rt.outputs import refuse_filled

GradeName = Literal["good", "attention", "bad", "unknown"]


def report(
    folders: Annotated[
        list[Path],
        typer.Argument(
            help="run folder; two or more with --compare; or those of a slave and a master"
        ),
    ],
    compare: Annotated[
        bool, typer.Option("--compare", help="compare runs side by side on one page")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", help="page to write, with --compare")] = None,
    figures: Annotated[
        Path | None,
        typer.Option(help="also write each figure as SVG, PDF and CSV into this folder"),
    ] = None,
) -> None:
    """Write the report of a run from its folder, also after a fault or a crash."""
    if compare and len(folders) == 1:
        raise RecordingError("give one run folder, or two or more after --compare")
    if figures is not None and len(folders) > 1 and not compare:
        raise RecordingError("--figures goes with one run folder: leave out --figures")
    if out is not None and not compare:
        raise RecordingError(
            "--out goes with --compare: leave it out; the report of one run is its report.html"
        )
    if figures is not None and compare:
        raise RecordingError("--figures goes with one run folder: leave out --figures or --compare")
    if figures is not None:
        refuse_filled(figures, "name another folder with --figures")
    with bar("loading the report", counts=False) as shown:
        for path in _written(folders, out, figures, shown, compare=compare):
            with shown.aside():
                print(path)


def _written(
    folders: Sequence[Path], out: Path | None, figures: Path | None, shown: Bar, *, compare: bool
) -> Iterator[Path]:
    """Write the requested page, then the figures; yield the path of each."""
    from teleop_rt.cli.reporting import felt_of, rebuilt  # noqa: PLC0415 - loads compilers, drivers

    try:
        from teleop_rt.view.commands import (  # noqa: PLC0415 - an extra may be absent
            compare_folders,
            figures_of_folder,
            report_of_folder,
            report_of_sides,
        )
    except ImportError:
        raise RecordingError(f"no report: `{install_command('report')}` adds it") from None
    shown.phase("writing the page")
    if compare:
        yield compare_folders(folders, out, rebuilt, felt_of)
    elif len(folders) > 1:
        yield report_of_sides(folders, rebuilt)
    else:
        yield report_of_folder(folders[0], rebuilt, felt_of)
    if figures is not None:
        shown.phase("writing the figures")
        yield from figures_of_folder(folders[0], figures, rebuilt, felt_of)


def runs(
    folder: Annotated[Path, typer.Argument(help="folder of runs")] = Path("runs"),
    trial: Annotated[
        str | None, typer.Option(help="list only trials whose name contains this text")
    ] = None,
    grade: Annotated[GradeName | None, typer.Option(help="list only runs of this grade")] = None,
    open_: Annotated[
        bool, typer.Option("--open", help="open the report of the newest listed run in a browser")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print one line of JSON per run")] = False,
) -> None:
    """List the runs of a folder, the newest first: date, trial, verdict, model and felt error."""
    with bar("reading the runs", counts=False):
        from teleop_rt.view.console import output  # noqa: PLC0415 - as below
        from teleop_rt.view.runs import print_runs, runs_of  # noqa: PLC0415 - loads estimators

        found = [
            run
            for run in runs_of(folder)
            if (trial is None or trial in (run.trial or "")) and grade in {None, run.grade}
        ]
    if as_json:
        for run in found:
            print(json.dumps(asdict(run)))
    elif found:
        print_runs(output(), found)
    else:
        chosen = "" if trial is None and grade is None else " of this trial or grade"
        print(f"no runs{chosen} in {folder}")
    if open_ and found:
        page = Path(found[0].folder) / "report.html"
        if not page.is_file():
            raise RecordingError(f"{page}: is missing: `teleop-rt report {page.parent}` writes it")
        typer.launch(page.resolve().as_uri())


def live(
    recording: Annotated[
        Path | None,
        typer.Argument(help="recording or run folder to play back; default: the running slave"),
    ] = None,
    port: LivePort = 5006,
    host: Annotated[
        str,
        typer.Option(help="address to serve at; by default only this machine can open the page"),
    ] = "127.0.0.1",
    foxglove: Annotated[
        bool,
        typer.Option("--foxglove", help="serve Foxglove's WebSocket protocol in place of the page"),
    ] = False,
    beside: Annotated[int | None, typer.Option("--beside", hidden=True)] = None,
) -> None:
    """Show a run, a daemon or a recording in a browser; the page controls nothing."""
    if foxglove:
        with _extra("foxglove"):
            from teleop_rt.view.live.foxglove import bridge_to_foxglove  # noqa: PLC0415
        bridge_to_foxglove(recording, host, port)
        return
    with _extra("live"), bar("loading the page", counts=False):
        from teleop_rt.view.live.commands import live as serve  # noqa: PLC0415 - an extra
    serve(recording, beside, host, port)


def live_page_beside(port: int) -> AbstractContextManager[None]:
    """Return the live page of this process's run, served as long as it runs."""
    with _extra("live"):
        from teleop_rt.view.live.commands import live_beside  # noqa: PLC0415 - an extra
    return live_beside(port)


@contextmanager
def _extra(name: str) -> Iterator[None]:
    try:
        yield
    except ImportError:
        message = f"more packages are needed: `{install_command(name)}` adds them"
        raise RecordingError(message) from None
