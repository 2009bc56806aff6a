"""Campaign on folders of recordings with known answers, as an engineer elsewhere writes them.

    scripts/campaign keyed FOLDER... [--only TEXT ...] [--jobs J] [--json]

A folder holds `key.csv` with the columns name, group, base, truth and, if known, tied; each
recording is NAME.csv with the columns t [s], x [m] and f [N]. `truth` is a set of effects joined by
`+`, `none`, or `outside:` with some words; `tied` are other sets, joined by `|`, which fit as well.

right     the named set, or one of the class, is the truth or tied to it; nothing where nothing is
          missing; "unexplained" or "partial" for effects outside the library
honest    "unexplained", "nothing missing", or effects of the truth alone, without all of them
wrong     any other answer: a name that is not there

Printed beside these are `first`, right answers of which the best set is the truth or tied to it,
and `some`, answers whose best set holds an effect of the truth and no other; then how often effects
of each stated probability are at work.
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Literal

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.errors import ExpectedError
from teleop_rt.recordings.layout import Layout
from teleop_rt.recordings.recording import load
from teleop_rt_dev.diagnosis.table import reliability_lines
from teleop_rt_dev.parallel import in_order

Worth = Literal["right", "honest", "wrong"]
_OUTSIDE = "outside:"


def entries(folder: Path, only: Sequence[str] = ()) -> list[dict[str, str]]:
    """Return the rows of a folder's key, with the folder, of names that hold one of `only`."""
    with (folder / "key.csv").open(encoding="utf-8", newline="") as key:
        rows = [row | {"folder": str(folder)} for row in csv.DictReader(key)]
    return [row for row in rows if not only or any(text in row["name"] for text in only)]


def answered(entry: Mapping[str, str]) -> dict[str, Any]:
    """Return verdict, class and probabilities of a recording; the verdict "error" if refused."""
    file = Path(entry["folder"]) / f"{entry['name']}.csv"
    try:
        recording = load(file, Layout({"time": "t", "position": "x", "force": "f"}, {}))
        answer = diagnose(recording, entry["base"]).answer
    except (ExpectedError, ValueError):
        return {"verdict": "error", "class": [], "probability": {}}
    return {key: answer[key] for key in ("verdict", "class", "probability")}


def worth(entry: Mapping[str, str], verdict: str, sets: Sequence[Sequence[str]]) -> Worth:
    """Return the grade of an answer by the key."""
    named = [set(names) for names in sets] if verdict in {"named", "class", "partial"} else []
    if entry["truth"] == "none":
        if named:
            return "wrong"
        return "right" if verdict == "no_missing_effect" else "honest"
    if entry["truth"].startswith(_OUTSIDE):
        if verdict in {"named", "class"}:
            return "wrong"
        return "right" if verdict in {"unexplained", "partial"} else "honest"
    true = true_sets(entry)
    if verdict != "partial" and any(names in true for names in named):
        return "right"
    return "honest" if all(_of_one(names, true) for names in named) else "wrong"


def true_sets(entry: Mapping[str, str]) -> list[set[str]]:
    """Return the sets of effects that are right by the key: the truth, and those tied to it."""
    if entry["truth"] == "none" or entry["truth"].startswith(_OUTSIDE):
        return []
    sets = [entry["truth"], *(entry.get("tied") or "").split("|")]
    return [set(names.split("+")) for names in sets if names]


def _of_one(names: set[str], sets: Sequence[set[str]]) -> bool:
    """Return whether all names are in one of the sets."""
    return any(names <= one for one in sets)


def row(entry: Mapping[str, str]) -> dict[str, Any]:
    """Return a recording's answer, its grade, and the processor time [s].

    `effects` are those that may be at work by the key, for the reliability of probabilities.
    """
    begun = time.process_time()
    answer = answered(entry)
    seconds = round(time.process_time() - begun, 2)
    true, worth_of_it = true_sets(entry), worth(entry, answer["verdict"], answer["class"])
    best = set(answer["class"][0]) if answer["class"] else set()
    return dict(entry) | answer | {
        "worth": worth_of_it, "seconds": seconds, "effects": sorted(set().union(*true)),
        "first": worth_of_it == "right" and (not true or best in true),
        "some": bool(best) and _of_one(best, true),
    }  # fmt: skip


def show(rows: list[dict[str, Any]]) -> str:
    """Return the counts of each group and the wrong answers, in Markdown."""
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for one in rows:
        groups[one["group"]].append(one)
    lines = ["| group | records | first | right | some | honest | wrong | median time [s] |",
             "| --- | --- | --- | --- | --- | --- | --- | --- |"]  # fmt: skip
    for group, ones in groups.items():
        counts = Counter(one["worth"] for one in ones)
        first, some = (sum(one[key] for one in ones) for key in ("first", "some"))
        figures = (len(ones), first, counts["right"], some, counts["honest"], counts["wrong"],
                   f"{median(one['seconds'] for one in ones):.2f}")  # fmt: skip
        lines.append(f"| {group} | {' | '.join(map(str, figures))} |")
    wrong = [f"{one['name']} ({one['truth']}): {one['verdict']} {one['class']}"
            for one in rows if one["worth"] == "wrong"]  # fmt: skip
    return "\n".join([*lines, "", *reliability_lines(rows), "", *wrong])


def main(arguments: list[str]) -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign keyed", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--only", nargs="*", default=[], metavar="TEXT", help="in the name")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    tried = [entry for folder in chosen.folders for entry in entries(folder, chosen.only)]
    rows = in_order("campaign keyed", [partial(row, entry) for entry in tried], chosen.jobs)
    print(json.dumps(rows) if chosen.json else show(rows))
    return 0
