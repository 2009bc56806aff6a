"""Campaign on measured recordings: the answer against the known one, the error against a rival.

    scripts/campaign measured [--only TEXT ...] [--jobs J] [--json]

Recordings lie below the folder that TELEOP_RT_DATA names; diagnosis/measured_keys.yaml names their
columns and the effects known to be missing. The rival is a greedy least-squares fit
(diagnosis/greedy_rival.py). Errors are those of held-out blocks over the force's deviation.

right     the top set holds known effects and no other, its class has at most three sets, and the
          error falls by a tenth
wrong     a named, partly named or class answer whose top set holds an effect that is not known to
          be missing, with no set of known effects in the class
honest    no name, where the rival too leaves more than half of the base's error
          (samples that stand alone, `outliers`, count on neither side)
useless   anything else: no name where the rival halves the error, or a name that helps nobody
unkeyed   nobody has published an answer; the errors alone are shown
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.layout import Layout
from teleop_rt.recordings.recording import Recording, load
from teleop_rt_dev.diagnosis.greedy_rival import fitted, sampled
from teleop_rt_dev.diagnosis.table import interval
from teleop_rt_dev.parallel import in_order
from teleop_rt_dev.paths import ROOT

KEYS = ROOT / "teleop_rt_dev" / "diagnosis" / "measured_keys.yaml"
LARGEST_CLASS = 3
"""Candidates of an answer; one that lists more is of no use, though the right one is first."""
LOWERED = 0.9  # of the base's error: an answer that leaves more than this helps nobody
HALVED = 0.5  # of the base's error: where the rival gets below, silence is of no use
REFUSED_RATIO = 2.0  # an answer without an error counts as twice the rival's
NAMING = ("named", "class", "partial")
ASIDE = "outliers"  # single samples of a channel, of which no published answer says anything


def keyed(only: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return the entries of the key file whose name holds one of the texts."""
    entries = yaml.safe_load(KEYS.read_text(encoding="utf-8"))["recordings"]
    named = [{"name": entry["file"], **entry} for entry in entries]
    return [e for e in named if not only or any(text in e["name"] for text in only)]


def worth(answer: Mapping[str, Any], keys: Sequence[str] | None, halved: bool) -> str:
    """Return the judgement of an answer; `halved`: the rival leaves half of the base's error."""
    if keys is None:
        return "unkeyed"
    silent = "useless" if halved else "honest"
    if answer["verdict"] not in NAMING:
        return silent
    listed = answer["class"] or [[effect["name"] for effect in answer["effects"]]]
    sets = [set(names) - {ASIDE} for names in listed]
    known = [bool(names) and names <= set(keys) for names in sets]
    if not any(sets):
        return silent
    if not any(known):
        return "wrong"
    before, after = answer["before"], answer["after"]
    lowered = None not in (before, after) and after <= LOWERED * before
    return "right" if known[0] and lowered and len(sets) <= LARGEST_CLASS else "useless"


def row(entry: Mapping[str, Any], data: Path) -> dict[str, Any]:
    """Return the table's row of one recording."""
    layout = Layout(entry["columns"], entry["units"], entry.get("rate_hz"))
    found: dict[str, Any] = {"name": entry["name"], "base": entry["base"], "keys": entry["keys"]}
    try:
        recording = load(data / entry["file"], layout)
    except RecordingError as error:
        return {**found, **refused(str(error)), "worth": "useless", "rival": None, "ratio": None}
    rival = fitted(
        sampled(recording.dt, recording.position, recording.force, recording.mask,
                entry["cutoff_hz"]),
        entry["base"],
    )  # fmt: skip
    answer = answered(recording, entry["base"])
    after = answer["after"]
    ratio = REFUSED_RATIO if after is None else after / rival.error
    halved = rival.error <= HALVED * rival.base_error
    return {
        **found, **answer, "worth": worth(answer, entry["keys"], halved),
        "rival": {"before": rival.base_error, "after": rival.error, "terms": rival.terms},
        "ratio": ratio,
    }  # fmt: skip


def answered(recording: Recording, base: str) -> dict[str, Any]:
    """Return verdict, sets and held-out errors of a diagnosis, or that it was refused."""
    begun = time.process_time()
    try:
        answer = diagnose(recording, base).answer
    except RecordingError as error:
        return refused(str(error))
    given = {key: answer[key] for key in ("verdict", "class", "effects", "family")}
    scores = answer["error"]["std_normalised"]
    return {
        **given, "before": scores["before"], "after": scores["after"],
        "seconds": time.process_time() - begun,
    }  # fmt: skip


def refused(why: str) -> dict[str, Any]:
    """Return the answer of a recording that diagnosis refuses."""
    return {
        "verdict": "refused", "class": [], "effects": [], "family": None, "before": None,
        "after": None, "problem": why, "seconds": 0.0,
    }  # fmt: skip


def table(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the counts with their 95 % bounds, and the ratio to the rival's error."""
    counts = Counter(r["worth"] for r in rows)
    judged = len(rows) - counts["unkeyed"]
    ratios = [r["ratio"] for r in rows if r["ratio"] is not None]
    return {
        "counts": {
            name: {"hits": counts[name], "of": judged,
                   "bounds": interval(counts[name], judged) if judged else None}
            for name in ("right", "wrong", "honest", "useless")
        },
        "unkeyed": counts["unkeyed"],
        "ratio": {
            "median": float(np.median(ratios)) if ratios else None,
            "90 %": float(np.quantile(ratios, 0.9)) if ratios else None,
            "of": len(ratios),
        },
    }  # fmt: skip


def show(rows: Sequence[Mapping[str, Any]], found: Mapping[str, Any]) -> str:
    """Return the table as text."""
    head = (
        f"{'recording':38} {'worth':8} {'verdict':18} {'error':17} {'rival':17} {'ratio':6} named"
    )
    lines = [head, *(_line(r) for r in rows), ""]
    for name, count in found["counts"].items():
        bounds = "" if count["bounds"] is None else "  [{:.0f}, {:.0f}] %".format(
            *(100.0 * b for b in count["bounds"]))  # fmt: skip
        lines.append(f"{name:8} {count['hits']} of {count['of']}{bounds}")
    ratio = found["ratio"]
    lines.append(
        f"error over the rival's, {ratio['of']} recordings: median {_figure(ratio['median'])},"
        f" 90 % {_figure(ratio['90 %'])}"
    )
    return "\n".join(lines)


def _line(r: Mapping[str, Any]) -> str:
    sets = r["class"] or [[effect["name"] for effect in r["effects"]]]
    named = " | ".join("+".join(names) for names in sets) or r.get("problem", "")
    rival = (None, None) if r["rival"] is None else (r["rival"]["before"], r["rival"]["after"])
    return (
        f"{r['name']:38} {r['worth']:8} {r['verdict']:18} {_pair(r['before'], r['after']):17}"
        f" {_pair(*rival):17} {_figure(r['ratio']):6} {named}"
    )


def _pair(before: float | None, after: float | None) -> str:
    return f"{_figure(before)} -> {_figure(after)}"


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def main(arguments: list[str]) -> int:
    """Run the campaign; exits with 2 where there are no recordings."""
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign measured", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--only", nargs="*", default=[], help="texts, one in each file's name")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    data = os.environ.get("TELEOP_RT_DATA")
    if not data:
        print("campaign measured: set TELEOP_RT_DATA to the folder of recordings", file=sys.stderr)
        return 2
    calls = (partial(row, e, Path(data)) for e in keyed(chosen.only))
    rows = in_order("campaign measured", calls, chosen.jobs)
    found = table(rows)
    print(json.dumps({"table": found, "records": rows}) if chosen.json else show(rows, found))
    return 0
