"""The lines of the summary on the force that the hand felt, and on the wall under it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from teleop_rt.config.section import Units
from teleop_rt.trial.softened import calmed, softened, unfollowed


def shown(value: float | None, unit: str, digits: int) -> str:
    """Return a value with its unit and so many digits."""
    return "not known" if value is None else f"{value:.{digits}g}{unit}"


def felt_lines(master: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Give error and lag of the felt force, in words where they are not known."""
    error, lag = shown(master["nrmse"], "", 3), shown(master["lag_ms"], " ms", 3)
    direct = master["direct_reflection_lag_ms"]
    yield "felt force: NRMSE", "not judged" if master["nrmse"] is None else error
    if master["lag_ms"] is None and direct is None:
        yield "felt force: lag", "not judged"
    else:
        lag = "not judged" if master["lag_ms"] is None else lag
        reflected = "not judged" if direct is None else shown(direct, " ms", 4)
        yield "felt force: lag", f"{lag}, direct reflection {reflected}"


def handle_lines(master: Mapping[str, Any], units: Units) -> Iterator[tuple[str, str]]:
    """Give the true force on a simulated hand, and the stiffest wall that its device can render."""
    if (port := master.get("true_port")) is None:
        return
    error, lag = shown(port["motor_nrmse"], "", 3), shown(port["motor_lag_ms"], " ms", 3)
    yield "at the device's true port", f"NRMSE {error}, lag {lag}"
    passivity = master["rendering"]["passivity"]
    stiffness = passivity["stiffness"]
    unit, of_damping = f"{units.force}/{units.position}", f" {units.force} s/{units.position}"
    most, rendered, true = (
        f"{float(f'{value:.4g}'):g}"
        for value in (passivity["stiffness_max"], stiffness["rendered"], stiffness["true"])
    )
    needed = shown(passivity["required_damping"], of_damping, 3)
    said = (
        f"{rendered} of the wall's {true} {unit}; a wall without damping could have {most} {unit}"
    )
    yield "rendered stiffness", f"{said}, and this one needs a device damping of {needed}"


def unfelt_lines(master: Mapping[str, Any], units: Units) -> Iterator[tuple[str, str]]:
    """Give the lines of a tool that pressed harder than was felt, by their cause."""
    if (said := softened(master, units)) is not None:
        yield "stiff wall", said
    if (said := calmed(master, units)) is not None:
        yield "damped wall", said
    if (said := unfollowed(master, units)) is not None:
        yield "wall not followed", said


def worst_lines(summary: Mapping[str, Any], units: Units) -> Iterator[tuple[str, str]]:
    """Give the worst of the whole run, which no mean shows."""
    felt, met = summary["master"].get("worst"), summary["contact"].get("worst") or {}
    if felt is not None and felt["force_error"] is not None:
        phantom = "not judged" if felt["phantom_force"] is None else "none"
        if (felt["phantom_force"] or 0.0) > 0.0:
            most = shown(felt["phantom_force"], f" {units.force}", 3)
            phantom = f"at most {most} (at {felt['phantom_s']:.1f} s)"
        error = shown(felt["force_error"], f" {units.force}", 3)
        largest = f"largest error since the first touch {error} (at {felt['force_error_s']:.1f} s)"
        yield "felt force: in free air", f"{phantom}; {largest}"
    if met.get("surface_error") is not None:
        scale, small = (1e3, " mm") if units.position == "m" else (1e3, " mrad")
        error = shown(scale * met["surface_error"], small, 3)
        yield "surface: worst error", f"{error} (at {met['surface_error_s']:.1f} s)"


def offset_lines(master: Mapping[str, Any], units: Units) -> Iterator[tuple[str, str]]:
    """Give how far from its true place the wall is felt."""
    if (offset := master.get("offset")) is None:  # earlier summaries have none
        return
    scale, small = (1e3, " mm") if units.position == "m" else (1e3, " mrad")
    largest, end = (shown(scale * offset[key], small, 3) for key in ("largest", "at_end"))
    yield (
        "felt wall: offset",
        f"at most {largest} (at {offset['largest_s']:.1f} s), {end} at the end",
    )


def leash_lines(master: Mapping[str, Any], units: Units) -> Iterator[tuple[str, str]]:
    """Give the line of the leash, where it held the hand back: a force in free air is its own."""
    handle = (master.get("rendering") or {}).get("handle") or {}
    if not (force := handle.get("largest_leash_force")):  # earlier summaries have none
        return
    scale, small = (1e3, " mm") if units.position == "m" else (1e3, " mrad")
    lead = shown(scale * handle["longest_lead"], small, 3)
    held = f"up to {shown(force, f' {units.force}', 3)} in free air held the hand back"
    yield "leash", f"{held}, which led the tool by up to {lead} before the first touch"


def step_in_words(master: Mapping[str, Any], units: Units) -> str:
    """Return the largest step of the felt force, and that of new models, which the trial limits."""
    unit = f" {units.force}"
    largest = shown(master["largest_force_step"], unit, 3)
    adoption = (master.get("rendering") or {}).get("adoption")
    if adoption is None:
        return largest
    return f"{largest}, by a new model at most {shown(adoption['largest_force_step'], unit, 3)}"
