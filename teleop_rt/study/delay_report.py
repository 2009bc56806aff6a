"""Figures and page of the delay study: where each mode wins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from statistics import mean

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from teleop_rt.batch.workers import Result
from teleop_rt.study.delay import Gains, winners

_MEASURES = (
    ("nrmse", "NRMSE of felt force"),
    ("stable", "share of stable cells"),
)


def write_report(folder: Path, gains: Gains, results: Sequence[Result]) -> None:
    """Write delay.html and its figures felt_force.svg and impedance.svg."""
    _save(felt_force_figure(results), folder / "felt_force.svg")
    _save(impedance_figure(results), folder / "impedance.svg")
    (folder / "delay.html").write_text(page(gains, results), encoding="utf-8")


def felt_force_figure(results: Sequence[Result]) -> Figure:
    """Draw error of the felt force and share of stable cells over the round trip."""
    environments = sorted({r["environment"] for r in results})
    figure = Figure(figsize=(3.2 * len(environments), 5.5), layout="constrained")
    axes = figure.subplots(2, len(environments), squeeze=False, sharex=True, sharey="row")
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
    return figure


def impedance_figure(results: Sequence[Result]) -> Figure:
    """Draw impedance felt over true by frequency, for each mode at the longest stable delay."""
    modes = sorted({r["mode"] for r in results})
    figure = Figure(figsize=(3.2 * len(modes), 3.2), layout="constrained")
    axes = figure.subplots(1, len(modes), squeeze=False, sharey=True)
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
    return figure


def page(gains: Gains, results: Sequence[Result]) -> str:
    """Return the page: the figures, who wins where, gains, and why the unstable are unstable."""
    won = winners(results)
    modes = sorted({r["mode"] for r in results})
    body = ["<h1>What the operator feels under delay</h1>"]
    for mode in modes:
        own = [r for r in results if r["mode"] == mode]
        stable = sum(r["stable"] for r in own)
        wins = sum(w["winner"] == mode for w in won)
        body.append(
            f"<p>{mode}: stable in {stable} of {len(own)} cells, "
            f"the least error in {wins} of {len(won)} places.</p>"
        )
    body.append('<p><img src="felt_force.svg" alt="felt force over round trip"></p>')
    body.append('<p><img src="impedance.svg" alt="impedance felt over true"></p>')
    body.append("<h2>NRMSE of the felt force where every seed is stable</h2>")
    rows = [
        [w["environment"], f"{w['round_trip_ms']:.0f}", f"{w['loss']:.0%}"]
        + [_number(w["nrmse"].get(mode)) for mode in modes]
        + [w["winner"] or "none"]
        for w in won
    ]
    body.append(_table(["environment", "round trip / ms", "loss", *modes, "winner"], rows))
    body.append("<h2>Share of force reflected, the largest that is stable without delay</h2>")
    shares = [[mode, name, f"{gain:.1f}"] for (mode, name), gain in gains.items()]
    body.append(_table(["mode", "environment", "share"], shares))
    body.append("<h2>Every cell</h2>")
    cells = [
        [r["mode"], r["environment"], f"{r['round_trip_ms']:.0f}", f"{r['loss']:.0%}",
         str(r["seed"]), "; ".join(r["unstable_because"]) or "stable", _number(r["nrmse"]),
         _number(r["nrmse_transient"]), _number(r["lag_ms"]), _number(r["energy_min_J"]),
         str(r["models_sent"])]
        for r in results
    ]  # fmt: skip
    header = ["mode", "environment", "round trip / ms", "loss", "seed", "verdict", "NRMSE"]
    header += ["NRMSE, transient", "lag / ms", "least energy / J", "models sent"]
    body.append(_table(header, cells))
    style = "body{font-family:sans-serif;margin:2em}td,th{padding:.1em .6em;text-align:left}"
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Delay study</title>'
        f"<style>{style}img{{max-width:100%}}</style><body>{''.join(body)}</body></html>\n"
    )


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
    return "-" if value is None else f"{value:.3g}"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in header) + "</tr>"]
    lines += [
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    ]
    return f"<table>{''.join(lines)}</table>"


def _save(figure: Figure, path: Path) -> None:
    FigureCanvasSVG(figure)
    figure.savefig(path)
