"""Templates of the pages: plain HTML that needs nothing from elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

from jinja2 import ChainableUndefined, Environment, PackageLoader

from teleop_rt.view import style


@dataclass(frozen=True, slots=True)
class Tile:
    """One answer: a grade (good, attention, bad or unknown), a value, and what stands behind it."""

    title: str
    grade: str
    value: str
    lines: tuple[str, ...]


def render(template: str, **content: object) -> str:
    """Return a page of `teleop_rt/view/pages` as HTML; the style goes with every page."""
    pages = Environment(
        loader=PackageLoader("teleop_rt.view", "pages"),
        autoescape=True,
        undefined=ChainableUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return pages.get_template(template).render(style=style, **content)
