"""Where many cases run: in this process, on the cores of this machine, or on a Dask cluster."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from teleop_rt.batch.forked import WorkerLostError, as_finished
from teleop_rt.errors import ExpectedError
from teleop_rt.extras import install_command

Case = dict[str, Any]
Result = dict[str, Any]
Evaluate = Callable[[Case], Result]
CONNECT_S = 10.0
"""Longest wait for a scheduler at the address given."""


class ClusterError(ExpectedError):
    """The Dask cluster cannot be used; the message gives cause and next step."""


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
        """Return each case with its result as it finishes, in any order.

        Raises ClusterError where the cluster cannot be reached, WorkerLostError where a worker
        ends before its case.
        """
        if self.scheduler is None:
            for index, result in as_finished(evaluate, cases, self.count):
                yield cases[index], result
        else:
            yield from _on_cluster(self.scheduler, evaluate, cases)


def _with_case(evaluate: Evaluate, case: Case) -> tuple[Case, Result]:
    return case, evaluate(case)


def _on_cluster(
    address: str, evaluate: Evaluate, cases: Sequence[Case]
) -> Iterator[tuple[Case, Result]]:
    """Run cases on a Dask cluster."""
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise ClusterError(f"--scheduler needs Dask: `{install_command('dask')}`") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"--scheduler: no Dask scheduler answers at {address}: start one with `dask scheduler`"
            f" ({error})"
        ) from None
    with client:
        futures = client.map(_with_case, [evaluate] * len(cases), cases, pure=False)
        try:
            for future in distributed.as_completed(futures):
                yield future.result()
        except distributed.KilledWorker as error:
            raise WorkerLostError(error) from None
