"""The counterparts of the report's figures 4.1 to 4.4 and 4.6 to 4.9."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from teleop_rt.batch.workers import Result
from teleop_rt.study import figures
from teleop_rt.study.chapter4 import REPORTED
from teleop_rt.study.chapter4_plant import TRUTH, Sine
from teleop_rt.study.chapter4_silicone import CURVED, SHOWN
from teleop_rt.study.chapter4_statements import method_of
from teleop_rt.view import style

CAPTIONS = {
    "figure_4_1": "Position profile of the simulations (compare figure 4.1)",
    "figure_4_2": "Kelvin-Voigt: parameters over time, every frequency (figure 4.2)",
    "figure_4_3": "Hunt-Crossley: parameters over time, every frequency (figure 4.3)",
    "figure_4_4": "NRMSE of the force with the parameters of each moment (figure 4.4)",
    "figure_4_6": "Silicone cube on the rig: Kelvin-Voigt (figure 4.6)",
    "figure_4_7": "Silicone cube: Hunt-Crossley, rig and curved cube (figure 4.7)",
    "figure_4_8": "Force tracking with the final parameters' course (figure 4.8)",
    "figure_4_9": "NRMSE of open-loop predictions on the cubes (figure 4.9)",
}


def write_figures(folder: Path, simulated: Sequence[Result], pressed: Sequence[Result]) -> None:
    """Write every figure as PNG and SVG; those of the cubes where cubes were pressed."""
    figures.save(profile_figure(simulated), folder, "figure_4_1")
    figures.save(convergence_figure(simulated, "kelvin-voigt"), folder, "figure_4_2")
    figures.save(convergence_figure(simulated, "hunt-crossley"), folder, "figure_4_3")
    figures.save(error_figure(simulated), folder, "figure_4_4")
    if pressed:
        figures.save(silicone_figure(pressed[:1], "kelvin-voigt"), folder, "figure_4_6")
        figures.save(silicone_figure(pressed, "hunt-crossley"), folder, "figure_4_7")
        figures.save(tracking_figure(pressed), folder, "figure_4_8")
        figures.save(silicone_error_figure(pressed), folder, "figure_4_9")


def profile_figure(simulated: Sequence[Result]) -> Figure:
    """Draw the lowest, a middle and the highest frequency."""
    frequencies = sorted({one["frequency_hz"] for one in simulated})
    chosen = sorted({frequencies[0], frequencies[len(frequencies) // 2], frequencies[-1]})
    figure = figures.blank(1, 1, width=7.0)
    axes = figure.subplots()
    for i, frequency in enumerate(chosen):
        motion = Sine(frequency, duration_s=1.0).samples()
        axes.plot(motion.t, 1e3 * motion.x, color=style.COLOURS[i], linestyle=style.STYLES[i],
                  label=f"{frequency:g} Hz")  # fmt: skip
    axes.set(xlabel="time [s]", ylabel="penetration [mm]")
    figures.legend(figure, axes)
    return figure


def convergence_figure(simulated: Sequence[Result], model: str) -> Figure:
    """Draw each parameter (rows) by each method of table 4.1 (columns), a line per frequency."""
    cases = [one for one in simulated if one["model"] == model]
    names, methods = list(TRUTH[model]), REPORTED[model]
    figure = figures.blank(len(methods), len(names))
    axes = figure.subplots(len(names), len(methods), sharex=True, sharey="row", squeeze=False)
    for column, (regression, solver) in enumerate(methods):
        axes[0, column].set_title(style.method_name(regression, solver), fontsize="medium")
        axes[-1, column].set_xlabel("time [s]")
        for row, name in enumerate(names):
            panel, truth = axes[row, column], TRUTH[model][name]
            for i, one in enumerate(cases):
                values = method_of(one, (regression, solver))["trace"][name]
                panel.plot(
                    one["t_s"],
                    values,
                    color=style.COLOURS[i % 7],
                    linewidth=1.2,
                    linestyle=style.STYLES[i % 7],
                    label=f"{one['frequency_hz']:g} Hz",
                )
            panel.axhline(truth, **style.TRUTH_STYLE)
            panel.set(xscale="log", ylim=(-0.2 * truth, 2.2 * truth))
    for row, name in enumerate(names):
        axes[row, 0].set_ylabel(style.PARAMETER_LABELS[model][name])
    figures.legend(figure, axes[0, 0])
    return figure


def error_figure(simulated: Sequence[Result]) -> Figure:
    """Draw the error of the force over frequency for the three methods of figure 4.4."""
    figure = figures.blank(2, 1, width=3.6, height=2.8)
    axes = figure.subplots(1, 2, sharey=True)
    for panel, model in zip(axes, TRUTH, strict=True):
        cases = [one for one in simulated if one["model"] == model]
        for i, (regression, solver) in enumerate(SHOWN):
            errors = [method_of(one, (regression, solver))["nrmse_online"] for one in cases]
            panel.plot([one["frequency_hz"] for one in cases], errors, color=style.COLOURS[i],
                       linestyle=style.STYLES[i], marker=style.MARKERS[i],
                       label=style.method_name(regression, solver))  # fmt: skip
        panel.set(
            xscale="log", yscale="log", xlabel="frequency [Hz]", title=style.ABBREVIATED[model]
        )
    axes[0].set_ylabel("NRMSE [-]")
    figures.legend(figure, axes[0])
    return figure


def _true(specimen: str, model: str) -> dict[str, float]:
    """Return the parameters for which a line of the true value can be drawn."""
    return CURVED if (specimen, model) == ("curved", "hunt-crossley") else {}


def silicone_figure(pressed: Sequence[Result], model: str) -> Figure:
    """Draw each parameter (rows) on each cube (columns), a line per method."""
    names = list(TRUTH[model])
    figure = figures.blank(len(pressed), len(names), width=4.5)
    axes = figure.subplots(len(names), len(pressed), sharex=True, squeeze=False)
    for column, cube in enumerate(pressed):
        axes[0, column].set_title(_cube_name(cube), fontsize="medium")
        axes[-1, column].set_xlabel("time [s]")
        for row, name in enumerate(names):
            panel = axes[row, column]
            finals = []
            for i, (regression, solver) in enumerate(SHOWN):
                one = method_of(cube, (regression, solver), model)
                values = np.array(one["trace"][name], dtype=float)
                panel.plot(cube["t_s"], values, color=style.COLOURS[i], linestyle=style.STYLES[i],
                           linewidth=1.2, label=style.method_name(regression, solver))  # fmt: skip
                finals.append(one["final"][name])
            _limit(panel, finals)
            if name in (truth := _true(cube["specimen"], model)):
                panel.axhline(truth[name], **style.TRUTH_STYLE)
            panel.set_ylabel(style.PARAMETER_LABELS[model][name])
    figures.legend(figure, axes[0, 0])
    return figure


def _limit(panel: Axes, finals: Sequence[float]) -> None:
    """Keep a wild start from hiding where the methods end."""
    low, high = min(finals), max(finals)
    room = max(0.5 * (abs(low) + abs(high)) / 2, 0.6 * (high - low))
    panel.set_ylim(low - room, high + room)


def _cube_name(cube: Result) -> str:
    return "cube on the rig (linear)" if cube["specimen"] == "rig" else "curved cube (closed form)"


def tracking_figure(pressed: Sequence[Result]) -> Figure:
    """Draw force measured and by both models, on each cube (rows) by each method (columns)."""
    figure = figures.blank(len(SHOWN), len(pressed), width=3.6)
    axes = figure.subplots(len(pressed), len(SHOWN), sharey="row", squeeze=False)
    for row, cube in enumerate(pressed):
        t = cube["window"]["t_s"]
        for column, (regression, solver) in enumerate(SHOWN):
            panel = axes[row, column]
            panel.plot(t, cube["window"]["force"], color="black", linewidth=1.6, label="measured")
            for i, model in enumerate(TRUTH):
                values = method_of(cube, (regression, solver), model)["force"]
                panel.plot(t, np.array(values, dtype=float), color=style.COLOURS[i], linewidth=1.2,
                           linestyle=style.STYLES[i + 1],
                           label=style.ABBREVIATED[model])  # fmt: skip
            panel.set_title(f"{style.method_name(regression, solver)}", fontsize="medium")
        axes[row, 0].set_ylabel(f"{_cube_name(cube)}\nforce [N]", fontsize="small")
    for panel in axes[-1]:
        panel.set_xlabel("time [s]")
    figures.legend(figure, axes[0, 0])
    return figure


def silicone_error_figure(pressed: Sequence[Result]) -> Figure:
    """Draw the errors of both models by each method, a panel per cube."""
    figure = figures.blank(len(pressed), 1, width=4.2, height=2.8)
    axes = figure.subplots(1, len(pressed), sharey=True, squeeze=False)[0]
    for panel, cube in zip(axes, pressed, strict=True):
        for i, model in enumerate(TRUTH):
            errors = [method_of(cube, method, model)["nrmse"] for method in SHOWN]
            heights = [np.nan if error is None else error for error in errors]
            bars = panel.bar(
                np.arange(len(SHOWN)) + 0.38 * i,
                heights,
                0.36,
                color=style.COLOURS[i],
                hatch=("", "//")[i],
                edgecolor="white",
                label=style.ABBREVIATED[model],
            )
            panel.bar_label(bars, fmt="%.2g", fontsize="x-small")
        panel.set_xticks(np.arange(len(SHOWN)) + 0.19, [style.method_name(*m) for m in SHOWN])
        panel.tick_params(axis="x", labelsize="small")
        panel.set(yscale="log", title=_cube_name(cube))
    axes[0].set_ylabel("NRMSE [-]")
    figures.legend(figure, axes[0])
    return figure
