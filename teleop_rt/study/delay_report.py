"""Figures and page of the delay study: where each mode wins."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

from matplotlib.figure import Figure

from teleop_rt.batch.workers import Result
from teleop_rt.study.delay import Gains, winners
from teleop_rt.study.figures import blank, save
from teleop_rt.study.page import figure, table, write_page

_MEASURES = (
    ("nrmse", "NRMSE of felt force"),
    ("stable", "share of stable cells"),
)


def felt_force_figure(results: Sequence[Result]) -> Figure:
    """Draw error of the felt force and share of stable cells over the round trip."""
    environments = sorted({r["environment"] for r in results})
    drawn = blank(len(environments), 2, width=3.2, height=2.5)
    axes = drawn.subplots(2, len(environments), squeeze=False, sharex=True, sharey="row")
    for column, environment in enumerate(environments):
        axes[0, column].set_title(environment)
        axes[1, column].set_xlabel("round trip / ms")
        for mode in sorted({r["mode"] for r in results}):
            own = [r for r in results if (r["mode"], r["environment"]) == (mode, environment)]
            for row, (name, _) in enumerate(_MEASURES):
                axes[row, column].plot(*_by_trip(own, name), marker=".", label=mode)
        axes[0, column].set_yscale("log")
        axes[0, column].axhline(0.05, color="0.6", linewidth=0.8)
    for row, (_, label) in enumerate(_MEASURES):
        axes[row, 0].set_ylabel(label)
    axes[0, 0].legend(fontsize="small")
    return drawn


def impedance_figure(results: Sequence[Result]) -> Figure:
    """Draw impedance felt over true by frequency, for each mode at the longest stable delay."""
    modes = sorted({r["mode"] for r in results})
    drawn = blank(len(modes), 1, width=3.2, height=2.6)
    axes = drawn.subplots(1, len(modes), squeeze=False, sharey=True)
    for column, mode in enumerate(modes):
        axis = axes[0, column]
        for environment in sorted({r["environment"] for r in results}):
            shown = [
                r for r in results
                if (r["mode"], r["environment"]) == (mode, environment)
                and r["stable"] and r["impedance"] and r["impedance"]["felt"]
            ]  # fmt: skip
            if shown:
                last = max(shown, key=lambda r: r["round_trip_ms"])
                z = last["impedance"]
                ratio = [a / b for a, b in zip(z["felt"], z["true"], strict=True)]
                label = f"{environment}, {last['round_trip_ms']:.0f} ms"
                axis.loglog(z["frequency_hz"], ratio, marker=".", label=label)
        axis.axhline(1.0, color="0.6", linewidth=0.8)
        axis.set_title(mode)
        axis.set_xlabel("frequency / Hz")
        if axis.lines[1:]:
            axis.legend(fontsize="x-small")
    axes[0, 0].set_ylabel("impedance felt / true")
    return drawn


def write_report(folder: Path, gains: Gains, results: Sequence[Result]) -> None:
    """Write delay.html and its figures felt_force and impedance, each as SVG and PNG."""
    save(felt_force_figure(results), folder, "felt_force")
    save(impedance_figure(results), folder, "impedance")
    won = winners(results)
    modes = sorted({r["mode"] for r in results})
    shares = [
        {"mode": mode, "environment": name, "share": f"{gain:.1f}"}
        for (mode, name), gain in gains.items()
    ]
    parts = [
        *(_of_mode(mode, results, won) for mode in modes),
        "<h2>Figures</h2>",
        figure("felt_force", "Error of the felt force, and share of stable cells, over the delay"),
        figure("impedance", "Impedance felt over true, at the longest delay that is stable"),
        "<h2>NRMSE of the felt force where every seed is stable</h2>",
        table([_place(one, modes) for one in won]),
        "<h2>Share of force reflected, the largest that is stable without delay</h2>",
        table(shares),
        "<h2>Every cell</h2>",
        table([_cell(r) for r in results]),
    ]
    wins = Counter(one["winner"] or "no mode" for one in won)
    headline = ", ".join(f"{mode} {count}" for mode, count in wins.most_common())
    headline_text = f"Least error of the felt force, of {len(won)} places: {headline}."
    write_page(folder / "delay.html", "What the operator feels under delay", parts, headline_text)


def _of_mode(mode: str, results: Sequence[Result], won: Sequence[Mapping[str, Any]]) -> str:
    own = [r for r in results if r["mode"] == mode]
    stable = sum(r["stable"] for r in own)
    wins = sum(one["winner"] == mode for one in won)
    return (
        f"<p>{mode}: stable in {stable} of {len(own)} cells, "
        f"the least error in {wins} of {len(won)} places.</p>"
    )


def _place(one: Mapping[str, Any], modes: Sequence[str]) -> dict[str, Any]:
    """Return a row of the table of who wins where."""
    errors = {mode: _number(one["nrmse"].get(mode)) for mode in modes}
    return {**_where(one), **errors, "winner": one["winner"] or "none"}


def _cell(one: Result) -> dict[str, Any]:
    """Return a row of the table of every cell."""
    return {
        "mode": one["mode"],
        **_where(one),
        "seed": str(one["seed"]),
        "verdict": "; ".join(one["unstable_because"]) or "stable",
        "NRMSE": _number(one["nrmse"]),
        "NRMSE, transient": _number(one["nrmse_transient"]),
        "lag / ms": "–" if one["lag_ms"] is None else f"{round(one['lag_ms'], 2) + 0.0:g}",
        "least energy / J": _number(one["energy_min_J"]),
        "models sent": str(one["models_sent"]),
    }


def _where(one: Mapping[str, Any]) -> dict[str, str]:
    trip, loss = f"{one['round_trip_ms']:.0f}", f"{one['loss']:.0%}"
    return {"environment": one["environment"], "round trip / ms": trip, "loss": loss}


def _by_trip(results: Sequence[Result], name: str) -> tuple[list[float], list[float]]:
    """Return round trips and the mean of a measure there; of the error, over stable cells."""
    trips = sorted({r["round_trip_ms"] for r in results})
    means = []
    for trip in trips:
        here = [r for r in results if r["round_trip_ms"] == trip]
        if name != "stable":
            here = [r for r in here if r["stable"] and r[name] is not None]
        means.append(mean(float(r[name]) for r in here) if here else math.nan)
    return trips, means


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
