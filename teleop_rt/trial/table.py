"""The summary as people read it on a terminal: one table, with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from teleop_rt.config.section import Units
from teleop_rt.config.shown_unit import shown_unit
from teleop_rt.estimation.report import KEYS, UNCERTAIN
from teleop_rt.metrics import in_percent
from teleop_rt.trial.grades import (
    GRADE_COLOURS,
    MARKS,
    MISSED_SHARE,
    grades,
    is_short,
    of_error,
    of_fault,
    selected_nrmse,
)
from teleop_rt.trial.late import on_hardware, privileges_text, stalls
from teleop_rt.trial.softened import calmed, softened, unfollowed

_GRADED = {
    "ran": "loop",
    "felt force: NRMSE": "felt_force",
    "felt force: in free air": "phantom",
    "surface: worst error": "surface",
    "model": "model",
    "link": "link",
    "safety": "end",
    "missing safeguard": "safety",
}
"""Which line of the table shows which grade."""

UNSAFE_STEP = (
    "; unsafe_i_know in the rig's file allows it: on hardware fit it, or keep out of reach"
)
SURFACE_ANEW = " since the surface was found elsewhere"


def print_summary(console: Console, summary: Mapping[str, Any], units: Units) -> None:
    """Print the summary of a run; the cause of a stop comes first."""
    fault = summary["safety"]["fault"]
    if fault["code"] != 0:
        console.print(
            f"[bold red]stopped[/bold red]: {fault['cause']}; {fault['next_step']}",
            highlight=False, soft_wrap=True,
        )  # fmt: skip
    console.print(f"[bold]{summary['trial']}[/bold]: estimators (* is selected)")
    for line in estimator_lines(summary):
        console.print(line, highlight=False, soft_wrap=True)
    table = Table(show_header=False, box=None, pad_edge=False)
    graded = grades(summary) | {"end": of_fault(summary["safety"])}
    for name, value in _lines(summary, units):
        grade = graded.get(_GRADED.get(name, ""))
        mark = "" if grade is None else f"[{GRADE_COLOURS[grade]}]{MARKS[grade]}[/]"
        table.add_row(mark, f"[bold]{name}[/bold]", value)
    with console.capture() as drawn:
        console.print(table, soft_wrap=True)
    for line in drawn.get().splitlines():  # a table fills every line up to its longest
        console.out(line.rstrip(), highlight=False)


def estimator_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Give one line per estimator and parameter of a summary or a replay."""
    selected = summary["selected"] or {}
    for row in summary["estimators"]:
        mark = "*" if all(selected.get(key) == row.get(key) for key in KEYS) else " "
        name = ", ".join(row[key] for key in KEYS[:3])
        name += f", effects {row['effects']}" if row.get("effects") else ""
        nrmse = "not judged" if row["nrmse"] is None else _number(row["nrmse"], "", 3)
        settled = "not settled"
        if row["convergence_s"] is not None:
            settled = f"settled after {_number(row['convergence_s'], ' s', 3)}"
        status = row["status"] + (SURFACE_ANEW if row["status"] == UNCERTAIN else "")
        yield f"{mark} {name}: {status}, NRMSE {nrmse}, {settled}"
        for parameter, value in row["parameters"].items():
            if value["value"] is not None:
                yield f"      {_parameter(parameter, value)}"


def _parameter(name: str, parameter: Mapping[str, Any]) -> str:
    std = parameter["std"]
    spread = "" if std is None else f" ± {float(f'{std:.2g}'):g}"
    note = " (not identified)" if parameter.get("identified") is False else ""
    unit = "" if parameter["unit"] == "1" else f" {shown_unit(parameter['unit'])}"
    return f"{name} = {_number(parameter['value'], '', 5)}{spread}{unit}{note}"


def packets_in_words(link: Mapping[str, Any]) -> str:
    """Return the fate of the master's packets; a process that died has counted none."""
    if link["received"] is None:
        return "the slave's counts of packets are not known"
    refused = "an unknown number" if link["refused"] is None else link["refused"]
    return (
        f"of the master's packets {link['received']} came, {link['lost']} were lost, "
        f"{link['overtaken']} came after a newer one, {refused} were refused"
    )


def _number(value: float | None, unit: str, digits: int) -> str:
    return "not known" if value is None else f"{value:.{digits}g}{unit}"


def model_in_words(summary: Mapping[str, Any]) -> str:
    """Return the line on the selected model: the reason of its grade, whichever it is."""
    if not summary["selected"]:
        return f"none selected: {summary['contact'].get('reason', 'no contact')}"
    error, adequacy = selected_nrmse(summary), summary["adequacy"]
    said, grade = _adequacy(adequacy), of_error(error)
    if error is not None and grade != "good":
        missed = f"misses the force by {in_percent(error)} of its range"
        unseen = grade == "bad" and not adequacy["inadequate"]
        return f"inadequate: it {missed}" if unseen else f"{said}; {missed}"
    return said


def _adequacy(adequacy: Mapping[str, Any]) -> str:
    if adequacy["inadequate"] is None:
        return "not judged: too little contact"
    if adequacy["inadequate"]:
        return f"inadequate, since {adequacy['first_raised_s']:.1f} s"
    if adequacy["raised"]:
        return f"adequate at the end, inadequate from {adequacy['first_raised_s']:.1f} s for a time"
    return "adequate"


def _on_time(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Give the lines that only the machine's clock has: stalls, and the loop's privileges."""
    late = summary.get("late")
    if late is None or summary["clock"] == "simulated":
        return
    yield "longest stall", stalls(late)
    yield "on hardware", on_hardware(late)
    if summary["privileges"]:
        yield "privileges", privileges_text(summary["privileges"])


def _start_up(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Give the line that only a run on the machine's clock has."""
    if (seconds := summary.get("start_up_s")) is not None:
        yield "first tick", f"{seconds:.1f} s after the command"


def _handle(master: Mapping[str, Any], units: Units) -> Iterator[tuple[str, str]]:
    """Give the true force on a simulated hand, and the stiffest wall that its device can render."""
    if (port := master.get("true_port")) is None:
        return
    error, lag = _number(port["motor_nrmse"], "", 3), _number(port["motor_lag_ms"], " ms", 3)
    yield "at the device's true port", f"NRMSE {error}, lag {lag}"
    passivity = master["rendering"]["passivity"]
    stiffness = passivity["stiffness"]
    unit, of_damping = f"{units.force}/{units.position}", f" {units.force} s/{units.position}"
    most, rendered, true = (
        f"{float(f'{value:.4g}'):g}"
        for value in (passivity["stiffness_max"], stiffness["rendered"], stiffness["true"])
    )
    needed = _number(passivity["required_damping"], of_damping, 3)
    said = (
        f"{rendered} of the wall's {true} {unit}; a wall without damping could have {most} {unit}"
    )
    yield "rendered stiffness", f"{said}, and this one needs a device damping of {needed}"


def _unfelt(master: Mapping[str, Any], units: Units) -> Iterator[tuple[str, str]]:
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
            most = _number(felt["phantom_force"], f" {units.force}", 3)
            phantom = f"at most {most} (at {felt['phantom_s']:.1f} s)"
        error = _number(felt["force_error"], f" {units.force}", 3)
        largest = f"largest error since the first touch {error} (at {felt['force_error_s']:.1f} s)"
        yield "felt force: in free air", f"{phantom}; {largest}"
    if met.get("surface_error") is not None:
        scale, small = (1e3, " mm") if units.position == "m" else (1e3, " mrad")
        error = _number(scale * met["surface_error"], small, 3)
        yield "surface: worst error", f"{error} (at {met['surface_error_s']:.1f} s)"


def step_in_words(master: Mapping[str, Any], units: Units) -> str:
    """Return the largest step of the felt force, and that of new models, which the trial limits."""
    unit = f" {units.force}"
    largest = _number(master["largest_force_step"], unit, 3)
    adoption = (master.get("rendering") or {}).get("adoption")
    if adoption is None:
        return largest
    return f"{largest}, by a new model at most {_number(adoption['largest_force_step'], unit, 3)}"


def offset_lines(master: Mapping[str, Any], units: Units) -> Iterator[tuple[str, str]]:
    """Give how far from its true place the wall is felt."""
    if (offset := master.get("offset")) is None:  # earlier summaries have none
        return
    scale, small = (1e3, " mm") if units.position == "m" else (1e3, " mrad")
    largest, end = (_number(scale * offset[key], small, 3) for key in ("largest", "at_end"))
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
    lead = _number(scale * handle["longest_lead"], small, 3)
    held = f"up to {_number(force, f' {units.force}', 3)} in free air held the hand back"
    yield "leash", f"{held}, which led the tool by up to {lead} before the first touch"


def _missed(summary: Mapping[str, Any]) -> str:
    """Return how many ticks were missed, with the share that is good where it is exceeded."""
    missed = summary["missed_ticks"]
    if missed is None or missed <= MISSED_SHARE * summary["ticks"]:
        return f"{missed} missed"
    return f"{missed} missed (good: at most {1e3 * MISSED_SHARE:g} of 1000)"


def felt_lines(master: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Give error and lag of the felt force, in words where they are not known."""
    error, lag = _number(master["nrmse"], "", 3), _number(master["lag_ms"], " ms", 3)
    direct = master["direct_reflection_lag_ms"]
    yield "felt force: NRMSE", "not judged" if master["nrmse"] is None else error
    if master["lag_ms"] is None and direct is None:
        yield "felt force: lag", "not judged"
    else:
        lag = "not judged" if master["lag_ms"] is None else lag
        reflected = "not judged" if direct is None else _number(direct, " ms", 4)
        yield "felt force: lag", f"{lag}, direct reflection {reflected}"


def _contacts(contact: Mapping[str, Any]) -> str:
    """Return the number of contacts; a touch that was too short for one is not passed over."""
    if (brief := contact.get("brief_touch_ms")) is not None:
        return f"no contact, but a touch of {_number(brief, ' ms', 3)}"
    return f"{contact['onsets']} contact" + ("" if contact["onsets"] == 1 else "s")


def _notes(summary: Mapping[str, Any]) -> list[str]:
    """Return the notes and the reasons of both parts, but for that of the line on the model."""
    parts = [summary["contact"], summary["master"]] if summary["selected"] else [summary["master"]]
    return [*summary["notes"], *(part["reason"] for part in parts if "reason" in part)]


def _lines(summary: Mapping[str, Any], units: Units) -> list[tuple[str, str]]:
    contact, link, master = summary["contact"], summary["link"], summary["master"]
    scale, small = (1e3, " mm") if units.position == "m" else (1e3, " mrad")
    surface = " / ".join(
        _number(None if value is None else value * scale, small, 5)
        for value in (contact["surface_found"], contact["surface_true"])
    )
    safety = summary["safety"]
    reported = f": {safety['fault']['said']}" if safety["fault"].get("said") else ""
    planned = f" of {summary['planned_s']:g}" if is_short(summary) else ""
    ran = f"{summary['duration_s']:.2f}{planned} s on the {summary['clock']} clock"
    ran += f", {summary['ticks']} ticks"
    early = ", interrupted" if summary.get("interrupted") else ""
    round_trip = _number(link["round_trip_ms"], " ms", 4)
    lines = [
        *_start_up(summary),
        ("ran", f"{ran}, {_missed(summary)}{early}"),
        *_on_time(summary),
        ("surface found / true", f"{surface}, {_contacts(contact)}"),
        *felt_lines(master),
        *_handle(master, units),
        *_unfelt(master, units),
        *worst_lines(summary, units),
        *offset_lines(master, units),
        *leash_lines(master, units),
        ("largest force step", step_in_words(master, units)),
        ("model", model_in_words(summary)),
        ("link", packets_in_words(link)),
        ("round trip", round_trip),
        ("safety", f"{safety['state']}, {safety['fault']['name']}{escape(reported)}"),
        *(("missing safeguard", one + UNSAFE_STEP) for one in safety.get("unsafe") or ()),
    ]
    for key in ("wake_latency_us", "work_us"):
        if (spread := summary[key]) is not None:
            text = f"p50 {spread['p50']:.0f}, p99 {spread['p99']:.0f}, max {spread['max']:.0f} us"
            lines.append((key.removesuffix("_us").replace("_", " "), text))
    return [*lines, *(("note", note) for note in _notes(summary))]
