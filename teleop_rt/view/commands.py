"""The command `report`: the page of a run, or of two runs side by side."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from teleop_rt import __version__
from teleop_rt.errors import RecordingError
from teleop_rt.outputs import DISK_FULL, naming, refuse_existing, refuse_filled, whole_or_nothing
from teleop_rt.trial.folder import plain_json
from teleop_rt.trial.summary_file import read_summary
from teleop_rt.view.export import write_figures
from teleop_rt.view.joined import open_joined
from teleop_rt.view.report import content, write_comparison, write_report
from teleop_rt.view.run_folder import (
    Columns,
    FeltOf,
    Run,
    lacking,
    lacks_ticks,
    load_run,
    read_every_tick,
    read_recorded,
)

_MOST_NAMED = 2  # runs in the name of a comparison's page
Rebuild = Callable[[Path, Columns, Mapping[str, Any] | None], Mapping[str, Any]]
"""(run folder, ticks of the slave, the summary that the run wrote) -> that of its recording."""


def report_of_run(folder: Path, summary: Mapping[str, Any], felt_of: FeltOf) -> Path | None:
    """Write the report of a run that has just ended; None where nothing was recorded."""
    try:
        topics = read_recorded(folder)
    except RecordingError:
        return None
    return write_report(load_run(folder, summary, topics, felt_of))


def report_of_folder(folder: Path, rebuild: Rebuild, felt_of: FeltOf) -> Path:
    """Write the report of a run folder, also of a run that ended badly. Raises RecordingError."""
    with _readable(folder):
        return write_report(_open_run(folder, rebuild, felt_of))


def report_of_sides(folders: Sequence[Path], rebuild: Rebuild) -> Path:
    """Write the report of a slave and a master that ran alone into the slave's folder.

    Raises RecordingError.
    """
    with _readable(folders[0]):
        return write_report(open_joined(folders, rebuild))


def figures_of_folder(folder: Path, out: Path, rebuild: Rebuild, felt_of: FeltOf) -> list[Path]:
    """Write every figure of a run as SVG, PDF and CSV into `out`. Raises RecordingError."""
    refuse_filled(out, "name another folder with --figures")
    with _readable(folder), whole_or_nothing(out), naming(out):
        return write_figures(content(_open_run(folder, rebuild, felt_of))["charts"], out)


def compare_folders(
    folders: Sequence[Path], out: Path | None, rebuild: Rebuild, felt_of: FeltOf
) -> Path:
    """Write a page that sets run folders side by side. Raises RecordingError."""
    page = out or Path(f"compare-{'-'.join(folder.resolve().name for folder in folders)}.html")
    if len(folders) > _MOST_NAMED and out is None:
        page = Path(f"compare-{folders[0].resolve().name}-and-{len(folders) - 1}-more.html")
    refuse_existing([page], "name another page with --out")
    runs = []
    for folder in folders:
        with _readable(folder):
            runs.append(_open_run(folder, rebuild, felt_of))
    with _readable(folders[0]):
        return write_comparison(page, runs)


def _open_run(folder: Path, rebuild: Rebuild, felt_of: FeltOf) -> Run:
    """Return a run folder; a summary that is missing, or of more ticks, is rebuilt.

    A missing part of the recording is reported once. Raises RecordingError.
    """
    summary = read_summary(folder)
    if summary is not None and "side" in summary:
        raise RecordingError(
            f"{folder}: the {summary['side']} ran alone here, and a report needs both sides: give"
            f" the folder of the other one, too; `teleop-rt live {folder}` shows this recording"
        )
    topics = read_recorded(folder)
    if summary is not None and not lacks_ticks(summary, topics["/slave"]):
        return load_run(folder, summary, topics, felt_of)
    rebuilt = plain_json(rebuild(folder, read_every_tick(folder), summary))
    lacks = lacking(rebuilt, summary)
    _say_once(folder, f"{lacks[0].lower()}{lacks[1:]}")
    return replace(load_run(folder, rebuilt, topics, felt_of), lacks=lacks)


@cache
def _say_once(folder: Path, lacks: str) -> None:
    print(f"{folder}: {lacks}", file=sys.stderr)


@contextmanager
def _readable(folder: Path) -> Iterator[None]:
    """Raise RecordingError for a folder of another version, or a page that cannot be written.

    OSError of a full disk, which names the page, is raised as it is: it is a fault.
    """
    try:
        yield
    except OSError as error:
        if error.errno in DISK_FULL:
            raise
        raise RecordingError(
            f"{error.filename}: cannot be written: {error.strerror}"
            ": let this user write there, or copy the folder"
        ) from None
    except (KeyError, TypeError, ValueError) as error:
        written_by = "another version of teleop-rt"
        with suppress(RecordingError, KeyError, TypeError):
            written_by = f"teleop-rt {(read_summary(folder) or {})['software']['version']}"
        raise RecordingError(
            f"{folder}: written by {written_by}, and this is {__version__}, which misses {error}"
            " in it: make its report with the version that wrote it"
        ) from None
