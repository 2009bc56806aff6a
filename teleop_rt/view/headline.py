"""The first screen of a report: did it work, and how well."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from teleop_rt.diagnosis.answers.notes import STEPS_OF_MOTION
from teleop_rt.metrics import in_percent
from teleop_rt.trial.grades import Grade, grades, is_short, lost_share, selected_nrmse, worst
from teleop_rt.trial.late import on_hardware, stalls
from teleop_rt.trial.softened import calmed, softened, unfollowed
from teleop_rt.view.delay import Delays
from teleop_rt.view.html import Tile
from teleop_rt.view.quantities import SMALL, small, small_position
from teleop_rt.view.run_folder import MOVING, Run
from teleop_rt.view.style import count_in_words, model_name, number, parameter, with_unit

_LEAST_LAG_MS = 0.01  # of which the cross-correlation of a run says nothing more


def verdict(summary: Mapping[str, Any], tiles: list[Tile], lacks: str = "") -> tuple[str, str]:
    """Return grade and sentence for the whole run, of which the recording may lack a part."""
    fault = summary["safety"]["fault"]
    if fault["code"] != 0:
        stopped = f"Stopped: {fault['cause']}. Next: {fault['next_step']}."
        return "bad", f"{stopped} {lacks}".rstrip()
    if lacks:
        return "attention", lacks
    if summary["safety"]["state"] in MOVING:
        return "attention", f"Cut off in state {summary['safety']['state']}, before its end."
    ran = "Interrupted" if summary.get("interrupted") else "Ran to its end"
    weak = [tile.title.lower() for tile in tiles if tile.grade in {"attention", "bad"}]
    if weak or any(grade == "attention" for grade, _ in graded_notes(summary)):
        look = f"look at: {', '.join(weak)}" if weak else "read the notes below"
        return "attention", f"{ran} without a fault; {look}."
    if summary.get("interrupted"):
        return "attention", f"{ran} without a fault, and nothing below needs attention."
    return "good", "It worked: ran to its end without a fault, and nothing below needs attention."


def graded_notes(summary: Mapping[str, Any]) -> list[tuple[Grade, str]]:
    """Return the notes with their grades: one on how the run was judged finds no fault with it."""
    return [
        ("unknown" if note == STEPS_OF_MOTION else "attention", note) for note in summary["notes"]
    ]


def tiles(run: Run, residual: Mapping[str, Any], delays: Delays | None) -> list[Tile]:
    """Return the answers of the first screen, in the order in which people ask."""
    graded = grades(run.summary)
    return [
        felt(run, worst([graded["felt_force"], graded["phantom"]])),
        _model(run, worst([graded["model"], graded["surface"], residual["grade"]])),
        Tile("Residual", residual["grade"], residual["title"], (residual["text"],)),
        safety(run.summary, graded["safety"]),
        _loop(run, graded["loop"]),
        _link(run.summary["link"], delays, graded["link"]),
    ]


def felt(run: Run, grade: Grade) -> Tile:
    """Return the tile of the force under the hand: its errors, each as a sentence."""
    master = run.summary["master"]
    nrmse, lag, direct = (master[k] for k in ("nrmse", "lag_ms", "direct_reflection_lag_ms"))
    if nrmse is None:
        reason = master.get("reason", "the master's force was not recorded")
        return Tile("Force under the hand", "unknown", "not judged", (reason,))
    lines = [
        _lags(lag, direct),
        "error and lag compare it with the force of the true environment, in converged contact",
    ]
    met = master.get("worst")
    if met is not None and met["phantom_force"] is not None:
        lines.append(_phantom(met, run))
    if (offset := master.get("offset")) is not None:
        lines.append(_offset(offset, run))
    missed = (of(master, run.units) for of in (softened, calmed, unfollowed))
    lines += [said for said in missed if said is not None]
    return Tile("Force under the hand", grade, f"{in_percent(nrmse)} error", tuple(lines))


def _lags(lag_ms: float | None, direct_ms: float | None) -> str:
    """Return the lag of the felt force, and that which its direct reflection would have."""
    said = "the lag of the felt force is not known"
    if lag_ms is not None:
        said = f"the felt force lags by {_lag(lag_ms)}"
    if direct_ms is not None:
        said += f"; the slave's force, reflected, would lag by {with_unit(direct_ms, 'ms')}"
    return said


def _phantom(met: Mapping[str, float], run: Run) -> str:
    """Return the largest force that was felt where there is no body, as a sentence."""
    if not met["phantom_force"] > 0.0:
        return "the hand felt no force where the true environment gives none"
    phantom = with_unit(met["phantom_force"], run.units.force, 3)
    where = "where the true environment gives none"
    return f"the hand felt up to {phantom} {where}, at {met['phantom_s']:.1f} s"


def _offset(offset: Mapping[str, float], run: Run) -> str:
    """Return how far from its true place the wall was felt, as a sentence."""
    unit = small(run.units.position)
    largest, end = (with_unit(SMALL * offset[key], unit, 3) for key in ("largest", "at_end"))
    at = f"at {offset['largest_s']:.1f} s"
    return f"the wall was felt up to {largest} from its true place, {at}, and {end} at the end"


def _lag(lag_ms: float) -> str:
    """Return a lag in words: its own error is about a hundredth of a millisecond."""
    if abs(lag_ms) < _LEAST_LAG_MS:
        return f"less than {_LEAST_LAG_MS} ms"
    return with_unit(lag_ms, "ms", 2)


def _model(run: Run, grade: Grade) -> Tile:
    summary = run.summary
    chosen = summary["selected"]
    if chosen is None:
        reason = summary["contact"].get("reason", "no contact")
        return Tile("Model", "attention", "none selected", (reason,))
    values = chosen["parameters"].items()
    lines = tuple(parameter(name, one, chosen["regression"]) for name, one in values)
    if (nrmse := selected_nrmse(summary)) is not None:
        lines += (f"misses the force by {in_percent(nrmse)} of its range",)
    met = summary["contact"].get("worst")
    if met is not None and met["surface_error"] is not None:
        error = small_position(met["surface_error"], run.units.position)
        lines += (f"surface off by at most {error}, at {met['surface_error_s']:.1f} s",)
    return Tile("Model", grade, model_name(chosen["model"]), lines)


UNSAFE_STEP = (
    "the rig's file allows this by unsafe_i_know: fit the missing part and take its word out of the"
    " list, or watch the axis yourself"
)
"""Next step for a missing safeguard: the red mark stays as long as it is missing."""


def safety(summary: Mapping[str, Any], grade: Grade) -> Tile:
    """Return the tile of the safeguards: fault, limited commands and missing safeguards."""
    recorded = summary["safety"]
    fault = recorded["fault"]
    limited = recorded.get("commands_limited")
    lines = [f"last state {recorded['state']}"]
    if limited:
        lines.append(
            f"the limiter works as intended: it kept {count_in_words(limited, 'command')} of"
            f" {summary['ticks']} within the rig's limits of velocity and acceleration, where the"
            " target would have passed them"
        )
    unsafe = tuple(f"unsafe: {sentence}" for sentence in recorded.get("unsafe") or ())
    if unsafe and fault["code"] == 0:
        return Tile("Safety", grade, "goes without a safeguard", (*unsafe, UNSAFE_STEP, *lines))
    lines += unsafe
    if fault["code"] == 0:
        return Tile("Safety", grade, "no fault", tuple(lines))
    return Tile("Safety", grade, fault["name"].replace("_", " "), (fault["cause"], *lines))


def _loop(run: Run, grade: Grade) -> Tile:
    summary = run.summary
    missed, ticks = summary["missed_ticks"], summary["ticks"]
    planned = f" of {summary['planned_s']:g}" if is_short(summary) else ""
    rate = f"{number(1.0 / run.period_s)} Hz for {summary['duration_s']:.1f}{planned} s"
    wake, work = summary["wake_latency_us"], summary["work_us"]
    lines = [rate, f"{summary['clock']} clock"]
    if summary.get("interrupted"):
        lines.append("interrupted before its time")
    for name, spread in (("wake", wake), ("work", work)):
        if spread is not None:
            text = f"{name} p50 {spread['p50']:.0f}, p99 {spread['p99']:.0f}, "
            lines.append(f"{text}max {spread['max']:.0f} µs")
    if (late := summary.get("late")) is not None and summary["clock"] != "simulated":
        lines += [f"longest stall {stalls(late)}", f"hardware {on_hardware(late)}"]
    if missed is None:
        return Tile("Loop", grade, "not known", tuple(lines))
    return Tile("Loop", grade, f"{missed} of {ticks} ticks missed", tuple(lines))


def _link(link: Mapping[str, Any], delays: Delays | None, grade: Grade) -> Tile:
    lines = []
    if delays is not None:
        one_way, jitter = with_unit(delays.median_ms, "ms", 3), with_unit(delays.jitter_ms, "ms", 2)
        lines.append(f"one way {one_way} (median), jitter {jitter}")
    share = lost_share(link)
    if share is not None:
        lines.append(f"{in_percent(share)} lost, {link.get('refused', link['rejected'])} refused")
    value = with_unit(link["round_trip_ms"], "ms")
    if link.get("trouble"):
        return Tile("Link", grade, "trouble", (link["trouble"], *lines))
    if link["round_trip_ms"] is None:
        return Tile("Link", grade, "not known", tuple(lines))
    return Tile("Link", grade, f"{value} round trip", tuple(lines))
