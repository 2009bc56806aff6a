"""Peers on measured recordings: the same columns, the same held-out blocks, one table.

    scripts/campaign peers [--only TEXT ...] [--answers FILE] [--json]

Peers are sparse regressions (pysindy, SysIdentPy, SINDy with errors in variables), the greedy fit
of diagnosis/greedy_rival.py and, last, diagnosis. All but the last choose from the greedy fit's
columns, whose position is low-passed without phase. A cell is the error on held-out blocks over the
force's deviation, and a mark: + where the largest term beyond the base represents an effect that is
known to be missing, - where it represents another, 0 where there is none. The columns' surface, if
there is one, was found on all samples. --answers takes rows that `campaign measured --json` kept.
PySR does not take part: it needs a Julia installation, which was not tried.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.recordings.layout import Layout
from teleop_rt.recordings.recording import load
from teleop_rt_dev.campaign.measured import ASIDE, keyed
from teleop_rt_dev.campaign.measured import row as by_us
from teleop_rt_dev.diagnosis.greedy_rival import (
    MOST_ROWS,
    Described,
    described,
    fitted,
    folds,
    sampled,
)
from teleop_rt_dev.diagnosis.peers_venv import answers_of_peers

LEAST_SHARE = 0.02  # of the force's deviation; a term that makes less is none
STANDS_FOR = {
    "sign v": {"coulomb_friction", "hysteresis", "stribeck_friction"},
    "dahl": {"coulomb_friction", "hysteresis"}, "x sign v": {"coulomb_friction", "hysteresis"},
    "forward": {"direction_dependent_damping"}, "v|v|": {"quadratic_damping"},
    "viscous": {"viscous_friction"}, "mass": {"tool_inertia"}, "bias": {"force_bias",
    "gravity_torque"}, "drift": {"force_drift"}, "log drift": {"force_drift"},
    "maxwell": {"stress_relaxation", "fractional_relaxation"}, "x^": {"nonlinear_stiffening"},
    "spring": set(), "x v": set(),
}  # fmt: skip
"""Beginning of a column's name -> effects that it may represent."""


def mark(term: str | None, keys: Sequence[str] | None) -> str:
    """Return the mark of a regression's largest term: whether it represents a known effect."""
    if keys is None:
        return ""
    if term is None:
        return "0"
    start = max((s for s in STANDS_FOR if term.startswith(s)), key=len)
    return "+" if STANDS_FOR[start] & set(keys) else "-"


def columns_of(entry: Mapping[str, Any], data: Path) -> tuple[Described, Any, np.ndarray]:
    """Return columns, motion, and the samples that the regressions get."""
    layout = Layout(entry["columns"], entry["units"], entry.get("rate_hz"))
    r = load(data / entry["file"], layout)
    motion = sampled(r.dt, r.position, r.force, r.mask, entry["cutoff_hz"])
    dictionary = described(motion, entry["base"])
    chosen = np.flatnonzero(dictionary.where)
    return dictionary, motion, chosen[:: max(1, chosen.size // MOST_ROWS)]


def by_regressions(entries: Sequence[Mapping[str, Any]], data: Path) -> list[dict[str, str]]:
    """Return the cells of each recording's row, by peer."""
    rows: list[dict[str, str]] = []
    arrays: dict[str, Any] = {"count": len(entries)}
    names, levels = [], []
    for i, entry in enumerate(entries):
        dictionary, motion, chosen = columns_of(entry, data)
        rival = fitted(motion, entry["base"])
        rows.append({"greedy": cell(rival.error, mark(next(iter(rival.terms), None),
                                                      entry["keys"]))})  # fmt: skip
        theta = np.column_stack([dictionary.columns[name][chosen] for name in dictionary.columns])
        arrays |= {f"theta{i}": theta, f"force{i}": motion.force[chosen],
                   f"fold{i}": folds(motion.force.size)[chosen]}  # fmt: skip
        names.append((list(dictionary.columns), dictionary.base))
        levels.append(float(np.std(motion.force[chosen])))
    for (peer, i), answers in answered(arrays).items():
        left = [a["rms"] for a in answers if a.get("rms") is not None]
        error = (
            None
            if len(left) < len(answers)
            else float(np.sqrt(np.mean(np.square(left)))) / levels[i]
        )
        term = None if error is None else largest(answers, *names[i])
        rows[i][peer] = cell(error, mark(term, entries[i]["keys"]))
    return rows


def answered(arrays: Mapping[str, Any]) -> dict[tuple[str, int], list[dict[str, Any]]]:
    """Return each peer's answers, by peer and record, a fold after the other."""
    found: dict[tuple[str, int], list[dict[str, Any]]] = defaultdict(list)
    for answer in answers_of_peers(arrays):
        found[answer["peer"], answer["record"]].append(answer)
    return found


def largest(
    answers: Sequence[Mapping[str, Any]], names: Sequence[str], base: Sequence[str]
) -> str | None:
    """Return the term beyond the base that makes most of the force, in the mean over the folds."""
    shares = np.mean([np.abs(a["coefficients"]) for a in answers], axis=0)
    beyond = [(share, name) for share, name in zip(shares.tolist(), names, strict=True)
              if name not in base and share > LEAST_SHARE]  # fmt: skip
    return max(beyond)[1] if beyond else None


def by_diagnosis(row: Mapping[str, Any]) -> str:
    """Return the cell of a row of `campaign measured`."""
    sets = [set(names) - {ASIDE} for names in row["class"]]
    if row["keys"] is None:
        return cell(row["after"], "")
    named = bool(sets) and bool(sets[0])
    return cell(row["after"], ("+" if sets[0] <= set(row["keys"]) else "-") if named else "0")


def cell(error: float | None, sign: str) -> str:
    """Return the text of a cell."""
    return "-" if error is None else f"{error:.3g} {sign}".rstrip()


def show(rows: Sequence[Mapping[str, str]], names: Sequence[str]) -> str:
    """Return the table in Markdown; last the median error over diagnosis's, and counts of marks."""
    peers = list(dict.fromkeys(peer for row in rows for peer in row))
    lines = [f"| recording | {' | '.join(peers)} |", "| --- " * (len(peers) + 1) + "|"]
    lines += [f"| {name} | {' | '.join(row.get(peer, '-') for peer in peers)} |"
              for name, row in zip(names, rows, strict=True)]  # fmt: skip
    ours = [error_in(row["diagnosis"]) for row in rows]
    ratios, marks = [], []
    for peer in peers:
        theirs = [error_in(row.get(peer, "-")) for row in rows]
        both = [t / o for t, o in zip(theirs, ours, strict=True) if t is not None and o]
        ratios.append(f"{np.median(both):.2f} of {len(both)}" if both else "-")
        signs = [row.get(peer, "-")[-1] for row in rows if error_in(row.get(peer, "-")) is not None]
        marks.append(" ".join(f"{signs.count(sign)}{sign}" for sign in "+-0"))
    lines += [f"| median error over diagnosis's | {' | '.join(ratios)} |",
              f"| names: known, others, none | {' | '.join(marks)} |"]  # fmt: skip
    return "\n".join(lines)


def error_in(text: str) -> float | None:
    """Return the error in a cell."""
    return None if text == "-" else float(text.split(maxsplit=1)[0])


def main(arguments: list[str]) -> int:
    """Run the campaign; exits with 2 where there are no recordings."""
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign peers", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--only", nargs="*", default=[], help="texts, one in each file's name")
    parser.add_argument("--answers", type=Path, help="the output of `campaign measured --json`")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    data = os.environ.get("TELEOP_RT_DATA")
    if not data:
        print("campaign peers: set TELEOP_RT_DATA to the folder of recordings", file=sys.stderr)
        return 2
    entries = keyed(chosen.only)
    rows = by_regressions(entries, Path(data))
    known: dict[str, Any] = {}
    if chosen.answers:
        answers = json.loads(chosen.answers.read_text(encoding="utf-8"))
        known = {r["name"]: r for r in answers["records"]}
    for entry, row in zip(entries, rows, strict=True):
        row["diagnosis"] = by_diagnosis(known.get(entry["name"]) or by_us(entry, Path(data)))
    names = [entry["name"] for entry in entries]
    print(json.dumps(dict(zip(names, rows, strict=True))) if chosen.json else show(rows, names))
    return 0
