"""One figure for each of the studies of noise, varying parameters, excitation and approach."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from teleop_rt.study import figures
from teleop_rt.view import style

Row = dict[str, Any]
_INFINITE = 1e17
"""Height at which an infinite condition number is drawn."""


def draw(folder: Path, study: str, summary: Sequence[Row]) -> None:
    """Draw the summary of a study as PNG and SVG."""
    figures.save(_FIGURES[study](summary), folder, study.replace("-", "_"))


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [np.nan if row[name] is None else float(row[name]) for row in rows]


def _methods(summary: Sequence[Row]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row["regression"], row["solver"]) for row in summary))


def _noise(summary: Sequence[Row]) -> Figure:
    """Draw the error of b over the noise, a panel per model and lag, at the finest encoder."""
    finest = min(row["resolution_m"] for row in summary)
    models = list(dict.fromkeys(row["model"] for row in summary))
    lags = sorted({row["lag_ms"] for row in summary})
    figure = figures.blank(len(lags), len(models))
    axes = figure.subplots(len(models), len(lags), squeeze=False, sharex=True, sharey="row")
    for panels, model in zip(axes, models, strict=True):
        panels[0].set_ylabel(f"{style.ABBREVIATED[model]}\nerror of b [-]")
        for panel, lag in zip(panels, lags, strict=True):
            panel.set(title=f"lag {lag:g} ms", yscale="log")
            for i, method in enumerate(_methods(summary)):
                own = [row for row in summary if (row["model"], row["lag_ms"],
                       row["resolution_m"]) == (model, lag, finest)
                       and (row["regression"], row["solver"]) == method]  # fmt: skip
                _line(panel, i, [row["noise_N"] for row in own], _values(own, "error_b"), method)
    for panel in axes[-1]:
        panel.set_xscale("symlog", linthresh=0.01)
        panel.set_xlabel("force noise [N]")
    figures.legend(figure, axes[0, 0])
    return figure


def _line(
    panel: Any, i: int, x: Sequence[float], y: Sequence[float], method: tuple[str, str]
) -> None:
    """Draw one method: colour and marker by solver, dashes and no filling where algebraic."""
    algebraic = method[0] == "algebraic"
    panel.plot(
        x,
        y,
        color=style.COLOURS[i % 5],
        marker=style.MARKERS[i % 5],
        markersize=4,
        linewidth=1.1,
        linestyle="--" if algebraic else "-",
        fillstyle="none" if algebraic else "full",
        label=style.method_name(*method),
    )


def _time_varying(summary: Sequence[Row]) -> Figure:
    """Draw the delay behind each ramp by forgetting factor, at a middle frequency."""
    frequencies = sorted({row["frequency_hz"] for row in summary})
    middle = frequencies[len(frequencies) // 2]
    factors = sorted({row["forgetting_factor"] for row in summary}, reverse=True)
    figure = figures.blank(len(factors), 1, height=3.2)
    axes = figure.subplots(1, len(factors), squeeze=False, sharey=True)[0]
    for panel, factor in zip(axes, factors, strict=True):
        for i, method in enumerate(_methods(summary)):
            own = [row for row in summary
                   if (row["forgetting_factor"], row["frequency_hz"]) == (factor, middle)
                   and (row["regression"], row["solver"]) == method]  # fmt: skip
            _line(panel, i, [row["ramp_s"] for row in own], _values(own, "delay_s"), method)
        panel.set(title=f"λ = {factor:g}, {middle:g} Hz", xlabel="length of the ramp [s]")
        panel.set_yscale("symlog", linthresh=0.01)
        panel.set_ylim(bottom=0.0)
    axes[0].set_ylabel("tracking delay of k [s]")
    figures.legend(figure, axes[0])
    return figure


def _excitation(summary: Sequence[Row]) -> Figure:
    """Draw the condition number over amplitude, a panel per model, with and without bias."""
    models = list(dict.fromkeys(row["model"] for row in summary))
    frequencies = sorted({row["frequency_hz"] for row in summary})
    means = sorted({row["mean_m"] for row in summary})
    figure = figures.blank(len(models), 1, width=3.4, height=3.2)
    axes = figure.subplots(1, len(models), squeeze=False, sharey=True)[0]
    middle = frequencies[len(frequencies) // 2]
    for panel, model in zip(axes, models, strict=True):
        for i, mean in enumerate(means):
            for bias in (False, True):
                own = [row for row in summary if (row["model"], row["mean_m"], row["bias"],
                       row["frequency_hz"]) == (model, mean, bias, middle)]  # fmt: skip
                drawn = [_INFINITE if row["condition"] is None else row["condition"] for row in own]
                panel.plot([1e3 * row["amplitude_m"] for row in own], drawn,
                           color=style.COLOURS[i], marker=style.MARKERS[i],
                           linestyle="--" if bias else "-", fillstyle="none" if bias else "full",
                           label=f"{1e3 * mean:g} mm{', bias' if bias else ''}")  # fmt: skip
        panel.axhline(1e8, **style.TRUTH_STYLE)
        panel.set(title=f"{model}, {middle:g} Hz", xlabel="amplitude [mm]", yscale="log")
    axes[0].set_ylabel("condition number [-]")
    figures.legend(figure, axes[0])
    return figure


def _approach(summary: Sequence[Row]) -> Figure:
    """Draw the hand's lead over the round trip, a panel per speed of the hand."""
    speeds = sorted({row["hand_mm_per_s"] for row in summary})
    figure = figures.blank(len(speeds), 1, width=3.4, height=3.2)
    axes = figure.subplots(1, len(speeds), squeeze=False, sharey=True)[0]
    for panel, speed in zip(axes, speeds, strict=True):
        for i, leash in enumerate((True, False)):
            own = [r for r in summary if (r["hand_mm_per_s"], r["leash"]) == (speed, leash)]
            trips, leads = _values(own, "round_trip_ms"), _values(own, "lead_mm")
            name = "leash" if leash else "no brake"
            panel.plot(trips, leads, color=style.COLOURS[i], marker=style.MARKERS[i], label=name)
            never = [n for n, row in enumerate(own) if row["felt_s"] is None]
            panel.plot([trips[n] for n in never], [leads[n] for n in never], "kx", markersize=9)
        panel.set(title=f"hand at {speed:g} mm/s", xlabel="round trip [ms]", ylim=(0.0, None))
    axes[0].set_ylabel("lead [mm]")
    figures.legend(figure, axes[0])
    return figure


_FIGURES: Mapping[str, Callable[[Sequence[Row]], Figure]] = {
    "noise": _noise,
    "time-varying": _time_varying,
    "excitation": _excitation,
    "approach": _approach,
}
