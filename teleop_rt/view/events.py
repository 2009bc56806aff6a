"""The events of a run in words, from its log and the stamps of its recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from teleop_rt.config.section import Units
from teleop_rt.view.quantities import small_position, stiffness_units
from teleop_rt.view.style import number

_MOST_LINES = 200
"""Lines of a page's table."""


Words = Callable[[Mapping[str, Any], Units], str]
"""(event, units of the rig) -> text of a line."""


def event_rows(
    events: Iterable[Mapping[str, Any]], start_ns: float, units: Units
) -> list[dict[str, str]]:
    """Return `{time, grade, event, text}` of each event worth reading, in order of time.

    Adoptions of a new wall are many and say little alone: the figure of energy shows them. That
    nothing arrives is no news before the first tick of the slave, which is started last.
    """
    rows = []
    for event in events:
        kind = str(event["event"])
        words = _WORDS.get(kind)
        if words is None:
            continue
        stamp = event.get("stamp_ns")
        seconds = None if stamp is None else (float(stamp) - start_ns) * 1e-9
        if event.get("trouble") == "nothing" and seconds is not None and seconds < 0.0:
            continue
        rows.append((seconds, kind, words(event, units)))
    rows.sort(key=lambda row: float("inf") if row[0] is None else row[0])
    return [
        {
            "time": "" if seconds is None else f"{seconds:.3f} s",
            "grade": _GRADES.get(kind, "unknown"),
            "event": kind,
            "text": text,
        }
        for seconds, kind, text in rows[:_MOST_LINES]
    ]


def _contact(event: Mapping[str, Any], units: Units) -> str:
    surface = event.get("surface")
    where = (
        "" if surface is None else f", surface at {small_position(float(surface), units.position)}"
    )
    return f"contact {event['contact_id']}{where}"


def _engagement(event: Mapping[str, Any], _units: Units) -> str:
    state = str(event["state"]).lower()
    quiet = state in {"frozen", "declutched"}
    return f"master: {state}" + (f", {event['silence_ms']:.0f} ms without news" if quiet else "")


def _passivity(event: Mapping[str, Any], units: Units) -> str:
    stiffness, damping = (
        f"{name} {number(event[f'rendered_{name}'])} of {number(event[f'true_{name}'])} {unit}"
        for name, unit in stiffness_units(units).items()
    )
    return f"the operator's device cannot render this wall passively: {stiffness}, {damping}"


_GRADES = dict.fromkeys(("fault", "device"), "bad") | dict.fromkeys(
    ("alarm", "link", "model inadequate", "models refused", "output", "passivity", "restart"),
    "attention",
)
_WORDS: Mapping[str, Words] = {
    "state": lambda event, _units: str(event["state"]),
    "fault": lambda event, _units: f"{event['fault']}: {event['cause']}; {event['next_step']}",
    "device": lambda event, _units: str(event["said"]),
    "contact": _contact,
    "link": lambda event, _units: f"{event['trouble']}: {event['cause']}",
    "passivity": _passivity,
    "engagement": _engagement,
    "models refused": lambda _event, _units: (
        "the slave streams models that are not fit to be rendered: "
        "see master.rendering.refused_models in summary.json"
    ),
    "model inadequate": lambda _event, _units: "the selected model leaves structure in the force",
    "model adequate": lambda _event, _units: "the selected model explains the force again",
    "alarm": lambda event, _units: str(event["alarm"]),
    "restart": lambda event, _units: (
        f"the {event['name']} {event['last_end']}, and was started again"
    ),
    "output": lambda event, _units: str(event["text"]),
}
