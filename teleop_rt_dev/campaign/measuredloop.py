"""Close the loop over measured recordings: diagnosed on one, scored on another of the same machine.

    scripts/campaign measuredloop [--only TEXT ...] [--json] [--table FILE ...]

Pairs are those of diagnosis/measured_keys.yaml: two recordings, or the two halves of one that is
long. Each goes through all of `teleop-rt close-loop --recording A --test B`. Printed as soon as
they are there, as Markdown or as JSON lines: verdict, effects, and the error on unseen data before
and after, over the force's deviation there; a pair that fails is a row that says why. `--table`
prints the Markdown of JSON lines that were kept.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from teleop_rt.errors import ExpectedError
from teleop_rt.offline.closing_files import Files, close_recordings
from teleop_rt.offline.table import Table
from teleop_rt.recordings.layout import Layout
from teleop_rt.recordings.recording import Recording, load
from teleop_rt_dev.campaign.measured import KEYS, keyed

HEAD = (
    "| recorded on | scored on | verdict | effects | error before → after | |\n"
    + "| --- " * 6
    + "|"
)


def pairs() -> list[tuple[str, str | None]]:
    """Return the names of the diagnosed and of the scored recording; None for the second half."""
    pairs = yaml.safe_load(KEYS.read_text(encoding="utf-8"))["pairs"]
    return [(pair["recording"], pair.get("test")) for pair in pairs]


def recorded(entry: Mapping[str, Any], data: Path) -> Recording:
    """Return a recording of the key file."""
    layout = Layout(entry["columns"], entry["units"], entry.get("rate_hz"))
    return load(data / entry["file"], layout)


def written(recording: Recording, part: slice, path: Path) -> Path:
    """Write a part of a recording in its own units as NPZ, gaps as not-a-number."""
    kept = np.where(recording.mask[part] > 0.0, recording.force[part], np.nan)
    x, f = recording.units
    position = recording.position[part]
    t = recording.dt * np.arange(position.size)
    columns: dict[str, Any] = {"t_s": t, f"position_{x}": position, f"force_{f}": kept}
    np.savez(path, **columns)
    return path


def row(name: str, other: str | None, data: Path) -> dict[str, Any]:
    """Return the table's row of one pair."""
    entry = next(e for e in keyed() if e["name"] == name)
    first = recorded(entry, data)
    begun = time.process_time()
    found: dict[str, Any] = {"recording": name, "test": other or "its second half"}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        if other is None:
            middle = first.position.size // 2
            second, parts = first, (slice(None, middle), slice(middle, None))
        else:
            second = recorded(next(e for e in keyed() if e["name"] == other), data)
            parts = (slice(None), slice(None))
        recording = written(first, parts[0], out / "A.npz")
        test = written(second, parts[1], out / "B.npz")
        try:
            answer, _ = close_recordings(
                Files(recording, test, Table({}, {}, None)), entry["base"], out
            )
        except (ExpectedError, ValueError, ArithmeticError) as error:
            return {**found, "verdict": "failed", "effects": [], "reason": str(error)}
    scores = answer["fresh"]["slave"]["free_run"] if answer["fresh"] else None
    normalised = None if scores is None else scores["std_normalised"]
    effects = [effect["name"] for effect in answer["effects"]]
    draft = answer["draft"] if not effects else None
    return {
        **found, "verdict": answer["verdict"], "effects": effects,
        "draft": None if draft is None else draft["terms"],
        "before": None if normalised is None else normalised["before"],
        "after": None if normalised is None else normalised["after"],
        "withdrawn": answer["withdrawn"], "reason": answer.get("reason"),
        "seconds": round(time.process_time() - begun, 1),
    }  # fmt: skip


def markdown(r: Mapping[str, Any]) -> str:
    """Return one row of the table."""
    named = ", ".join(name.replace("_", " ") for name in r["effects"])
    if not named and r.get("draft"):
        named = f"drafted: {'; '.join(dict.fromkeys(r['draft']))}"
    figures = "-"
    if r.get("before") is not None or r.get("after") is not None:
        before, after = ("-" if r[k] is None else f"{r[k]:.3f}" for k in ("before", "after"))
        figures = f"{before} → {after}"
    aside = "withdrawn" if r.get("withdrawn") else "" if figures != "-" else str(r.get("reason"))
    verdict = r["verdict"].replace("_", " ")
    return f"| {r['recording']} | {r['test']} | {verdict} | {named} | {figures} | {aside} |"


def main(arguments: list[str]) -> int:
    """Run the campaign; exits with 2 where there are no recordings."""
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign measuredloop", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--only", nargs="*", default=[], help="texts, one in the recording's name")
    parser.add_argument("--json", action="store_true")
    parser.add_argument(
        "--table", nargs="*", type=Path, default=[], help="JSON lines that were kept"
    )
    chosen = parser.parse_args(arguments)
    if chosen.table:
        lines = [line for path in chosen.table for line in path.read_text().splitlines()]
        print("\n".join([HEAD, *(markdown(json.loads(line)) for line in lines)]))
        return 0
    data = os.environ.get("TELEOP_RT_DATA")
    if not data:
        print("campaign measuredloop: set TELEOP_RT_DATA to the recordings", file=sys.stderr)
        return 2
    if not chosen.json:
        print(HEAD)
    for name, other in pairs():
        if not chosen.only or any(text in name for text in chosen.only):
            found = row(name, other, Path(data))
            print(json.dumps(found) if chosen.json else markdown(found), flush=True)
    return 0
