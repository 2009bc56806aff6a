"""Run many cases of a study on all cores or on a Dask cluster, and take up where it was left."""

from __future__ import annotations

import importlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from teleop_rt import __version__
from teleop_rt.trial.folder import FolderError, plain_json, write_json

Case = dict[str, Any]
Result = dict[str, Any]
Evaluate = Callable[[Case], Result]
Progress = Callable[[int, int], None]
CASES, ABOUT = "cases.jsonl", "study.json"
CONNECT_S = 10.0


class ClusterError(Exception):
    """The Dask cluster cannot be used: says why and what to do next."""


@dataclass(frozen=True, slots=True)
class Workers:
    """Where cases run: on `jobs` cores (0 takes all), or on the Dask cluster at `scheduler`."""

    jobs: int = 0
    scheduler: str | None = None

    @property
    def count(self) -> int:
        """How many cores there are, as far as is known: of a cluster nothing is."""
        return self.jobs or os.cpu_count() or 1

    def run(self, evaluate: Evaluate, cases: Sequence[Case]) -> Iterator[tuple[Case, Result]]:
        """Return each case with its result as it finishes, in any order."""
        if self.scheduler is None:
            yield from self._on_cores(evaluate, cases)
        else:
            yield from _on_cluster(self.scheduler, evaluate, cases)

    def _on_cores(self, evaluate: Evaluate, cases: Sequence[Case]) -> Iterator[tuple[Case, Result]]:
        count = min(self.count, max(len(cases), 1))
        if count == 1:
            yield from ((case, evaluate(case)) for case in cases)
            return
        pool = Parallel(n_jobs=count, return_as="generator_unordered")
        yield from pool(delayed(_with_case)(evaluate, case) for case in cases)


def _with_case(evaluate: Evaluate, case: Case) -> tuple[Case, Result]:
    return case, evaluate(case)


def _on_cluster(
    address: str, evaluate: Evaluate, cases: Sequence[Case]
) -> Iterator[tuple[Case, Result]]:
    """Run cases on a Dask cluster. Raises ClusterError where it cannot be reached."""
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise ClusterError("--scheduler needs Dask: pip install 'teleop-rt[dask]'") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"no Dask scheduler answers at {address}: start one with `dask scheduler` ({error})"
        ) from None
    with client:
        futures = client.map(_with_case, [evaluate] * len(cases), cases, pure=False)
        for future in distributed.as_completed(futures):
            yield future.result()


def key_of(case: Case) -> str:
    """Return the one text that stands for a case."""
    return json.dumps(case, sort_keys=True, allow_nan=False)


def open_folder(folder: Path, study: str) -> Path:
    """Make a study's folder, or take up one of the same study and version.

    Raises FolderError for a folder that holds anything else.
    """
    about = {"study": study, "version": __version__}
    note = folder / ABOUT
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if note.is_file() and json.loads(note.read_text(encoding="utf-8")) == about:
            return folder
        if any(folder.iterdir()):
            raise FolderError(
                f"{folder}: holds something other than `study {study}` of version {__version__}: "
                "name another folder with --out"
            )
    except (OSError, ValueError) as error:
        raise FolderError(f"{folder}: cannot be used: {error}") from None
    write_json(note, about)
    return folder


def finished(path: Path) -> dict[str, Result]:
    """Return the results of finished cases by their key; a last line cut off is left out."""
    found: dict[str, Result] = {}
    if not path.is_file():
        return found
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            told = json.loads(line)
        except ValueError:
            continue
        found[key_of(told["case"])] = told["result"]
    return found


def sweep(
    folder: Path, evaluate: Evaluate, cases: Sequence[Case], workers: Workers, progress: Progress
) -> list[Result]:
    """Run the cases that are missing, and return the results of all in their order.

    A case holds all that its result depends on, the seed included; each that finishes is at once
    a line of cases.jsonl. `progress` gets how many are done, of how many.
    """
    path = folder / CASES
    found = finished(path)
    missing = [case for case in cases if key_of(case) not in found]
    progress(len(cases) - len(missing), len(cases))
    with path.open("a", encoding="utf-8") as file:
        if path.stat().st_size and not path.read_bytes().endswith(b"\n"):
            file.write("\n")
        for case, result in workers.run(evaluate, missing) if missing else ():
            plain = plain_json(result)
            file.write(json.dumps({"case": case, "result": plain}, allow_nan=False) + "\n")
            file.flush()
            found[key_of(case)] = plain
            progress(sum(key_of(one) in found for one in cases), len(cases))
    return [found[key_of(case)] for case in cases]
