"""Close the loop over every effect that a plant can hide, one by one, on the simulated clock.

    scripts/campaign closing [--effects NAME ...] [--seeds N] [--clean N] [--json] [--jobs J]

Prints per hidden effect the answer, the lamp, and the errors before and after on the fresh
trial; and of plants that hide nothing, how many were named an effect or lit the lamp. Exits with 1
where a wrong effect was named or an error was made worse.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from teleop_rt_dev.parallel import in_order
from teleop_rt_dev.trial.closed_loop import closed
from teleop_rt_dev.trial.closing_table import show

# Beside each effect, other keys of the trial: a contact that such a force does not feign.
FIRM = ("contact.onset_force_N=4.0", "contact.release_force_N=2.0")
HIDDEN: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "nonlinear_stiffening": ({"stiffness_N_per_m": 1800.0, "locking_depth_m": 0.05}, ()),
    "second_layer": ({"stiffness_N_per_m": 2500.0, "depth_m": 0.011}, ()),
    "stress_relaxation": (
        {"arms": [{"stiffness_N_per_m": k, "time_constant_s": tau}
                  for k, tau in ((800.0, 0.03), (500.0, 0.1), (400.0, 0.4))]}, ()),
    "hysteresis": ({"yield_force_N": 6.0, "yield_travel_m": 0.001}, ()),
    "quadratic_damping": ({"damping_N_s2_per_m2": 150.0}, ()),
    "adhesion": ({"pull_off_force_N": 2.0, "range_m": 0.0005}, ()),
    "softening": ({"share": 0.4, "time_constant_s": 3.0}, ()),
    "mullins_softening": ({"share": 0.3, "width_m": 0.003}, ()),
    "permanent_set": ({"share": 0.15}, ()),
    "moving_surface": ({"swing_m": 0.0008, "swing_hz": 0.4}, ()),
    "coulomb_friction": ({"friction_force_N": 2.0}, FIRM),
    "stribeck_friction": (
        {"friction_force_N": 2.0, "breakaway_force_N": 3.5, "stribeck_velocity_m_per_s": 0.03},
        FIRM),
    "viscous_friction": ({"damping_N_s_per_m": 20.0}, FIRM),
    "direction_dependent_damping": ({"extra_forward_damping_N_s_per_m": 20.0}, FIRM),
    "tool_inertia": ({"mass_N_s2_per_m": 0.5}, FIRM),
    "force_bias": ({"bias_N": 1.0}, FIRM),
    "force_drift": ({"drift_N": 2.0, "time_constant_s": 2.0}, FIRM),
    "periodic_disturbance": ({"amplitude_N": 1.0, "frequency_hz": 50.0}, FIRM),
    "force_lag": ({"cutoff_hz": 20.0}, ()),
    "force_saturation": ({"level_N": 35.0}, ()),
    "outliers": ({"share": 0.01, "size_N": 8.0}, FIRM),
    "channel_delay": ({"delay_ms": 6.0}, ()),
    "backlash": ({"gap_m": 0.0008}, ()),
    "position_ripple": ({"pitch_error_m": 0.0002, "pitch_m": 0.004}, ()),
    "series_compliance": ({"compliance_m_per_N": 1.0e-4}, ()),
}  # fmt: skip
CLEAN = (
    ("soft", 800.0, 5.0), ("silicone", 2500.0, 15.0), ("stiff", 6000.0, 30.0),
    ("lossy", 1500.0, 60.0),
)  # fmt: skip


def overrides(hidden: str, seed: int) -> tuple[str, ...]:
    """Return the overrides that hide an effect."""
    parameters, needed = HIDDEN[hidden]
    declared = yaml.safe_dump(
        [{"effect": hidden, **parameters}], default_flow_style=True, width=10_000
    ).strip()
    return (f"seed={seed}", *needed, f"plant.undeclared={declared}")


def judged(hidden: str, answer: Mapping[str, Any]) -> str:
    """Return the grade of the answer: see the table's legend."""
    verdict, sets = answer["verdict"], [sorted(names) for names in answer["class"]]
    named = [effect["name"] for effect in answer["effects"]]
    if verdict == "named":
        return "right" if sets == [[hidden]] else "spurious" if hidden in named else "wrong"
    if verdict == "class":
        return "class" if [hidden] in sets else "wrong"
    if verdict == "partial":
        return "partial" if named == [hidden] else "wrong"
    return "missed" if verdict == "no_missing_effect" else "unexplained"


def attempted(hidden: str, seed: int, keep: Path | None) -> dict[str, Any]:
    """Return the table's row, also of a loop that fails: the others go on."""
    try:
        row = hidden_row(hidden, seed, keep)
    except Exception as error:  # noqa: BLE001 - whatever it is, the table shows it
        traceback.print_exc()
        empty = dict.fromkeys(("withdrawn", "lamp_s", "free_run", "floor", "on_line", "felt"))
        row = {"hidden": hidden, "seed": seed, "worth": "failed", "verdict": "failed",
               "class": [], "named": [repr(error)], **empty}  # fmt: skip
    print(json.dumps(row), file=sys.stderr, flush=True)
    return row


def hidden_row(hidden: str, seed: int, keep: Path | None) -> dict[str, Any]:
    """Hide an effect, close the loop, and return the table's row."""
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) if keep is None else keep / f"{hidden}-{seed}"
        answer = closed(out, *overrides(hidden, seed))
        first = json.loads((out / "first" / "summary.json").read_text())
    fresh = answer["fresh"] or {}
    row = {
        "hidden": hidden, "seed": seed, "worth": judged(hidden, answer),
        "verdict": answer["verdict"], "class": answer["class"],
        "named": [effect["name"] for effect in answer["effects"]],
        "withdrawn": answer.get("withdrawn"),
        "lamp_s": first["adequacy"]["first_raised_s"],
        "free_run": None, "floor": None, "on_line": None, "felt": None,
        "seconds": round(time.perf_counter() - begun, 1),
    }  # fmt: skip
    if fresh:
        slave = fresh["slave"]
        row["floor"] = slave["free_run"]["noise_floor"]
        errors = {**slave, "felt": fresh["master"]}
        for key in ("free_run", "on_line", "felt"):
            row[key] = [errors[key]["before"], errors[key]["after"]]
    return row


def clean_row(material: tuple[str, float, float], seed: int) -> dict[str, Any]:
    """Close the loop over a plant that hides nothing and return the verdict and the lamp."""
    name, stiffness, damping = material
    changes = (
        f"seed={seed}", "plant.undeclared=[]",
        f"plant.environment.stiffness_N_per_m={stiffness}",
        f"plant.environment.damping_N_s_per_m={damping}",
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        answer = closed(Path(folder), *changes)
        first = json.loads((Path(folder) / "first" / "summary.json").read_text())
    return {"material": name, "seed": seed, "verdict": answer["verdict"],
            "class": answer["class"], "lamp": first["adequacy"]["raised"]}  # fmt: skip


def main(arguments: list[str]) -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(prog="teleop-rt-dev campaign closing", description=__doc__)
    parser.add_argument("--effects", nargs="*", choices=tuple(HIDDEN), default=list(HIDDEN))
    parser.add_argument("--seeds", type=int, default=1, help="seeds of each hidden effect")
    parser.add_argument("--clean", type=int, default=1, help="seeds of each clean material")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder to keep all runs in")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    hidden = (
        partial(attempted, effect, seed, chosen.keep)
        for effect in chosen.effects
        for seed in range(1, chosen.seeds + 1)
    )
    rows = in_order("hidden effects", hidden, chosen.jobs)
    plain = (
        partial(clean_row, material, seed)
        for material in CLEAN
        for seed in range(1, chosen.clean + 1)
    )
    clean = in_order("clean bodies", plain, chosen.jobs)
    print(json.dumps({"campaign": "closing", "rows": rows, "clean": clean})
          if chosen.json else show(rows, clean))  # fmt: skip
    return 1 if any(row["worth"] in {"wrong", "failed"} or worse(row) for row in rows) else 0


def worse(row: Mapping[str, Any]) -> bool:
    """Return whether the extended model made an error worse and was not withdrawn."""
    if row["withdrawn"]:
        return False
    pairs = [row[key] for key in ("free_run", "on_line", "felt")]
    return any(p and None not in p and p[1] > 1.05 * p[0] for p in pairs)
