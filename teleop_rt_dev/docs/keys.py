"""Every key of the YAML files, on a page for each section, with an example that ships."""

from __future__ import annotations

import re
from collections.abc import Iterator

from teleop_rt.cli.schema import SchemaName
from teleop_rt.cli.schemas import schema_named
from teleop_rt_dev.docs import schema as docs_schema
from teleop_rt_dev.docs.table import table
from teleop_rt_dev.paths import CONFIG

_YAML = """# YAML keys

Generated from the JSON Schemas that `teleop-rt schema` prints and that the shipped files name: an
editor with a YAML language server completes and checks them. A trial names its rig by a path
relative to the trial file, or holds it. Unknown keys are refused, and every problem of both files
is reported at once, with file and line. Keys are those of a linear rig; on a rotary one `m` reads
`rad` and `N` reads `Nm`. `--set key.path=value` overrides any key.
"""
_SPLIT = {"trial": frozenset({"rig"}), "rig": frozenset[str]()}
"""Files with a page for each of their sections, without these keys: a rig has pages of its own."""
_WHOLE = {
    "columns": "NAME.columns.yaml, beside a recording of another program",
    "format": "Frame format of a serial device",
}
_FIRST = ("silicone_cube.yaml", "simulated_canopen.yaml")  # of an example, where they have the key


def pages() -> dict[str, str]:
    """Return the page of all YAML files, and one for each section of a trial and of a rig."""
    found: dict[str, str] = {}
    contents = [_YAML]
    for name in _SPLIT:
        sections = _sections(name)
        found |= {page_of(name, root): _page(name, root, sections[root]) for root in sections}
        links = (f"[{root or name}]({page_of(name, root)}.md)" for root in sections)
        title = f"**{name.capitalize()}** (`teleop-rt schema {name}`)"
        contents.append(f"{title}: {', '.join(links)}\n")
    for name, title in _WHOLE.items():
        contents.append(f"## {title}\n\n`teleop-rt schema {name}` prints its schema.\n")
        sections_of = docs_schema.sections(schema_named(SchemaName(name)))
        contents += [_section(one, "###") for one in sections_of]
    return {"yaml": "\n".join(contents)} | found


def page_of(name: str, root: str) -> str:
    """Return the name of the page of a file's own key."""
    return f"{name}-{root}" if root else name


def nav() -> list[dict[str, list[str]]]:
    """Return the pages of each file, as the site lists them."""
    return [
        {name.capitalize(): [f"reference/{page_of(name, root)}.md" for root in _sections(name)]}
        for name in _SPLIT
    ]


def _sections(name: str) -> dict[str, list[docs_schema.KeySection]]:
    """Return the sections of a file by the key of the file that they belong to."""
    found: dict[str, list[docs_schema.KeySection]] = {}
    for one in docs_schema.sections(schema_named(SchemaName(name)), _SPLIT[name]):
        found.setdefault(one.root, []).append(one)
    return found


def _page(name: str, root: str, sections: list[docs_schema.KeySection]) -> str:
    """Return the page of one key: an example, then the keys of each section below it."""
    title = f"`{root}` of a {name}" if root else f"A {name}'s own keys"
    parts = [f"# {title}\n", *_example(name, root)]
    return "\n".join([*parts, *(_section(one) for one in sections)])


def _section(one: docs_schema.KeySection, level: str = "##") -> str:
    return f"{level} {one.heading}\n\n{one.meaning}\n\n{table(docs_schema.HEADER, one.rows)}"


def _example(name: str, root: str) -> Iterator[str]:
    """Give the lines of a file that ships which begin with a key, nothing where none has it."""
    folder = CONFIG / f"{name}s"
    for path in sorted(folder.glob("*.yaml"), key=lambda one: (one.name not in _FIRST, one.name)):
        text = path.read_text(encoding="utf-8")
        block = re.search(rf"^{root}:.*\n(?:[ -].*\n|\n(?=[ -]))*", text, re.MULTILINE)
        if root and block is not None:
            yield f"From `config/{name}s/{path.name}`:\n\n```yaml\n{block[0].rstrip()}\n```\n"
            return
