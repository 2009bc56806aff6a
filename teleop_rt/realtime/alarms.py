"""Problems of a recording or a helper, as status, summary and report word them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def of_recorder(recorder: Mapping[str, Any]) -> Iterator[str]:
    """Yield the recorder's alarms that a reader of its figures must know."""
    lost = sum((recorder["dropped"] or {}).values())
    if lost:
        yield f"{lost} rows were not recorded: figures are of the rest"
    if recorder.get("alarm"):
        yield recorder["alarm"]
    yield from of_helper("recorder", recorder)


def of_helper(name: str, helper: Mapping[str, Any]) -> Iterator[str]:
    """Yield a note if a process beside the loop had to be started again."""
    restarts = helper.get("restarts", 0)
    if restarts:
        times = "once" if restarts == 1 else f"{restarts} times"
        yield f"the {name} ended unexpectedly {times} and was started again: see log.jsonl"
