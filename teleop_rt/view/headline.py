"""The first screen of a report: did it work, and how well."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from teleop_rt.trial.late import on_hardware, stalls
from teleop_rt.view.delay import Delays
from teleop_rt.view.html import Tile
from teleop_rt.view.run_folder import Run, selected_row
from teleop_rt.view.style import model_name, number, parameter, with_unit

_POOR_NRMSE = 0.1
_MISSED_SHARE = 1e-3
_MOVING = frozenset({"ARMED", "RUN", "HOLD"})


def verdict(summary: Mapping[str, Any], tiles: list[Tile]) -> tuple[str, str]:
    """Return grade and sentence for the whole run."""
    fault = summary["safety"]["fault"]
    if fault["code"] != 0:
        return "bad", f"Stopped: {fault['cause']}. Next: {fault['next_step']}."
    if summary["safety"]["state"] in _MOVING:
        return "attention", f"Cut off in state {summary['safety']['state']}, before its end."
    weak = [tile.title.lower() for tile in tiles if tile.grade in {"attention", "bad"}]
    if weak:
        return "attention", f"Ran to its end without a fault; look at: {', '.join(weak)}."
    if summary["notes"]:
        return "attention", "Ran to its end without a fault; read the notes below."
    return "good", "It worked: ran to its end without a fault, and nothing below needs attention."


def tiles(run: Run, residual: Mapping[str, Any], delays: Delays | None) -> list[Tile]:
    """Return the answers of the first screen, in the order in which people ask."""
    return [
        _felt(run.summary["master"]),
        _model(run.summary),
        Tile("Residual", residual["grade"], residual["title"], (residual["text"],)),
        _safety(run.summary["safety"]),
        _loop(run),
        _link(run.summary["link"], delays),
    ]


def _felt(master: Mapping[str, Any]) -> Tile:
    nrmse, lag, direct = (master[k] for k in ("nrmse", "lag_ms", "direct_reflection_lag_ms"))
    if nrmse is None:
        reason = master.get("reason", "the master's force was not recorded")
        return Tile("Force under the hand", "unknown", "not judged", (reason,))
    lines = (
        f"lag {with_unit(lag, 'ms', 2)}; reflecting the slave's force: {with_unit(direct, 'ms')}",
        "against the true environment, in converged contact",
    )
    grade = "good" if nrmse <= _POOR_NRMSE else "attention"
    return Tile("Force under the hand", grade, f"{100 * nrmse:.2g} % error", lines)


def _model(summary: Mapping[str, Any]) -> Tile:
    chosen = summary["selected"]
    if chosen is None:
        reason = summary["contact"].get("reason", "no contact")
        return Tile("Model", "attention", "none selected", (reason,))
    lines = tuple(parameter(name, content) for name, content in chosen["parameters"].items())
    row = selected_row(summary)
    nrmse = None if row is None else row["nrmse"]
    if nrmse is not None:
        lines += (f"misses the force by {100 * nrmse:.2g} % of its range",)
    grade = "good" if nrmse is not None and nrmse <= _POOR_NRMSE else "attention"
    return Tile("Model", grade, model_name(chosen["model"]), lines)


def _safety(safety: Mapping[str, Any]) -> Tile:
    fault = safety["fault"]
    limited = safety.get("commands_limited")
    lines = [f"last state {safety['state']}"]
    lines += [f"{limited} commands held to the rig's limits"] if limited is not None else []
    unsafe = tuple(f"unsafe: {sentence}" for sentence in safety.get("unsafe") or ())
    if unsafe and fault["code"] == 0:
        return Tile("Safety", "bad", "goes without a safeguard", (*unsafe, *lines))
    lines += unsafe
    if fault["code"] == 0:
        return Tile("Safety", "good", "no fault", tuple(lines))
    return Tile("Safety", "bad", fault["name"].replace("_", " "), (fault["cause"], *lines))


def _loop(run: Run) -> Tile:
    summary = run.summary
    missed, ticks = summary["missed_ticks"], summary["ticks"]
    rate = f"{number(1.0 / run.period_s)} Hz for {summary['duration_s']:.1f} s"
    wake, work = summary["wake_latency_us"], summary["work_us"]
    lines = [rate, f"{summary['clock']} clock"]
    for name, spread in (("wake", wake), ("work", work)):
        if spread is not None:
            text = f"{name} p50 {spread['p50']:.0f}, p99 {spread['p99']:.0f}, "
            lines.append(f"{text}max {spread['max']:.0f} µs")
    if (late := summary.get("late")) is not None and summary["clock"] != "simulated":
        lines += [f"longest stall {stalls(late)}", f"hardware {on_hardware(late)}"]
    if missed is None:
        return Tile("Loop", "unknown", "not told", tuple(lines))
    grade = "good" if missed <= _MISSED_SHARE * ticks else "attention"
    return Tile("Loop", grade, f"{missed} of {ticks} ticks missed", tuple(lines))


def _link(link: Mapping[str, Any], delays: Delays | None) -> Tile:
    lines = []
    if delays is not None:
        one_way, jitter = with_unit(delays.median_ms, "ms", 3), with_unit(delays.jitter_ms, "ms", 2)
        lines.append(f"one way {one_way} (median), jitter {jitter}")
    share = lost_share(link)
    if share is not None:
        lines.append(f"{100 * share:.2g} % lost, {link.get('refused', link['rejected'])} refused")
    value = with_unit(link["round_trip_ms"], "ms")
    if link.get("trouble"):
        return Tile("Link", "bad", "trouble", (link["trouble"], *lines))
    if link["round_trip_ms"] is None:
        return Tile("Link", "unknown", "not told", tuple(lines))
    return Tile("Link", "good", f"{value} round trip", tuple(lines))


def lost_share(link: Mapping[str, Any]) -> float | None:
    """Return the share of the packets to the slave that never came; None where not counted."""
    if link["lost"] is None or not link["received"]:
        return None
    return float(link["lost"] / (link["lost"] + link["received"]))
