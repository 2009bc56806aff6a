"""The page itself: plots without data, made once for all browsers; frames bring the data."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.resources import Resources
from jinja2 import Environment, PackageLoader

from teleop_rt.view.live import words
from teleop_rt.view.live.plots import make_plots, make_sources
from teleop_rt.view.style import DARK, Palette

_WINDOW_SHARES = (0.1, 0.2, 0.5, 1.0)
"""Parts of the window that is held, to choose from."""


@cache
def page(palette: Palette, window_s: float) -> str:
    """Return the page on one ground as HTML; its resources come from the server of the page."""
    sources = make_sources()
    plots = make_plots(palette, sources)
    document = Document(title="teleop-rt live")
    for plot in plots:
        document.add_root(plot.figure)
    settings: dict[str, Any] = {
        "window_s": window_s,
        "dark": palette == DARK,
        "plots": {plot.figure.name: [plot.held, plot.value] for plot in plots},
    }
    pages = Environment(loader=PackageLoader("teleop_rt.view", "pages"), autoescape=False)  # noqa: S701 - bokeh's own template escapes
    return file_html(
        document,
        Resources(mode="server", root_url="/"),
        title="teleop-rt live",
        template=pages.get_template("live.html.j2"),
        template_variables={
            "palette": palette,
            "windows": [share * window_s for share in _WINDOW_SHARES],
            "css": words.CSS,
            "legends": {plot.figure.name: plot.legend for plot in plots},
            "settings": json.dumps(settings),
            "script": (files("teleop_rt.view") / "pages" / "live.js").read_text("utf-8"),
        },
    )
