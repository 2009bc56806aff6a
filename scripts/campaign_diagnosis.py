"""Diagnosis campaign: synthetic recordings from independent physics, judged against the bar.

    scripts/campaign diagnosis [--records N] [--json] [--jobs J] [--seed S] [--group G]

Prints the table of rates with their 95 % bounds, the confusions, and every wrong answer.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from scipy.stats import beta

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "diagnosis"))

from diagnosis_plants import MATERIALS, STRANGERS, Record, make

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.recording import from_arrays

FAMILY = {effect.name: effect.family for effect in LIBRARY}
SINGLES = tuple(name for name in FAMILY if name != "gravity_torque")
PAIRS = (
    ("coulomb_friction", "force_bias"), ("stress_relaxation", "coulomb_friction"),
    ("nonlinear_stiffening", "channel_delay"), ("tool_inertia", "force_bias"),
    ("hysteresis", "force_drift"), ("backlash", "periodic_disturbance"),
    ("second_layer", "coulomb_friction"), ("mullins_softening", "force_bias"),
    ("stress_relaxation", "periodic_disturbance"), ("adhesion", "channel_delay"),
    ("quadratic_damping", "contact_offset"), ("position_ripple", "tool_inertia"),
)  # fmt: skip
ENCODER_STEP_M = 5e-6
STRANGER_FAMILY = {
    "pulsating_stiffness": {"drift", "periodic"},
    "tool_resonance": {"inertia", "periodic", "delay"},
    "thinning_damper": {"damping", "friction"},
    "wandering_gain": {"drift"},
    "depth_waves": {"stiffening", "ripple"},
}


def plan(group: str, number: int, seed: int) -> dict[str, object]:
    """Return what record `number` of a group is made of; its seed alone decides."""
    rng = np.random.default_rng([seed, number, sum(map(ord, group))])
    case: dict[str, object] = {
        "group": group,
        "seed": int(rng.integers(2**31)),
        "material": str(rng.choice(list(MATERIALS))),
        "motion": "sinusoid" if group == "sinusoid" else "rich",
        "size": float(np.exp(rng.uniform(np.log(0.02), np.log(0.3)))),
        "noise": float(np.exp(rng.uniform(np.log(0.001), np.log(0.05)))),
        "kind": "white",
    }
    if group == "null":
        case["kind"] = ("white", "white", "white", "white", "ar1", "pink")[number % 6]
        case["motion"] = ("rich", "rich", "tapping", "sinusoid")[number % 4]
        effects: tuple[str, ...] = ()
    elif group == "pair":
        effects = PAIRS[number % len(PAIRS)]
    elif group == "stranger":
        effects = (STRANGERS[number % len(STRANGERS)],)
    else:
        effects = (SINGLES[number % len(SINGLES)],)
    case["effects"] = list(effects)
    return case


def excess_lambda(record: Record) -> float:
    """Return the energy of the true effect that the base's own refit leaves, over the noise's."""
    x = np.maximum(record.path, 0.0)
    v = np.gradient(record.path, record.t)
    inside = record.path > 0.0
    powers = (1.0,) if record.base == "kelvin-voigt" else np.linspace(0.8, 3.0, 45)
    best = np.inf
    for n in powers:
        damping = v if record.base == "kelvin-voigt" else x**n * v
        design = np.where(inside, np.array([x**n, damping]), 0.0).T
        rest = record.clean - design @ np.linalg.lstsq(design, record.clean, rcond=None)[0]
        best = min(best, float(rest @ rest))
    stiffness = float(np.std(record.clean) / np.std(x))
    return best / (record.noise**2 + (stiffness * ENCODER_STEP_M) ** 2 / 12.0)


def run(case: dict[str, object]) -> dict[str, object]:
    """Diagnose one record and judge the answer."""
    effects = tuple(case["effects"])  # type: ignore[arg-type]
    record = make(
        int(case["seed"]), effects, str(case["material"]), str(case["motion"]),  # type: ignore[call-overload]
        float(case["size"]), float(case["noise"]), str(case["kind"]),  # type: ignore[arg-type]
    )  # fmt: skip
    answer = diagnose(
        from_arrays("record", record.t, record.position, record.force), record.base, surface=0.0
    ).answer
    sets = [sorted(s) for s in answer["class"]]
    truth = sorted(effects)
    families = {e["family"] for e in answer["effects"]} | ({answer["family"]} - {None})
    return {
        **case,
        "lambda": round(excess_lambda(record), 1),
        "verdict": answer["verdict"],
        "class": sets,
        "named": [e["name"] for e in answer["effects"]],
        "family": answer["family"],
        "first": bool(sets) and sets[0] == truth,
        "covered": truth in sets,
        "own_family": families <= STRANGER_FAMILY.get(truth[0] if truth else "", set()),
        "after_over_floor": answer["error"]["after_over_floor"],
        "seconds": answer["seconds"],
    }


def interval(hits: int, total: int) -> tuple[float, float]:
    """Return Clopper and Pearson's 95 % interval of a rate."""
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, total - hits + 1))
    high = 1.0 if hits == total else float(beta.ppf(0.975, hits + 1, total - hits))
    return low, high


def rate(rows: list[dict[str, object]], hit: str) -> dict[str, object]:
    """Return the rate of rows whose entry `hit` is true, with its interval."""
    hits = sum(bool(r[hit]) for r in rows)
    low, high = interval(hits, len(rows)) if rows else (0.0, 1.0)
    return {
        "hits": hits, "of": len(rows), "rate": hits / len(rows) if rows else None,
        "low": low, "high": high,
    }  # fmt: skip


def table(rows: list[dict[str, object]]) -> dict[str, dict[str, object]]:
    """Return the quantities of the bar."""
    for r in rows:
        truth = list(r["effects"])  # type: ignore[call-overload]
        named = set(r["named"])  # type: ignore[call-overload]
        r["false_alarm"] = r["verdict"] != "no_missing_effect"
        r["honest"] = (r["verdict"] in {"unexplained", "partial"} and not named) or r["own_family"]
        r["one_of_pair"] = bool(named & set(truth))
        r["spurious"] = len(named) > 1 and not named <= set(truth)
        r["wrong_name"] = r["verdict"] == "named" and not r["covered"]
        r["silent"] = r["verdict"] == "no_missing_effect"
    group = defaultdict(list)
    for r in rows:
        group[r["group"]].append(r)
    strong = [r for r in group["single"] if float(r["lambda"]) >= 300.0]  # type: ignore[arg-type]
    found: dict[str, dict[str, object]] = {
        "false alarm": rate(group["null"], "false_alarm"),
        "right effect first, rich, lambda >= 300": rate(strong, "first"),
        "class covers, rich, lambda >= 300": rate(strong, "covered"),
        "wrong name with confidence, rich": rate(group["single"], "wrong_name"),
        "outside the library: unexplained or family": rate(group["stranger"], "honest"),
        "pairs: both": rate(group["pair"], "covered"),
        "pairs: at least one": rate(group["pair"], "one_of_pair"),
        "pairs: spurious second": rate(group["pair"], "spurious"),
        "single effect: spurious second": rate(group["single"], "spurious"),
        "single sinusoid: class covers": rate(
            [r for r in group["sinusoid"] if not r["silent"]], "covered"
        ),
        "single sinusoid: wrong name": rate(group["sinusoid"], "wrong_name"),
    }
    sizes = [len(r["class"]) for r in strong if r["class"]]  # type: ignore[arg-type]
    ratio = [r["after_over_floor"] for r in strong if r["after_over_floor"] is not None]
    seconds = [float(r["seconds"]) for r in rows]  # type: ignore[arg-type]
    found["figures"] = {
        "mean size of the class": float(np.mean(sizes)) if sizes else None,
        "held-out error over floor, median": float(np.median(ratio)) if ratio else None,  # type: ignore[arg-type]
        "held-out error over floor, 90 %": float(np.quantile(ratio, 0.9)) if ratio else None,  # type: ignore[arg-type]
        "seconds, median": float(np.median(seconds)),
        "seconds, 90 %": float(np.quantile(seconds, 0.9)),
    }
    return found


def wrong(row: dict[str, object]) -> bool:
    """Tell whether an answer is to be listed."""
    if row["group"] == "null":
        return bool(row["false_alarm"])
    if row["group"] == "stranger":
        return not row["honest"]
    weak = float(row["lambda"]) < 300.0  # type: ignore[arg-type]
    missed = not row["first"] if row["group"] == "single" else not row["covered"]
    return missed and not (weak and row["verdict"] == "no_missing_effect")


def show(rows: list[dict[str, object]], found: dict[str, dict[str, object]]) -> None:
    """Print the table, the confusions and the wrong answers."""
    for name, value in found.items():
        if name == "figures":
            continue
        shown = "-" if value["rate"] is None else f"{100 * float(value['rate']):.1f} %"  # type: ignore[arg-type]
        print(
            f"{name:48s} {shown:>8s}  [{100 * float(value['low']):.1f}, "  # type: ignore[arg-type]
            f"{100 * float(value['high']):.1f}]  {value['hits']} of {value['of']}"  # type: ignore[arg-type]
        )
    for name, number in found["figures"].items():
        print(f"{name:48s} {'-' if number is None else format(float(number), '.3f')}")  # type: ignore[arg-type]
    confusions = Counter(
        ("+".join(r["effects"]) or "nothing", "+".join(r["named"]) or str(r["verdict"]))  # type: ignore[arg-type]
        for r in rows
        if wrong(r)
    )
    print("\ntruth -> answer")
    for (truth, named), count in confusions.most_common():
        print(f"  {truth} -> {named}: {count}")
    print("\nwrong answers")
    for r in filter(wrong, rows):
        keys = (
            "group",
            "seed",
            "material",
            "motion",
            "kind",
            "lambda",
            "verdict",
            "class",
            "family",
        )
        print("  " + "+".join(r["effects"]), {k: r[k] for k in keys},  # type: ignore[arg-type]
              f"size {r['size']:.3f} noise {r['noise']:.4f}")  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(prog="campaign diagnosis", description=__doc__)
    parser.add_argument("--records", type=int, default=600, help="records in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--group", choices=("null", "single", "pair", "stranger", "sinusoid"))
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    shares = {"null": 0.4, "single": 0.3, "pair": 0.1, "stranger": 0.1, "sinusoid": 0.1}
    if options.group:
        shares = {options.group: 1.0}
    cases = [
        plan(group, i, options.seed)
        for group, share in shares.items()
        for i in range(round(share * options.records))
    ]
    begun = time.perf_counter()
    rows: list[dict[str, object]] = Parallel(n_jobs=options.jobs)(delayed(run)(c) for c in cases)
    found = table(rows)
    if options.json:
        print(json.dumps({"seed": options.seed, "table": found, "records": rows}))
    else:
        print(f"{len(rows)} records, seed {options.seed}, {time.perf_counter() - begun:.0f} s\n")
        show(rows, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
