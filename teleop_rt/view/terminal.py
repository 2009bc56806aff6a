"""How a run goes, on the terminal: one glance that renews itself, or plain lines elsewhere."""

from __future__ import annotations

import os
import time
from types import TracebackType

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from teleop_rt.trial.grades import GRADE_COLOURS, MARKS, Grade
from teleop_rt.view.live.feed import Feed
from teleop_rt.view.live.health import Lamp
from teleop_rt.view.live.source import About, RingSource, find_ring_folder
from teleop_rt.view.live.words import STOPPED
from teleop_rt.view.quantities import SMALL, parameter_unit, small
from teleop_rt.view.style import model_name, parameter

_RENEW_S = 0.25
"""Between two renewals of the line on a terminal."""
_LINE_EVERY_S = 5.0
"""Between two lines where the output is no terminal."""
_OF_CONTACT = 3
"""State, force and model stand on the first of two plain lines; loop, link and a fault follow."""
_WINDOW_S = 1.0
"""Time over which the line's figures are taken."""


class RunView:
    """Shows state, force, parameters and link of this process's run while it goes.

    Call it with the seconds run so far. On a terminal it redraws at most four times a second;
    elsewhere it prints that the trial starts, and two lines per five seconds of it. It reads the
    rings as any reader does, so the loop does not know of it.
    """

    def __init__(self, console: Console, name: str, duration_s: float) -> None:
        self._console, self._name, self._duration_s = console, name, duration_s
        self._feed = Feed(RingSource(lambda: find_ring_folder(os.getpid())), _WINDOW_S)
        self._live = Live(console=console, transient=True, auto_refresh=False)
        self._shown_s = -np.inf
        self._next_line_s = _LINE_EVERY_S

    def __enter__(self) -> RunView:
        """Begin to show, at once: kernels, devices and link take seconds until the first tick."""
        if self._console.is_terminal:
            self._live.start()
            self._live.update(self._glance(0.0), refresh=True)
        else:
            self._console.print(f"{self._name}: starting ...", soft_wrap=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Take the glance away; lines stay."""
        self._live.stop()

    def __call__(self, seconds: float) -> None:
        """Show how it goes after so many seconds of the trial."""
        now_s = time.monotonic()
        if self._console.is_terminal:
            if now_s - self._shown_s >= _RENEW_S:
                self._shown_s = now_s
                self._take()
                self._live.update(self._glance(seconds), refresh=True)
        elif seconds >= self._next_line_s:
            self._next_line_s += _LINE_EVERY_S
            self._take()
            parts = [text for _, _, text in glance(self._feed)]
            contact, machine = "  ".join(parts[:_OF_CONTACT]), "  ".join(parts[_OF_CONTACT:])
            second = f"\n{'':10}{machine}" if machine else ""
            self._console.print(f"{seconds:6.1f} s  {contact}{second}", soft_wrap=True)

    def _take(self) -> None:
        self._feed.poll()
        self._feed.judge()

    def _glance(self, seconds: float) -> Group:
        table = Table.grid(padding=(0, 2))
        for title, grade, text in glance(self._feed):
            mark = Text(MARKS[grade] if grade else " ", style=GRADE_COLOURS[grade] if grade else "")
            table.add_row(mark, Text(title, style="bold"), Text(text))
        done = Table.grid(padding=(0, 2))
        done.add_row(
            Text(self._name, style="bold"),
            ProgressBar(self._duration_s, seconds, width=40),
            f"{seconds:.1f} / {self._duration_s:.1f} s",
        )
        return Group(done, table)


def glance(feed: Feed) -> list[tuple[str, Grade | None, str]]:
    """Return title, grade (or nothing) and words of each thing worth a glance."""
    about, now = feed.about, feed.health
    if about is None or now.state is None:
        return [("state", "unknown", "starting")]
    touching = "in contact" if now.in_contact else "free"
    position = f"{SMALL * now.position:.2f} {small(about.position_unit)}"
    where = f"{now.force:.2f} {about.force_unit} at {position}, {touching}"
    rows: list[tuple[str, Grade | None, str]] = [
        ("state", "bad" if now.state in STOPPED else "good", now.state.name)
    ]
    rows.append(("force", None, where))
    rows.append(("model", now.model.grade, _parameters(feed, about)))
    rows += [_row("loop", now.loop), _row("link", now.link)]
    if now.fault.code:
        text = f"{now.fault.name}: {now.fault.cause}; {now.fault.next_step}"
        rows.append(("fault", "bad", text))
    return rows


def _row(title: str, lamp: Lamp) -> tuple[str, Grade | None, str]:
    text = lamp.text.partition(";")[0]
    said = lamp.title.removeprefix("link: ").removeprefix("loop at ")
    return title, lamp.grade, f"{said}, {text}" if text else said


def _parameters(feed: Feed, about: About) -> str:
    """Return the selected model with its parameters and one deviation either way."""
    selected = feed.health.selected
    if selected < 0:
        return "none yet"
    model, regression, solver = about.rows[selected]
    units = about.position_unit, about.force_unit
    window = feed.shown.get(f"/estimates/{model}/{regression}/{solver}")
    if window is None or not window.columns:
        return model_name(model)
    last = {name: float(values[-1]) for name, values in window.columns.items()}
    parts = []
    for name, value in last.items():
        if f"{name}_std" in last and name != "offset" and np.isfinite(value):
            std = last[f"{name}_std"]
            content = {"value": value, "std": std if np.isfinite(std) else None}
            whole = content | {"unit": parameter_unit(model, name, *units)}
            parts.append(parameter(name, whole, regression))
    return ", ".join([model_name(model), *parts])
