"""The example notebook as a page of the documentation: its cells, and the outputs kept in it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_PICTURE = "![{}](data:image/png;base64,{})"


def page(notebook: Path) -> str:
    """Return the notebook as Markdown, for readers who have no Jupyter."""
    cells: list[dict[str, Any]] = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    title, *rest = [part for cell in cells for part in _parts(cell)]
    source = f"This page shows `docs/{notebook.name}`, which Jupyter opens, with its outputs."
    heading, _, text = title.partition("\n")
    return "\n\n".join((heading, source, text.strip(), *rest)) + "\n"


def _parts(cell: dict[str, Any]) -> Iterator[str]:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        yield source
        return
    yield _fenced(source, "python")
    for output in cell["outputs"]:
        yield _shown(output)


def _shown(output: dict[str, Any]) -> str:
    """Return an output in the richest form that a page shows. Raises KeyError for an error's."""
    if output["output_type"] == "stream":
        return _fenced("".join(output["text"]))
    data = output["data"]
    if "image/png" in data:
        return _PICTURE.format("figure of the cell above", "".join(data["image/png"]).strip())
    if "text/html" in data:
        return "".join(data["text/html"])
    return _fenced("".join(data["text/plain"]))


def _fenced(text: str, language: str = "") -> str:
    return f"```{language}\n{text.rstrip()}\n```"
