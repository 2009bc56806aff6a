"""The folder that a run writes: trial.yaml, recording.mcap, summary.json, log.jsonl."""

from __future__ import annotations

import json
import math
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import yaml

from teleop_rt.config.loader import dump
from teleop_rt.config.trial import TrialConfig
from teleop_rt.errors import BAD_INPUT, RecordingError
from teleop_rt.outputs import refuse_filled, unwritable, write_whole
from teleop_rt.realtime.parts import parts
from teleop_rt.realtime.reading import read_metadata, read_topics
from teleop_rt.realtime.recording import BEGAN_AT, RUN

RECORDING = "recording.mcap"
TRIAL = "trial.yaml"
SUMMARY = "summary.json"
TRUTH = "truth.json"
LOG = "log.jsonl"
_WANTED = "give a recording, or a folder that a run has written"


def recording_of(path: Path) -> Path:
    """Return the recording that a path names, a file or the run folder it lies in.

    Raises RecordingError where there is none that can be read, or one without a byte.
    """
    if path.is_dir():
        recording = path / RECORDING
        if not parts(recording):
            raise RecordingError(
                f"{path}: a folder without {RECORDING}: {_WANTED}; if a run has just begun,"
                " wait a second"
            )
    else:
        recording = path
        if not (path.is_file() or parts(path)):
            what = "not a regular file" if path.exists() else "no such file"
            raise RecordingError(f"{path}: {what}: {_WANTED}")
    _refuse_unreadable(recording)
    return recording


def _refuse_unreadable(recording: Path) -> None:
    try:
        empty = True
        for part in parts(recording) or [recording]:
            if part.exists() and not part.is_file():  # a pipe would be waited for
                raise RecordingError(f"{part}: not a regular file: {_WANTED}")
            with part.open("rb") as stream:
                empty = empty and not stream.read(1)
    except OSError as error:
        raise RecordingError(
            f"{recording}: cannot be read: {error.strerror}: let this user read it (`chmod u+r`),"
            " or copy it"
        ) from None
    if empty:
        why = (
            "as after a run that ended at once" if recording.suffix == ".mcap" else "it has no rows"
        )
        raise RecordingError(f"{recording}: is empty, {why}: give another one")


def began_at(folder: Path) -> str | None:
    """Return when the run of a folder began: date, time and zone (ISO 8601), None where unknown.

    As the recording says: a copied file may have the time of the copy. A recording on the simulated
    clock says nothing; the trial is written right before a run begins, and else the recording's own
    time stands.
    """
    with suppress(RecordingError):
        if parts(folder / RECORDING):
            recorded = (read_metadata(folder / RECORDING, RUN) or {}).get(BEGAN_AT)
            if recorded is not None:
                return recorded
    for name in (TRIAL, RECORDING):
        if (folder / name).is_file():
            return date_of((folder / name).stat().st_mtime)
    return None


def date_of(epoch_s: float | None = None) -> str:
    """Return date, time and zone (ISO 8601) of a time [s since the epoch], by default now."""
    when = datetime.now() if epoch_s is None else datetime.fromtimestamp(epoch_s)
    return when.astimezone().isoformat(timespec="seconds")


@contextmanager
def new_folder(out: Path | None, trial_name: str) -> Iterator[Path]:
    """Give the run folder, and take it away again where the run could not even begin.

    It stays where something was recorded, and after any error that is not the input's.
    Raises OutputError where it is not empty, or nothing can be written into it.
    """
    folder, there_before = _free(out, trial_name)
    try:
        _make(folder)
        yield folder
    except BaseException as error:
        fault = isinstance(error, Exception) and getattr(error, "code", BAD_INPUT) != BAD_INPUT
        if not fault and not _recorded_anything(folder):
            shutil.rmtree(folder, ignore_errors=True)
            if there_before:
                folder.mkdir(exist_ok=True)
        raise


@contextmanager
def folder_if_filled(out: Path | None, trial_name: str) -> Iterator[Path]:
    """Give a folder for several runs, and take it away again where nothing was written into it.

    Raises OutputError where it is not empty, or nothing can be written into it.
    """
    folder, there_before = _free(out, trial_name)
    try:
        _make(folder)
        yield folder
    finally:
        if not there_before and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def _free(out: Path | None, trial_name: str) -> tuple[Path, bool]:
    """Return a folder that may be written, by default runs/<trial>-<time>; whether it is there."""
    folder = out or Path("runs") / f"{trial_name}-{time.strftime('%Y%m%d-%H%M%S')}"
    attempt = folder
    number = 1
    while out is None and attempt.exists():
        number += 1
        attempt = folder.with_name(f"{folder.name}-{number}")
    refuse_filled(attempt)
    return attempt, attempt.exists()


def _make(folder: Path) -> None:
    """Make a folder; called where an interrupt, which may come at once, takes it away again."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()  # it may have been there on a read-only disk
    except OSError as error:
        raise unwritable(folder, error) from None


def _recorded_anything(folder: Path) -> bool:
    recording = folder / RECORDING
    return bool(parts(recording)) and bool(read_topics(recording, ["/slave"]))


def write_trial(folder: Path, trial: TrialConfig) -> Path:
    """Write the trial as run, every default filled in, without the secrets of the plant."""
    plain = dump(trial, trial.rig.units)
    if isinstance(plain.get("plant"), dict):
        plain["plant"].pop("undeclared", None)
    path = folder / TRIAL
    path.write_text(yaml.safe_dump(plain, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return path


def write_json(path: Path, content: Any) -> None:
    """Write JSON with null in place of NaN: whole, or, on a full disk, not at all."""
    write_whole(path, json.dumps(plain_json(content), indent=2) + "\n")


def plain_json(content: Any) -> Any:
    """Return content with every number that is not finite replaced by None."""
    if isinstance(content, dict):
        return {key: plain_json(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [plain_json(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
