"""One answer for each of many recordings: on all cores, past bad files, and resumed."""

from __future__ import annotations

import json
import math
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import typer
from rich.console import Console

from teleop_rt.batch.bar import Bar, bar
from teleop_rt.batch.sweep import CASES, in_order, open_folder
from teleop_rt.batch.workers import Case, Result, Workers
from teleop_rt.diagnosis.phases import heard_by
from teleop_rt.errors import BAD_INPUT, FAULT, ExpectedError
from teleop_rt.interrupts import INTERRUPTED
from teleop_rt.offline.find import digest_of, find, names_one, own_names
from teleop_rt.offline.work import UnwrittenError
from teleop_rt.outputs import refuse_filled, refuse_unwritable, write_whole
from teleop_rt.view.console import output

ANSWERS = "answers.jsonl"
Show = Callable[[Console, dict[str, Any]], None]

WORKER_START_S = 0.3
"""Time for a forked process to load the compiled kernels that its parent has not used."""
_MOST_NAMED = 10
"""Files that the last line names; the others are counted."""
_SILENT_S = 5.0
"""Work that usually takes longer names its phases where no terminal shows a bar."""


class Work(Protocol):
    """The work on each recording; it must pickle, because workers are other processes."""

    @property
    def command(self) -> str:
        """Name of the command."""

    @property
    def fills_folder(self) -> bool:
        """Whether the folder `out` is the output of a single recording."""

    @property
    def seconds_each(self) -> float:
        """Time for a usual recording [s]: it decides whether more processes pay for their start."""

    def options(self) -> dict[str, Any]:
        """Return all that an answer depends on beside the recording, JSON-ready."""

    def answer(self, recording: Path, name: str) -> dict[str, Any]:
        """Return the answer; `name` is in the name of each file written."""

    def written(self, name: str) -> bool:
        """Return whether the output of a recording is still there."""


@dataclass(frozen=True, slots=True)
class _Each:
    """A case's answer, or its problem, with the exit code that it asks for."""

    work: Work
    folder: Path

    def __call__(self, case: Case) -> Result:
        given = case["recording"]
        try:
            with chdir(self.folder):  # a worker may have been started elsewhere
                return {"code": 0, "answer": self.work.answer(Path(given), case["name"])}
        except UnwrittenError as error:
            return {"code": FAULT, "answer": {**error.answer, "problem": str(error)}}
        except (ExpectedError, ValueError) as error:
            problem, name = str(error), f"{Path(given).name}: "
            if problem.startswith(name):  # of many files one name may lie in several folders
                problem = f"{given}: {problem.removeprefix(name)}"
            return {"code": BAD_INPUT, "answer": {"recording": given, "problem": problem}}
        except OSError as error:
            problem = f"{error.filename or given}: cannot be read or written: {error.strerror}"
            return {"code": BAD_INPUT, "answer": {"recording": given, "problem": problem}}
        except Exception as error:  # noqa: BLE001 - one recording must not end the work on all
            place = traceback.extract_tb(error.__traceback__)[-1]
            problem = f"{given}: unexpected {type(error).__name__}: {error}"
            problem += f" ({Path(place.filename).name}, line {place.lineno}); please report it"
            return {"code": FAULT, "answer": {"recording": given, "problem": problem}}


def each(
    work: Work,
    given: Sequence[Path],
    workers: Workers,
    out: Path | None,
    show: Show,
    *,
    as_json: bool,
) -> None:
    """Print the answer for each recording in order; a bad one is reported and the others done.

    With `out` each answer is kept at once, and a finished one is not computed again.
    Leaves with code 2 where a recording could not be used, 1 after a fault.
    """
    recordings = find(given)
    keep = _opened(work, out, one=names_one(given))
    cases = _cases(work, recordings, digests=keep is not None)
    if not workers.jobs and workers.scheduler is None:
        worth = math.ceil(len(cases) * work.seconds_each / WORKER_START_S)
        workers = replace(workers, jobs=min(workers.count, worth))
    bad: dict[str, int] = {}
    results: list[dict[str, Any]] = []
    alone = len(cases) == 1
    lines = alone and work.seconds_each > _SILENT_S
    with (
        _ends_with_words(results, len(cases), keep),
        bar(work.command, counts=not alone, lines=lines) as shown,
        heard_by(shown.phase),
    ):
        for result in _results(work, cases, workers, keep, shown):
            results.append(result["answer"])
            if result["code"]:
                bad[result["answer"]["recording"]] = result["code"]
            with shown.aside():
                _print(result, show, as_json=as_json)
    if keep is not None:
        _write_answers(keep / ANSWERS, results)
    if out is not None and not as_json and len(bad) < len(results):
        print(f"files in {out}")
    if bad:
        _report_bad([one["recording"] for one in results if not _is_answered(one)], len(cases))
        raise typer.Exit(FAULT if FAULT in bad.values() else BAD_INPUT)


@contextmanager
def _ends_with_words(results: Sequence[object], count: int, keep: Path | None) -> Iterator[None]:
    """Report an interrupt: how far the work came, and how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        done = "" if count == 1 else f" after {len(results)} of {count} recordings"
        next_step = "" if count == 1 else "; with --out finished answers are kept"
        if keep is not None:
            next_step = f"; {keep} keeps the answers so far, and the same command goes on"
        print(f"interrupted{done}{next_step}", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None


def _opened(work: Work, out: Path | None, *, one: bool) -> Path | None:
    """Return the folder that keeps the answers; None where it is that of one recording alone."""
    if out is None:
        return None
    if one and work.fills_folder:
        refuse_filled(out)
        refuse_unwritable(out)
        return None
    return open_folder(out, work.command, work.options())


def _cases(work: Work, recordings: Sequence[Path], *, digests: bool) -> list[Case]:
    names, options = own_names(recordings), work.options()
    return [
        {"recording": str(path), "name": names[path], "options": options}
        | ({"digest": digest_of(path)} if digests else {})
        for path in recordings
    ]


def _results(
    work: Work, cases: list[Case], workers: Workers, keep: Path | None, shown: Bar
) -> Iterator[Result]:
    def lasts(case: Case, result: Result) -> bool:
        return result["code"] == 0 and work.written(case["name"])

    path = None if keep is None else keep / CASES
    return in_order(path, _Each(work, Path.cwd()), cases, workers, shown, lasts)


def _print(result: Result, show: Show, *, as_json: bool) -> None:
    answer = result["answer"]
    if as_json:
        print(json.dumps(answer), flush=True)
    elif _is_answered(answer):
        show(output(), answer)
    if result["code"]:
        print(answer["problem"], file=sys.stderr)


def _is_answered(answer: Mapping[str, Any]) -> bool:
    """Return whether there is an answer, even one whose files could not be written."""
    return not answer.keys() <= {"recording", "problem"}


def _write_answers(path: Path, answers: Sequence[Mapping[str, Any]]) -> None:
    """Write all answers in the order of the recordings: the very lines of `--json`."""
    lines = (json.dumps(answer) + "\n" for answer in answers)
    write_whole(path, "".join(lines))


def _report_bad(bad: Sequence[str], count: int) -> None:
    if count == 1 or not bad:
        return
    named = ", ".join(bad[:_MOST_NAMED])
    more = "" if len(bad) <= _MOST_NAMED else f" and {len(bad) - _MOST_NAMED} more"
    print(f"{len(bad)} of {count} recordings have no answer: {named}{more}", file=sys.stderr)
