"""The default trial on every rig that ships: stiffness, damping, surface, felt error, faults.

    scripts/campaign presets [--processes] [--seconds S] [--seed N] [--seeds COUNT] [RIG ...]

Prints a table in Markdown; with --seeds one row for so many seeds of each rig, with the worst of
stiffness and surface, and in how many runs the truth lies in the estimate's own interval. Rigs run
on the simulated clock, or with --processes on the real one, each side a process of its own: then
the figures depend on the machine's other work. Exits with 1 where a rig ends in a fault, or
misses the bounds of the default trial.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from teleop_rt_dev.paths import RIGS, SILICONE

HANDLE_TRIAL = SILICONE.with_name("handle.yaml")
HANDLE = "_handle"
ABOVE_NOISE = (
    "contact.onset_force_N=2", "contact.release_force_N=1", "operator.felt_force_N=2",
)  # fmt: skip
"""Of a rig whose force is its drive's torque, with its noise of 0.4 N."""
OF_RIG = {"canopen_drive": ABOVE_NOISE}
K_PERCENT, SURFACE_MM = 3.0, 0.5
INTERVAL = 1.96
"""Standard deviations: half of an interval with 95 % of a normal distribution."""
HEAD = ("rig", "k [N/m]", "b [N s/m]", "true k, b inside", "surface [mm]", "felt NRMSE", "fault")


def rigs() -> list[str]:
    """Return the names of the simulated rigs that ship, operator's devices last."""
    names = [file.stem.removeprefix("simulated_") for file in RIGS.glob("simulated_*.yaml")]
    return sorted(names, key=lambda name: (name.endswith("handle"), name))


def command(name: str, seconds: float, seed: int, *, processes: bool, out: Path) -> list[str]:
    """Return the command that runs a rig's trial."""
    is_handle = name.endswith("handle")
    key = "operator.rig" if is_handle else "rig"
    options = [f"{key}={RIGS / f'simulated_{name}.yaml'}", *OF_RIG.get(name, ())]
    settings = [word for option in options for word in ("--set", option)]
    clock = "real" if processes else "simulated"
    return [
        sys.executable, "-m", "teleop_rt", "run", str(HANDLE_TRIAL if is_handle else SILICONE),
        "--clock", clock, "--duration", str(seconds), "--seed", str(seed), "--out", str(out),
        "--json", *settings,
    ]  # fmt: skip


def measured(name: str, seconds: float, seed: int, *, processes: bool) -> dict[str, Any]:
    """Run a rig's trial, and return a row of the table."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        words = command(name, seconds, seed, processes=processes, out=out)
        ended = subprocess.run(words, capture_output=True, text=True, check=False)
        kept = out / "summary.json"
        if not kept.is_file():
            return {"rig": name, "fault": (ended.stderr.strip().splitlines() or ["no summary"])[-1]}
        summary = json.loads(kept.read_text(encoding="utf-8"))
    (row,) = (one for one in summary["estimators"] if one["model"] == "kelvin-voigt")
    contact, values = summary["contact"], row["parameters"] or {}
    found, true = contact["surface_found"], contact["surface_true"]
    return {
        "rig": name,
        **{
            f"{key}_{part}": values.get(key, {}).get(part)
            for key in "kb"
            for part in ("value", "std")
        },
        "surface_mm": None if found is None else 1e3 * (found - true),
        "nrmse": summary["master"]["nrmse"],
        "rejected": summary["safety"]["samples_rejected"],
        "fault": summary["safety"]["fault"]["name"],
    }


def inside(row: dict[str, Any], key: str, true: float) -> str:
    """Return whether the truth lies in a parameter's own 95 % interval."""
    value, deviation = row[f"{key}_value"], row[f"{key}_std"]
    if value is None or deviation is None:
        return "-"
    return "yes" if abs(value - true) <= INTERVAL * deviation else "no"


def cells(row: dict[str, Any]) -> list[str]:
    """Return a row's cells; a rig that gave no summary has its last message alone."""
    if "k_value" not in row:
        return [row["rig"], "-", "-", "-", "-", "-", row["fault"]]
    numbers = [
        "-" if row[key] is None else f"{row[key]:{form}}"
        for key, form in (("k_value", ".1f"), ("b_value", ".2f"))
    ]
    rest = [
        "-" if row[key] is None else f"{row[key]:{form}}"
        for key, form in (("surface_mm", "+.3f"), ("nrmse", ".4f"))
    ]
    own = f"{inside(row, 'k', 3600.0)}, {inside(row, 'b', 20.0)}"
    return [row["rig"], *numbers, own, *rest, row["fault"]]


def holds(row: dict[str, Any]) -> bool:
    """Return whether a rig ran without fault and within the bounds of the default trial."""
    if row["fault"] != "none" or row["k_value"] is None or row["surface_mm"] is None:
        return False
    off_percent: float = abs(row["k_value"] / 36.0 - 100.0)
    return off_percent <= K_PERCENT and bool(abs(row["surface_mm"]) <= SURFACE_MM)


def over_seeds(rows: Sequence[dict[str, Any]]) -> str:
    """Return the row of a table of several runs of one rig."""
    ran = [row for row in rows if row.get("k_value") is not None and row["surface_mm"] is not None]
    faults = sorted({row["fault"] for row in rows if row["fault"] != "none"})
    cells = [rows[0]["rig"], f"{len(rows)}"]
    if ran:
        k = max((row["k_value"] / 36.0 - 100.0 for row in ran), key=abs)
        surface = max((row["surface_mm"] for row in ran), key=abs)
        b = [row["b_value"] for row in ran]
        cells += [f"{k:+.2f}", f"{surface:+.3f}", f"{min(b):.2f} to {max(b):.2f}"]
        for key, true in (("k", 3600.0), ("b", 20.0)):
            answers = [inside(row, key, true) for row in ran]
            known = [answer for answer in answers if answer != "-"]
            cells.append(f"{known.count('yes')} of {len(known)}")
    else:
        cells += ["-"] * 5
    held = sum(holds(row) for row in rows)
    return f"| {' | '.join([*cells, f'{held} of {len(rows)}', ', '.join(faults) or 'none'])} |"


HEAD_OF_SEEDS = (
    "rig", "runs", "worst k [%]", "worst surface [mm]", "b [N s/m]", "k inside", "b inside",
    "within bounds", "faults",
)  # fmt: skip


def main(arguments: Sequence[str]) -> int:
    """Run the rigs one after the other; return the exit code."""
    parser = argparse.ArgumentParser(prog="presets", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("rigs", nargs="*", metavar="RIG", help="such as odrive; all by default")
    parser.add_argument("--processes", action="store_true")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=1, help="so many, from --seed on")
    options = parser.parse_args(arguments)
    head = HEAD if options.seeds == 1 else HEAD_OF_SEEDS
    print(f"| {' | '.join(head)} |\n|{' --- |' * len(head)}", flush=True)
    good = True
    for name in options.rigs or rigs():
        rows = [
            measured(name, options.seconds, seed, processes=options.processes)
            for seed in range(options.seed, options.seed + options.seeds)
        ]
        one = options.seeds == 1
        print(f"| {' | '.join(cells(rows[0]))} |" if one else over_seeds(rows), flush=True)
        good = good and all(holds(row) for row in rows)
    return 0 if good else 1
