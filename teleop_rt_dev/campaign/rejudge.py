"""Judging again from stored candidates: the answer with another level or one gate less.

    scripts/campaign rejudge FOLDER --keep [--records N] [--seed S] [--groups G ...]
        [--measured TEXT ...]
    scripts/campaign rejudge FOLDER [--set NAME=VALUE ...] [--without GATE ...]

With --keep each record of `campaign ablate` is diagnosed once, and one file per record in FOLDER
keeps the data of its judgements: the ranked candidates, and the sets with their energies.
A record that is there already is not diagnosed again. Without --keep the stored candidates are
judged again, in milliseconds a record, with levels of `criteria` set to other values or with gates
left out, and each judgement that differs is printed with the truth.

A judgement that decides on the next search cannot be followed: the candidates are those that
were found. Gates that act before the judgement change nothing here; `campaign ablate` tries them.
"""

from __future__ import annotations

import argparse
import copyreg
import dataclasses
import io
import pickle
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.diagnosis import criteria
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt_dev.campaign.ablate import GATES, JUDGEMENTS, Case, answered, cases
from teleop_rt_dev.diagnosis.replaced import Call, always, instead, kept, modules

Judged = tuple[str, list[list[str]]]  # verdict, and the sets, best first


def _bare(fit: Fit) -> tuple[type[Fit], tuple[Any, ...]]:
    """Return how to make a fit again, without its columns: a judgement reads none."""
    columns = np.zeros((len(fit.columns), 0))
    return Fit, (fit.model, fit.zeta, fit.theta, fit.residual, columns, fit.effective)


def _uncached(value: Problem | RecordedMotion) -> tuple[type, tuple[Any, ...]]:
    """Return how to make a problem or a motion again, without its cached values."""
    given = (field.name for field in dataclasses.fields(value) if field.init)
    return type(value), tuple(getattr(value, name) for name in given)


def keep(case: Case) -> bytes:
    """Diagnose a record; return, pickled, its case, its answer, and its judgements' arguments."""
    calls: list[Call] = []
    with ExitStack() as stack:
        for judgement in JUDGEMENTS:
            stack.enter_context(instead(judgement, kept(calls)))
        answer, right = answered(case)
    made = [(function.__module__, function.__name__, arguments, keys)
            for function, arguments, keys in calls]  # fmt: skip
    file = io.BytesIO()
    pickler = pickle.Pickler(file, pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = {
        **copyreg.dispatch_table, Fit: _bare, Problem: _uncached, RecordedMotion: _uncached,
    }  # fmt: skip
    pickler.dump({"case": case, "answer": answer, "right": right, "calls": made})
    return file.getvalue()


def name_of(case: Case) -> str:
    """Return the name of the file that keeps a record."""
    kind, what = case
    if kind == "measured":
        return str(what["name"]).replace("/", "_")
    return "-".join(str(what[key]) for key in ("group", "generator", "surface", "seed"))


def truth(case: Case) -> str:
    """Return the effects that are at work, as text."""
    kind, what = case
    return "+".join(what["keys"] if kind == "measured" else what["effects"]) or "nothing"


def judged(record: dict[str, Any]) -> list[Judged]:
    """Return the judgements of a stored record, with levels and gates as they are now."""
    found = []
    for module, name, arguments, keys in record["calls"]:
        function = next(getattr(m, name) for m in modules() if m.__name__ == module)
        result = function(*arguments, **keys)
        found.append((result.verdict, [sorted(s.fit.names) for s in result.sets]))
    return found


@contextmanager
def changed(levels: Sequence[str], gates: Sequence[str]) -> Iterator[None]:
    """Set levels (NAME=VALUE) wherever they are imported and leave gates out; then undo both."""
    with ExitStack() as stack:
        for gate in gates:
            path, without = GATES[gate]
            stack.enter_context(instead(path, always(without)))
        for level in levels:
            name, _, value = level.partition("=")
            for module in (m for m in modules() if hasattr(m, name)):
                stack.callback(setattr, module, name, getattr(module, name))
                setattr(module, name, float(value))
        yield


def compare(folder: Path, levels: Sequence[str], gates: Sequence[str]) -> list[str]:
    """Return the lines to print: each judgement that differs, then the counts by group."""
    lines, counts = [], Counter[tuple[str, str]]()
    for file in sorted(folder.glob("*.pickle")):
        record = pickle.loads(file.read_bytes())
        kind, what = record["case"]
        group = kind if kind == "measured" else f"{what['group']} {what['generator']}"
        before = judged(record)
        with changed(levels, gates):
            after = judged(record)
        counts[group, "records"] += 1
        counts[group, "right"] += record["right"]
        counts[group, "changed"] += before != after
        lines += [f"{file.stem}: {truth(record['case'])}: {old} -> {new}"
                  for old, new in zip(before, after, strict=True) if old != new]  # fmt: skip
    groups = sorted({group for group, _ in counts})
    return lines + [
        f"{group}: {counts[group, 'records']} records, {counts[group, 'right']} answered rightly,"
        f" {counts[group, 'changed']} judged otherwise"
        for group in groups
    ]


def main(arguments: list[str]) -> int:
    """Run the campaign; exits with 2 if a level or a gate is unknown."""
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign rejudge", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("folder", type=Path)
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--records", type=int, default=6, help="of each group")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--groups", nargs="*", default=[])
    parser.add_argument("--measured", nargs="*", default=[], metavar="TEXT")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE")
    parser.add_argument("--without", nargs="*", default=[], choices=list(GATES), metavar="GATE")
    chosen = parser.parse_args(arguments)
    levels = [level.partition("=")[0] for level in chosen.set]
    if unknown := [name for name in levels if not hasattr(criteria, name)]:
        parser.error(f"unknown level {', '.join(unknown)}")
    if not chosen.keep:
        print("\n".join(compare(chosen.folder, chosen.set, chosen.without)))
        return 0
    chosen.folder.mkdir(parents=True, exist_ok=True)
    for case in cases(chosen.records, chosen.seed, chosen.groups, chosen.measured):
        file = chosen.folder / f"{name_of(case)}.pickle"
        if not file.exists():
            file.write_bytes(keep(case))
            print(file.name, flush=True)
    return 0
