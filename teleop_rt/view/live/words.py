"""The words of the live page as HTML: lamps, state chain, last fault."""

from __future__ import annotations

from html import escape

from teleop_rt.slave.faults import NO_FAULT, State
from teleop_rt.view.live.health import NO_TICK, Health, Lamp
from teleop_rt.view.quantities import SMALL, small
from teleop_rt.view.style import MARKS

CSS = """
.lamp { border: 1px solid var(--line); border-left: 8px solid var(--line); border-radius: 4px;
  padding: .4rem .7rem; background: var(--panel); min-height: 3.6rem; }
.lamp b { font-size: 1.05rem; } .lamp span { color: var(--faint); font-size: .88rem; }
.good { border-left-color: var(--good); } .good i { color: var(--good); }
.attention { border-left-color: var(--attention); } .attention i { color: var(--attention); }
.bad { border-left-color: var(--bad); background: var(--alarm); } .bad i { color: var(--bad); }
i { font-style: normal; font-weight: 700; }
.chain { display: flex; flex-wrap: wrap; gap: .3rem; }
.chain span { padding: .15rem .55rem; border: 1px solid var(--line); border-radius: 1rem;
  color: var(--faint); font-size: .85rem; }
.chain .now { background: var(--text); color: var(--ground); font-weight: 700; }
.chain .stop { background: var(--bad); color: var(--ground); }
.value { margin-right: .9rem; white-space: nowrap; font-size: 1.4rem; font-weight: 600;
  font-variant-numeric: tabular-nums; }
.faint { color: var(--faint); font-size: .88rem; }
"""
STOPPED = frozenset({State.SAFE_STOP, State.FAULT})


def lamp(found: Lamp) -> str:
    """Return a lamp: a sign and a colour, a title, and its explanation."""
    return (
        f'<div class="lamp {found.grade}" role="status"><i>{MARKS[found.grade]}</i> '
        f"<b>{escape(found.title)}</b><br><span>{escape(found.text)}</span></div>"
    )


def chain(state: State | None) -> str:
    """Return the safety chain with the present state marked."""
    links = []
    for one in State:
        kind = ("now stop" if one in STOPPED else "now") if one == state else ""
        current = ' aria-current="true"' if one == state else ""
        links.append(f'<span class="{kind}"{current}>{one.name}</span>')
    return f'<div class="chain" role="status">{"".join(links)}</div>'


def fault(found: Health) -> str:
    """Return the last fault with its next step; bad while it stands, a note after its reset."""
    if found.state is None:
        return lamp(Lamp("unknown", "no fault seen", NO_TICK))
    if found.fault == NO_FAULT:
        return lamp(Lamp("good", "no fault", "nothing has stopped the axis since the page began"))
    name = f"fault: {found.fault.name.replace('_', ' ')}"
    text = f"{found.fault.cause}. Next: {found.fault.next_step}."
    if found.state in STOPPED:
        return lamp(Lamp("bad", name, text))
    return lamp(Lamp("attention", f"last {name}", text))


def values(found: Health, position_unit: str, force_unit: str) -> str:
    """Return force and position as numbers; nothing before the first tick."""
    if found.state is None:
        return ""
    touching = "in contact" if found.in_contact else "free"
    return (
        f'<span class="value">{found.force:.2f} {force_unit}</span> '
        f'<span class="value">{SMALL * found.position:.3f} {small(position_unit)}</span> '
        f'<span class="faint">{touching}</span>'
    )
