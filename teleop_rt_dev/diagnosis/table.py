"""Rates with their 95 % bounds, confusions and wrong answers of a diagnosis campaign."""

from __future__ import annotations

from collections import Counter, defaultdict
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import beta

Row = dict[str, Any]
_SEEN_LAMBDA = 300.0
_BINS = (0.0, 0.2, 0.5, 0.7, 0.9, 0.95, 1.01)  # of stated probability; the last holds 1 itself
_SHOWN = ("group", "generator", "seed", "material", "motion", "kind", "lambda", "verdict", "class",
          "family", "resolved")  # fmt: skip


def interval(hits: int, total: int) -> tuple[float, float]:
    """Return Clopper and Pearson's 95 % interval of a rate."""
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, total - hits + 1))
    high = 1.0 if hits == total else float(beta.ppf(0.975, hits + 1, total - hits))
    return low, high


def rate(rows: list[Row], hit: str) -> dict[str, Any]:
    """Return the rate of rows whose entry `hit` is true, with its interval."""
    hits = sum(bool(r[hit]) for r in rows)
    low, high = interval(hits, len(rows)) if rows else (0.0, 1.0)
    return {
        "hits": hits, "of": len(rows), "rate": hits / len(rows) if rows else None,
        "low": low, "high": high,
    }  # fmt: skip


def table(rows: list[Row]) -> dict[str, dict[str, Any]]:
    """Return the quantities of the bar."""
    for r in rows:
        _judge(r)
    group: dict[str, list[Row]] = defaultdict(list)
    for r in rows:
        group[r["group"]].append(r)
    strong = [r for r in group["single"] if r["lambda"] >= _SEEN_LAMBDA]
    tones = [r for r in group["sinusoid"] if not r["silent"]]
    narrow = [r for r in group["narrow"] if not r["silent"]]
    found: dict[str, dict[str, Any]] = {
        "false alarm": rate(group["null"], "false_alarm"),
        "right effect first, rich, lambda >= 300": rate(strong, "first"),
        "class covers, rich, lambda >= 300": rate(strong, "covered"),
        "wrong name with confidence, rich": rate(group["single"], "wrong_name"),
        "outside the library: unexplained or family": rate(group["outside"], "honest"),
        "pairs: both": rate(group["pair"], "covered"),
        "pairs: at least one": rate(group["pair"], "one_of_pair"),
        "pairs: spurious second": rate(group["pair"], "spurious"),
        "single effect: spurious second": rate(group["single"], "spurious"),
        "single sinusoid: class covers": rate(tones, "covered"),
        "single sinusoid: wrong name": rate(group["sinusoid"], "wrong_name"),
        "narrow motion: class covers": rate(narrow, "covered"),
        "narrow motion: wrong name": rate(group["narrow"], "wrong_name"),
        "class resolved by the proposed record": rate(
            [r for r in tones + narrow if r["resolved"] is not None], "resolved"
        ),
    }
    for level in (0.001, 0.01, 0.05):
        inside = [
            {"inside": i} for r in group["interval"] if r["noise"] == level for i in r["inside"]
        ]
        found[f"95 % intervals cover, noise {100 * level:g} %"] = rate(inside, "inside")
    found["figures"] = figures(rows, strong)
    return found


def _judge(r: Row) -> None:
    """Add to a row whether its answer is right, and its errors."""
    truth, named = r["effects"], set(r["named"])
    r["false_alarm"] = r["verdict"] != "no_missing_effect"
    r["honest"] = (r["verdict"] in {"unexplained", "partial"} and not named) or r["own_family"]
    r["one_of_pair"] = bool(named & set(truth))
    r["spurious"] = len(named) > 1 and not named <= set(truth)
    r["wrong_name"] = r["verdict"] == "named" and not r["covered"]
    r["silent"] = r["verdict"] == "no_missing_effect"


def figures(rows: list[Row], strong: list[Row]) -> dict[str, float | None]:
    """Return the quantities that are no rates."""
    sizes = [len(r["class"]) for r in strong if r["class"]]
    ratio = [r["after_over_floor"] for r in strong if r["after_over_floor"] is not None]
    seconds: dict[str, list[float]] = {
        "nothing": [r["seconds"] for r in rows if not r["effects"]],
        "one effect": [r["seconds"] for r in rows if len(r["effects"]) == 1],
        "two effects": [r["seconds"] for r in rows if len(r["effects"]) == 2],
    }
    found = {
        "mean size of the class": float(np.mean(sizes)) if sizes else None,
        "held-out error over floor, median": float(np.median(ratio)) if ratio else None,
        "held-out error over floor, 90 %": float(np.quantile(ratio, 0.9)) if ratio else None,
    }
    for name, values in seconds.items():
        found[f"processor seconds, {name}, median"] = float(np.median(values)) if values else None
        found[f"processor seconds, {name}, 90 %"] = (
            float(np.quantile(values, 0.9)) if values else None
        )
    return found


def reliability(rows: list[Row]) -> list[dict[str, Any]]:
    """Return, for each bin of stated probability, how often the effect is at work indeed."""
    stated = [(p, name in r["effects"]) for r in rows for name, p in r["probability"].items()]
    bins = []
    for low, high in pairwise(_BINS):
        inside = [(p, right) for p, right in stated if low <= p < high]
        hits = [{"right": right} for _, right in inside]
        mean = float(np.mean([p for p, _ in inside])) if inside else None
        bounds = rate(hits, "right")
        bins.append({
            "from": low, "to": high, "stated": mean, "rate": bounds["rate"], "hits": bounds["hits"],
            "of": bounds["of"], "low": bounds["low"], "high": bounds["high"],
        })  # fmt: skip
    return bins


def brier(rows: list[Row]) -> float | None:
    """Return the mean square of stated probability less truth, over all effects of all answers."""
    squares = [
        (p - (name in r["effects"])) ** 2 for r in rows for name, p in r["probability"].items()
    ]
    return float(np.mean(squares)) if squares else None


def reliability_lines(rows: list[Row]) -> list[str]:
    """Return the reliability diagram and the Brier score as text."""
    lines = ["probability of an effect: stated (mean), correct share with its 95 % bounds"]
    for one in reliability(rows):
        stated = "-" if one["stated"] is None else f"{one['stated']:.2f}"
        share = "-" if one["rate"] is None else f"{one['rate']:.2f}"
        lines.append(
            f"  {one['from']:.2f} to {min(one['to'], 1.0):.2f}: {stated:>5s} {share:>5s}"
            f"  [{one['low']:.2f}, {one['high']:.2f}]  {one['hits']} of {one['of']}"
        )
    score = brier(rows)
    return [*lines, f"  Brier score {'-' if score is None else format(score, '.3f')}"]


def wrong(row: Row) -> bool:
    """Return whether an answer is to be listed."""
    if row["group"] == "interval":
        return False
    if row["group"] == "null":
        return bool(row["false_alarm"])
    if row["group"] == "outside":
        return not row["honest"]
    if row["resolved"] is False:
        return True
    missed = not row["first"] if row["group"] == "single" else not row["covered"]
    return missed and not (row["lambda"] < _SEEN_LAMBDA and row["verdict"] == "no_missing_effect")


def show(rows: list[Row], found: dict[str, dict[str, Any]]) -> None:
    """Print the table, the confusions and the wrong answers."""
    for name, value in found.items():
        if name != "figures":
            shown = "-" if value["rate"] is None else f"{100 * value['rate']:.1f} %"
            print(
                f"{name:48s} {shown:>8s}  [{100 * value['low']:.1f}, {100 * value['high']:.1f}]"
                f"  {value['hits']} of {value['of']}"
            )
    for name, number in found["figures"].items():
        print(f"{name:48s} {'-' if number is None else format(number, '.3f')}")
    print("\n" + "\n".join(reliability_lines(rows)))
    answers = Counter(
        ("+".join(r["effects"]) or "nothing", "+".join(r["named"]) or str(r["verdict"]))
        for r in rows
        if r["group"] != "interval"
    )
    print("\nconfusion: truth -> answer (the best set, or the verdict): records")
    for (truth, named), count in sorted(answers.items()):
        print(f"  {truth} -> {named}: {count}")
    print("\nwrong answers")
    for r in filter(wrong, rows):
        print("  " + "+".join(r["effects"]), {k: r[k] for k in _SHOWN},
              f"size {r['size']:.3f} noise {r['noise']:.4f}")  # fmt: skip
