"""The rules of quality: one grade per part of a run, for summary, report, page and terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, Literal

from teleop_rt.estimation.report import KEYS

Grade = Literal["good", "attention", "bad", "unknown"]

GOOD_NRMSE = 0.02
"""Error of a force over its range [1]. Hands distinguish forces from about 7 % on (Pang, Tan and
Durlach 1991), and an error is seldom larger than three times its root mean square."""
POOR_NRMSE = 0.1
"""Error of a force over its range [1] that a hand feels all the time."""
GOOD_LAG_MS = 10.0
"""Lag of the felt force: hands notice about 15 ms (Rank et al. 2010)."""
PEAK = 3.0
"""The largest error that is as good as a root mean square: an error is seldom larger."""
MISSED_SHARE = 1e-3
"""Share of missed ticks: one in a thousand moves no estimate and no command that can be felt."""
LOST_SHARE = 0.05
"""Share of lost packets: at 1 kHz three lost in a row are then rarer than one in 8 s."""
MARKS: Mapping[Grade, str] = MappingProxyType(
    {"good": "✓", "attention": "!", "bad": "✕", "unknown": "–"}
)
"""A sign beside each colour, for those who do not see the colour."""
GRADE_COLOURS: Mapping[Grade, str] = MappingProxyType(
    {"good": "green", "attention": "yellow", "bad": "bold red", "unknown": "dim"}
)
"""The colour of each grade on a terminal."""
WHOLE_S = 0.02
"""A run that is shorter by no more is whole: first and last tick lie within its time."""
_WORST_FIRST: tuple[Grade, ...] = ("bad", "attention", "good", "unknown")


def grades(summary: Mapping[str, Any]) -> dict[str, Grade]:
    """Return the grade of each part of a run, from its summary."""
    inadequate = (summary.get("adequacy") or {}).get("inadequate")
    return {
        "felt_force": of_felt_force(summary["master"]["nrmse"], summary["master"]["lag_ms"]),
        "phantom": of_peak(summary["master"].get("worst"), "phantom_force", "force_range"),
        "model": (
            of_model(selected_nrmse(summary), inadequate=inadequate)
            if summary["selected"]
            else "attention"
        ),
        "surface": of_peak((summary.get("contact") or {}).get("worst"), "surface_error", "deepest"),
        "safety": of_safety(summary["safety"]),
        "loop": of_loop(
            summary["missed_ticks"],
            summary["ticks"],
            cut_off=summary.get("interrupted", False)
            or (is_short(summary) and bool(summary["safety"]["fault"]["code"])),
        ),
        "link": of_link(summary["link"]),
    }


def worst(found: Iterable[Grade]) -> Grade:
    """Return the worst of some grades, of which `unknown` weighs nothing; unknown without any."""
    return min(found, key=_WORST_FIRST.index, default="unknown")


def of_error(nrmse: float | None) -> Grade:
    """Return the grade of a force's error over its range [1]."""
    if nrmse is None:
        return "unknown"
    if nrmse > POOR_NRMSE:
        return "bad"
    return "good" if nrmse <= GOOD_NRMSE else "attention"


def of_peak(worst_case: Mapping[str, Any] | None, largest: str, span: str) -> Grade:
    """Return the grade of the largest error in a whole run, by the range of that quantity.

    Both are keys of `worst_case`, of a part of the summary; unknown where there is no range.
    """
    if worst_case is None or worst_case[largest] is None or not worst_case[span]:
        return "unknown"
    return of_error(worst_case[largest] / worst_case[span] / PEAK)


def of_felt_force(nrmse: float | None, lag_ms: float | None) -> Grade:
    """Return the grade of the force under the hand: the worse of error and lag."""
    if nrmse is None:
        return "unknown"
    late = lag_ms is not None and abs(lag_ms) > GOOD_LAG_MS
    return worst([of_error(nrmse), "attention" if late else "good"])


def of_model(nrmse: float | None, *, inadequate: bool | None) -> Grade:
    """Return the grade of the selected model: never good while it leaves structure in the force."""
    adequate: Grade = "unknown" if inadequate is None else "attention" if inadequate else "good"
    return worst([of_error(nrmse), adequate])


def of_safety(safety: Mapping[str, Any]) -> Grade:
    """Return the grade of the safety chain: bad after a fault, or without a safeguard."""
    if safety["fault"]["code"] is None:
        return "unknown"
    return "bad" if safety["fault"]["code"] or safety.get("unsafe") else "good"


def of_fault(safety: Mapping[str, Any]) -> Grade:
    """Return the grade of how a run ended, whatever safeguard its rig goes without."""
    return of_safety({**safety, "unsafe": ()})


def is_short(summary: Mapping[str, Any]) -> bool:
    """Return whether a run ended before its trial's time; false where that is not known."""
    planned_s: float | None = summary.get("planned_s")
    return planned_s is not None and bool(summary["duration_s"] < planned_s - WHOLE_S)


def of_loop(missed: int | None, ticks: int, *, cut_off: bool = False) -> Grade:
    """Return the grade of the loop by the share of ticks missed.

    A run that a fault or somebody cut off is not good.
    """
    if missed is None:
        return "unknown"
    whole = not cut_off and missed <= MISSED_SHARE * ticks
    return "good" if whole else "attention"


def of_link(link: Mapping[str, Any]) -> Grade:
    """Return the grade of the link: bad in trouble, attention where much is lost."""
    if link.get("trouble"):
        return "bad"
    if link["round_trip_ms"] is None:
        return "unknown"
    share = lost_share(link)
    return "attention" if share is not None and share > LOST_SHARE else "good"


def lost_share(link: Mapping[str, Any]) -> float | None:
    """Return the share of the packets to the slave that never came; None where not counted."""
    if link["lost"] is None or not link["received"]:
        return None
    return float(link["lost"] / (link["lost"] + link["received"]))


def selected_nrmse(summary: Mapping[str, Any]) -> float | None:
    """Return the error of the selected estimator [1]; None where none is selected."""
    chosen = summary["selected"]
    for row in summary["estimators"]:
        if chosen and all(row.get(key) == chosen.get(key) for key in KEYS):
            error: float | None = row["nrmse"]
            return error
    return None
