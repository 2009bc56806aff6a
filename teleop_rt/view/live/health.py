"""State, fault, residual, loop and link in words and lamps, from the last rows of each side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from teleop_rt.link.troubles import NOTHING_TROUBLE, SILENT_TROUBLE, TROUBLES
from teleop_rt.master.engagement import LinkState
from teleop_rt.metrics import in_percent
from teleop_rt.slave.faults import FAULTS, NO_FAULT, Fault, State
from teleop_rt.slave.simulated_advice import next_step_of
from teleop_rt.trial.grades import Grade, of_link, of_loop
from teleop_rt.view.delay import one_way_delays
from teleop_rt.view.live.source import About
from teleop_rt.view.residual import INADEQUATE, NOTABLE, Whiteness, verdict, whiteness
from teleop_rt.view.style import count_in_words

Array = NDArray[np.float64]
Columns = Mapping[str, Array]
_STALE_S = 1.0
"""Age of the newest sample from which the page reports it."""
NO_TICK = "no tick of the slave yet"
FROZEN, DECLUTCHED = "link: frozen", "link: declutched"
_COUNTS = (
    ("refused_models", "model refused", "models refused"),
    ("freezes", "freeze", "freezes"),
    ("declutches", "declutch", "declutches"),
)


@dataclass(frozen=True, slots=True)
class Lamp:
    """One lamp: a grade (good, attention, bad or unknown), a title and the words beside it."""

    grade: Grade
    title: str
    text: str = ""


@dataclass(frozen=True, slots=True)
class Health:
    """Everything that has a lamp, and the last fault, which stays until another one comes."""

    state: State | None = None
    fault: Fault = NO_FAULT
    model: Lamp = Lamp("unknown", "model not judged", NO_TICK)
    loop: Lamp = Lamp("unknown", "loop", NO_TICK)
    link: Lamp = Lamp("unknown", "link", NO_TICK)
    whiteness: Whiteness | None = None
    in_contact: bool = False
    force: float = float("nan")
    position: float = float("nan")
    selected: int = -1


def health(about: About, columns: Mapping[str, Columns], before: Health) -> Health:
    """Return the state of everything; `columns` are the last rows of /slave and /master."""
    slave, master = columns["/slave"], columns.get("/master", {})
    code = int(slave["fault"][-1])
    fault = FAULTS.get(code, Fault(code, f"fault {code}", "unknown here", "read log.jsonl"))
    fault = replace(fault, next_step=next_step_of(fault, simulated=about.simulated))
    residual = np.where(
        slave["in_contact"] > 0, slave["filtered_force"] - slave["predicted_force"], np.nan
    )
    found = whiteness(residual, about.period_s, about.cutoff_hz)
    selected = slave["selected"][-1]
    return Health(
        state=State(int(slave["state"][-1])),
        fault=fault if code else before.fault,
        model=_model(about, slave, found),
        loop=_loop(about, slave),
        link=_link(slave, master),
        whiteness=found,
        in_contact=bool(slave["in_contact"][-1] > 0),
        force=float(slave["force"][-1]),
        position=float(slave["position"][-1]),
        selected=int(selected) if np.isfinite(selected) else before.selected,
    )


def _model(about: About, slave: Columns, found: Whiteness | None) -> Lamp:
    """Return the lamp of the model: the daemon's own word, where it gives one."""
    flags = slave.get("inadequate")
    inadequate = None if flags is None else bool(flags[-1] > 0)
    if found is None and not inadequate:
        return Lamp("unknown", "model not judged", "too little contact in the last 10 s")
    if found is None:
        return Lamp("attention", INADEQUATE, "structure is left in the force")
    judged = verdict(found, about.force_noise, about.force_unit, inadequate)
    text = judged["text"].partition(";")[0]
    if inadequate is False and not found.white and found.rms > NOTABLE * about.force_noise:
        text = f"of late; over ten seconds, {text}"  # the daemon looks at the last one alone
    return Lamp(judged["grade"], judged["title"], text)


def _loop(about: About, slave: Columns) -> Lamp:
    ticks = slave["tick"]
    missed = int(ticks[-1] - ticks[0]) + 1 - ticks.size
    rate = f"{1.0 / about.period_s:.0f} Hz"
    gap_ms = (float(np.max(np.diff(ticks), initial=1.0)) - 1.0) * about.period_s * 1e3
    words = [f"{missed} of the last {int(ticks[-1] - ticks[0]) + 1} ticks missed"]
    words[0] += f", at most {gap_ms:.3g} ms in a row" if missed else ""
    for name in ("wake_latency_us", "work_us"):
        known = slave[name][np.isfinite(slave[name])]
        if known.size:
            p50, p99 = np.quantile(known, [0.5, 0.99])
            label = name.removesuffix("_us").replace("_", " ")
            words.append(f"{label} p50 {p50:.0f}, p99 {p99:.0f}, max {known.max():.0f} µs")
    if len(words) == 1:
        words.append("simulated clock")
    missing = int(slave["missing"][-1])
    if missing:
        return Lamp("bad", f"{rate}, no sample for {missing} cycles", "; ".join(words))
    return Lamp(of_loop(missed, ticks.size + missed), f"loop at {rate}", "; ".join(words))


def _link(slave: Columns, master: Columns) -> Lamp:
    if not master:
        return Lamp("unknown", "no master seen here", "this machine records the slave alone")
    if lamp := _troubled(slave, master):
        return lamp
    behind_s = (slave["stamp_ns"][-1] - master["stamp_ns"][-1]) * 1e-9
    if behind_s > _STALE_S:
        return Lamp("bad", "master silent", f"nothing from it for {behind_s:.0f} s")
    delays = one_way_delays(slave, master)
    if delays is None or delays.median_ms is None:
        return Lamp("unknown", "link", "no model has arrived yet")
    untaken = int(np.count_nonzero(~np.isfinite(delays.delay_ms)))
    jitter = "" if delays.jitter_ms is None else f"jitter {delays.jitter_ms:.2g} ms"
    title = f"link: {delays.median_ms:.3g} ms one way"
    sent = count_in_words(delays.sent_ns.size, "model")
    came = f"{delays.sent_ns.size - untaken} of {sent} arrived"
    words = ", ".join(filter(None, (came, jitter, _troubles(slave, master))))
    link = {"received": _last(master, "packets_received"), "lost": _last(master, "packets_lost")}
    return Lamp(of_link(link | {"round_trip_ms": 2.0 * delays.median_ms}), title, words)


def _troubled(slave: Columns, master: Columns) -> Lamp | None:
    """Return the lamp of a link in trouble, or of a slave that does not follow; None without."""
    trouble, lamp = int(master["trouble"][-1]), _uncoupled(slave, master)
    name, cause = TROUBLES[trouble]
    if lamp and trouble in {NOTHING_TROUBLE, SILENT_TROUBLE}:
        return Lamp("bad", lamp.title, f"{lamp.text}; {cause}")
    return Lamp("bad", f"link: {name}", cause) if trouble else lamp


def _uncoupled(slave: Columns, master: Columns) -> Lamp | None:
    """Return the lamp of a link that stands and is silent, or of a slave that does not follow."""
    state, declutched = int(master["state"][-1]), _last(master, "declutches") > 0
    frozen = state == LinkState.FROZEN
    faded = state == LinkState.DECLUTCHED or (state == LinkState.WAITING and declutched)
    if not (frozen or faded):
        return None
    silence_ms = master.get("silence_ms")
    silent = "" if silence_ms is None else f"nothing accepted for {silence_ms[-1]:.0f} ms"
    words = ", ".join(filter(None, (silent, _troubles(slave, master))))
    return Lamp("attention", FROZEN, words) if frozen else Lamp("bad", DECLUTCHED, words)


def _troubles(slave: Columns, master: Columns) -> str:
    """Return a text of all troubles and refused packets so far; empty without any."""
    words = []
    if lost := _last(master, "packets_lost"):
        words.append(f"{in_percent(lost / (lost + _last(master, 'packets_received')))} lost")
    refused = _last(slave, "packets_rejected") + _last(master, "packets_rejected")
    counts = [(refused, "packet refused", "packets refused")]
    counts += [(_last(master, name), one, many) for name, one, many in _COUNTS]
    words += [count_in_words(count, one, many) for count, one, many in counts if count]
    return ", ".join(words)


def _last(columns: Columns, name: str) -> int:
    """Return the last value of a count, 0 where a recording of an older version has none."""
    values = columns.get(name)
    return 0 if values is None or not np.isfinite(values[-1]) else int(values[-1])
