"""The summary as people read it on a terminal: one table, with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from teleop_rt.config.parameter_words import (
    NO_DEVIATION,
    at_depth_in_words,
    beside,
    doubt_of,
    known,
    shown_unit,
    spread_in_words,
)
from teleop_rt.config.section import Units
from teleop_rt.estimation.report import KEYS, UNCERTAIN
from teleop_rt.metrics import in_percent
from teleop_rt.trial.felt_lines import (
    felt_lines,
    handle_lines,
    leash_lines,
    offset_lines,
    shown,
    step_in_words,
    unfelt_lines,
    worst_lines,
)
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
        nrmse = "not judged" if row["nrmse"] is None else shown(row["nrmse"], "", 3)
        settled = "not settled"
        if row["convergence_s"] is not None:
            settled = f"settled after {shown(row['convergence_s'], ' s', 3)}"
        status = row["status"] + (SURFACE_ANEW if row["status"] == UNCERTAIN else "")
        yield f"{mark} {name}: {status}, NRMSE {nrmse}, {settled}"
        for parameter, value in row["parameters"].items():
            if known(value["value"]):
                yield f"      {_parameter(parameter, value, row['regression'])}"
        if unknown := [n for n, value in row["parameters"].items() if not known(value["value"])]:
            yield f"      {', '.join(unknown)} –"
    if any(row["regression"] == "algebraic" for row in summary["estimators"]):
        yield f"  {NO_DEVIATION}"


def _parameter(name: str, parameter: Mapping[str, Any], regression: str) -> str:
    spread = spread_in_words(parameter["std"], regression)
    note = beside(at_depth_in_words(parameter)) + beside(doubt_of(parameter))
    unit = "" if parameter["unit"] == "1" else f" {shown_unit(parameter['unit'])}"
    return f"{name} = {shown(parameter['value'], '', 5)}{spread}{unit}{note}"


def packets_in_words(link: Mapping[str, Any]) -> str:
    """Return the fate of the master's packets; a process that died has counted none."""
    if link["received"] is None:
        return "the slave's counts of packets are not known"
    refused = "an unknown number" if link["refused"] is None else link["refused"]
    return (
        f"of the master's packets {link['received']} came, {link['lost']} were lost, "
        f"{link['overtaken']} came after a newer one, {refused} were refused"
    )


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


def _missed(summary: Mapping[str, Any]) -> str:
    """Return how many ticks were missed, with the share that is good where it is exceeded."""
    missed = summary["missed_ticks"]
    if missed is None or missed <= MISSED_SHARE * summary["ticks"]:
        return f"{missed} missed"
    return f"{missed} missed (good: at most {1e3 * MISSED_SHARE:g} of 1000)"


def _contacts(contact: Mapping[str, Any]) -> str:
    """Return the number of contacts; a touch that was too short for one is not passed over."""
    if (brief := contact.get("brief_touch_ms")) is not None:
        return f"no contact, but a touch of {shown(brief, ' ms', 3)}"
    return f"{contact['onsets']} contact" + ("" if contact["onsets"] == 1 else "s")


def _notes(summary: Mapping[str, Any]) -> list[str]:
    """Return the notes and the reasons of both parts, but for that of the line on the model."""
    parts = [summary["contact"], summary["master"]] if summary["selected"] else [summary["master"]]
    return [*summary["notes"], *(part["reason"] for part in parts if "reason" in part)]


def _lines(summary: Mapping[str, Any], units: Units) -> list[tuple[str, str]]:
    contact, link, master = summary["contact"], summary["link"], summary["master"]
    scale, small = (1e3, " mm") if units.position == "m" else (1e3, " mrad")
    surface = " / ".join(
        shown(None if value is None else value * scale, small, 5)
        for value in (contact["surface_found"], contact["surface_true"])
    )
    safety = summary["safety"]
    reported = f": {safety['fault']['said']}" if safety["fault"].get("said") else ""
    planned = f" of {summary['planned_s']:g}" if is_short(summary) else ""
    ran = f"{summary['duration_s']:.2f}{planned} s on the {summary['clock']} clock"
    ran += f", {summary['ticks']} ticks"
    early = ", interrupted" if summary.get("interrupted") else ""
    round_trip = shown(link["round_trip_ms"], " ms", 4)
    lines = [
        *_start_up(summary),
        ("ran", f"{ran}, {_missed(summary)}{early}"),
        *_on_time(summary),
        ("surface found / true", f"{surface}, {_contacts(contact)}"),
        *felt_lines(master),
        *handle_lines(master, units),
        *unfelt_lines(master, units),
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
