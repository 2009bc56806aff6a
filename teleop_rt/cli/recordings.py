"""The commands that work on recordings: their arguments alone, which a shell completes at once."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from teleop_rt.errors import RecordingError
from teleop_rt.ids import MODEL_IDS, REGRESSIONS, SOLVERS, TERM_IDS

if TYPE_CHECKING:
    from teleop_rt.offline.table import Table
    from teleop_rt.realtime.mcap_chunk import Unreadable

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NEXT_PAIR = re.compile(r",(?=\s*\w+=)")  # a comma may also be part of a column's name
_MOST_RATE_HZ = 1e9  # as rate_hz in NAME.columns.yaml: stamps are whole nanoseconds
BASE_HELP = (
    f"a model: {', '.join(MODEL_IDS)}; or comma-separated terms: {', '.join(TERM_IDS)}. "
    "Whether the contact can pull is found for each; kelvin-voigt-unilateral damps only while the "
    "tool presses"
)

Recordings = Annotated[
    list[Path], typer.Argument(help="MCAP, CSV, MAT, NPZ; run folders; folders and globs of these")
]
Surface = Annotated[
    str, typer.Option(help="auto, or the surface's position, as 10mm; without a unit in m or rad")
]
Columns = Annotated[
    list[str] | None,
    typer.Option(
        "--columns",
        metavar="ROLE=NAME",
        help="column of time, position or force; a minus before its name turns its sign",
    ),
]
UnitsOption = Annotated[
    list[str] | None,
    typer.Option("--units", metavar="ROLE=UNIT", help="unit of a column that does not state it"),
]
Rate = Annotated[
    float | None, typer.Option(help="samples per second, for a table without a time column")
]
EffectsFile = Annotated[Path | None, typer.Option(help="Python file with your own effects")]
Json = Annotated[bool, typer.Option("--json", help="print one line of JSON per recording")]
Jobs = Annotated[int, typer.Option(min=0, help="cores to use; 0 uses as many as shorten the work")]
Scheduler = Annotated[str | None, typer.Option(help="a Dask scheduler, tcp://HOST:PORT")]

Trace = Annotated[Path | None, typer.Option(help="NPZ file for parameters over time")]
Kept = Annotated[
    Path | None, typer.Option(help="folder that keeps the answers; the same command resumes there")
]
Every = Annotated[bool, typer.Option("--all", help="print all estimators; default: the five best")]
Exported = Annotated[
    Path,
    typer.Argument(
        help="file: .csv, .npz, .mat or .parquet; .mcap for --ros2; a folder for --lerobot"
    ),
]
Ros2 = Annotated[
    bool, typer.Option("--ros2", help="write joint states and wrenches of both sides for ROS 2")
]
LeRobot = Annotated[
    bool,
    typer.Option("--lerobot", help="write a LeRobot dataset of a run, or of all runs in a folder"),
]
Task = Annotated[str, typer.Option(help="description of the task, for LeRobot")]


def _some_of(ids: Iterable[str]) -> str:
    return f"comma-separated, from {', '.join(ids)}; default: those of the run, or all"


def replay(
    recordings: Recordings,
    models: Annotated[str | None, typer.Option(help=_some_of(MODEL_IDS))] = None,
    regressions: Annotated[str | None, typer.Option(help=_some_of(REGRESSIONS))] = None,
    solvers: Annotated[str | None, typer.Option(help=_some_of(SOLVERS))] = None,
    surface: Surface = "auto",
    columns: Columns = None,
    units: UnitsOption = None,
    rate: Rate = None,
    trace: Trace = None,
    effects: EffectsFile = None,
    out: Kept = None,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    every: Every = False,
    as_json: Json = False,
) -> None:
    """Run the estimators over recordings."""
    from teleop_rt.batch.bar import bar  # noqa: PLC0415 - as below

    with bar("loading the estimators", counts=False):
        from teleop_rt.batch.workers import Workers  # noqa: PLC0415 - as below
        from teleop_rt.offline import commands  # noqa: PLC0415 - compiles for seconds
        from teleop_rt.offline.replay import Choice  # noqa: PLC0415 - as above

    commands.replay(
        recordings,
        Choice(_names(models), _names(regressions), _names(solvers), _surface(surface)),
        table_of(columns, units, rate),
        Workers(jobs, scheduler),
        trace=trace,
        effects=effects,
        out=out,
        every=every,
        as_json=as_json,
    )


def diagnose(
    recordings: Recordings,
    base: Annotated[str, typer.Option(help=BASE_HELP)] = "kelvin-voigt",
    test: Annotated[
        Path | None, typer.Option(help="recording on which the errors are computed")
    ] = None,
    surface: Surface = "auto",
    effects: EffectsFile = None,
    columns: Columns = None,
    units: UnitsOption = None,
    rate: Rate = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="folder for page, model and proposed trial; one subfolder each for several"
        ),
    ] = None,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    as_json: Json = False,
) -> None:
    """Name the effect that a model lacks, and report the errors without and with it."""
    from teleop_rt.batch.bar import bar  # noqa: PLC0415 - as below

    with bar("loading the effects", counts=False):
        from teleop_rt.batch.workers import Workers  # noqa: PLC0415 - as below
        from teleop_rt.offline import commands  # noqa: PLC0415 - compiles for seconds

    commands.diagnose(
        recordings,
        base,
        _surface(surface),
        table_of(columns, units, rate),
        Workers(jobs, scheduler),
        test=test,
        effects=effects,
        out=out,
        as_json=as_json,
    )


def recover(
    recording: Annotated[Path, typer.Argument(help="a recording that was cut off, or its folder")],
    out: Annotated[
        Path | None, typer.Option(help="file to write; default: NAME.recovered.mcap")
    ] = None,
) -> None:
    """Repair a recording that is cut off or damaged; the original is kept."""
    from teleop_rt.batch.bar import bar  # noqa: PLC0415 - as below

    with bar("reading the recording", counts=False) as shown:
        from teleop_rt.realtime import export  # noqa: PLC0415 - loads numpy and scipy
        from teleop_rt.realtime.reading import in_words  # noqa: PLC0415 - as above
        from teleop_rt.trial.folder import recording_of  # noqa: PLC0415 - as above

        recording = recording_of(recording)
        whole = out or recording.with_suffix(".recovered.mcap")
        messages = export.is_whole(recording)
        shown.phase("writing the readable messages")
        lost: list[Unreadable] = []
        saved = export.recover(recording, whole, lost) if messages is None else 0
        seconds = export.span_s(whole) if saved else 0.0
        to_its_end = export.stated_messages(recording) == saved + sum(one.messages for one in lost)
    if messages is not None:
        print(f"{recording} is whole, with {messages} messages: nothing to recover")
    else:
        left_out = f"; {in_words(lost)}" if lost else ""
        later = "" if to_its_end else "; later messages are lost"
        print(f"{saved} messages, {seconds:.3f} s of the run, saved in {whole}{left_out}{later}")


def export(
    recording: Annotated[Path, typer.Argument(help="an MCAP recording, or a run folder")],
    out: Exported,
    topic: Annotated[str, typer.Option(help="channel to export")] = "/slave",
    ros2: Ros2 = False,
    lerobot: LeRobot = False,
    fps: Annotated[int, typer.Option(min=1, max=4000, help="frames per second for LeRobot")] = 50,
    task: Task = "press on an object",
) -> None:
    """Export one channel of a recording as a table, or the recording for ROS 2 or LeRobot."""
    from teleop_rt.batch.bar import bar  # noqa: PLC0415 - as below

    with bar("exporting", counts=False):
        from teleop_rt.realtime.export import export as export_topic  # noqa: PLC0415 - loads scipy
        from teleop_rt.realtime.lerobot import export_lerobot  # noqa: PLC0415 - as above
        from teleop_rt.realtime.ros2 import export_ros2  # noqa: PLC0415 - as above
        from teleop_rt.trial.folder import recording_of  # noqa: PLC0415 - as above

        if lerobot:
            episodes = _episodes(recording)
            rows = export_lerobot(episodes, out, task, fps)
        else:
            whole = recording_of(recording)
            rows = export_ros2(whole, out) if ros2 else export_topic(whole, out, topic)
    if lerobot:
        print(f"{rows} frames of {len(episodes)} episodes in {out}")
        return
    if ros2:
        print(f"{rows} messages in {out}")
        return
    layout = out.with_name(f"{out.stem}.columns.yaml")
    beside = f", its columns and the force's lag in {layout}" if layout.is_file() else ""
    print(f"{rows} rows of {topic} in {out}{beside}")


def _episodes(path: Path) -> list[Path]:
    """Return the recordings that a path names: one, or those of a folder of runs."""
    from teleop_rt.trial.folder import RECORDING, recording_of  # noqa: PLC0415 - as above

    below = sorted(path.glob(f"*/{RECORDING}")) if path.is_dir() else []
    if below and not (path / RECORDING).exists():
        return [recording_of(one) for one in below]
    return [recording_of(path)]


def table_of(columns: list[str] | None, units: list[str] | None, rate: float | None) -> Table:
    """Return the layout of a foreign file, given by the options. Raises RecordingError."""
    if rate is not None and not 0.0 < rate <= _MOST_RATE_HZ:
        raise RecordingError(f"--rate {rate:g}: give samples per second, above 0 up to 1e9")
    from teleop_rt.offline.table import Table  # noqa: PLC0415 - loads numpy

    return Table(_pairs(columns, "--columns"), _pairs(units, "--units"), rate)


def _pairs(given: list[str] | None, option: str) -> dict[str, str]:
    pairs = {}
    for text in (part for item in given or () for part in _NEXT_PAIR.split(item)):
        role, separator, name = text.partition("=")
        if not separator:
            raise RecordingError(f"{option} {text}: write ROLE=NAME, for example position=xs_rad")
        pairs[role] = name
    return pairs


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",")]


def _surface(text: str) -> float | None:
    """Return the position that the text gives, with a unit or in the rig's own; None for auto."""
    if text == "auto":
        return None
    number = _NUMBER.match(text)
    if number is None:
        raise RecordingError(f"--surface {text}: write auto, or a position such as 0.01 or 10mm")
    unit = text[number.end() :].strip()
    from teleop_rt.recordings.units import factor_of  # noqa: PLC0415 - loads numpy

    try:
        return float(number[0]) * (factor_of("surface", unit) if unit else 1.0)
    except ValueError as error:
        raise RecordingError(f"--surface {text}: {error}") from None
