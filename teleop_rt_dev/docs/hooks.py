"""Hooks of mkdocs: equations become MathML, and the reference is generated from the code."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

from teleop_rt_dev.docs import example, keys, reference
from teleop_rt_dev.paths import ROOT

_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)
_GALLERY = "<!-- gallery -->"
_FROM_README = re.compile(r"<!-- README: (.+?) -->")


def on_config(config: Any) -> Any:
    """List the pages of the keys, which are generated, below the page of all of them."""
    (section,) = [one["Reference"] for one in config.nav if "Reference" in one]
    place = section.index("reference/yaml.md") + 1
    section[place:place] = keys.nav()
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages: nothing is written to the tree, so nothing can drift.

    A page replaces the one in the tree, which only refers those who read the source to it.
    """
    pages = {f"reference/{name}.md": page for name, page in reference.pages().items()}
    pages["example.md"] = example.page(ROOT / "docs" / "example.ipynb")
    for path, page in pages.items():
        if (in_tree := files.get_file_from_path(path)) is not None:
            files.remove(in_tree)
        files.append(File.generated(config, path, content=page))
    for picture in _pictures():
        path = f"gallery/{picture.name}"
        files.append(File.generated(config, path, abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Take a section over from the README where a page says so, and the gallery once it is made."""
    markdown = _FROM_README.sub(lambda found: _readme_section(found.group(1)), markdown)
    return markdown.replace(_GALLERY, _gallery())


def _pictures() -> list[Path]:
    return sorted((ROOT / "build" / "gallery").glob("*.webp"))


def _gallery() -> str:
    """Return the pictures of the gallery by page, or how to make them if there are none."""
    pages: dict[str, list[str]] = {}
    for picture in _pictures():
        page, width, scheme = picture.stem.rsplit("-", 2)
        words = f"{page}, {width} px, {scheme}"
        path = f"gallery/{picture.name}"
        pages.setdefault(page, []).append(f"[![{words}]({path}){{ width=160 }}]({path})")
    parts = [f"## {page}\n\n{' '.join(shown)}" for page, shown in pages.items()]
    return "\n\n".join(parts) or "No pictures yet: run `scripts/docs gallery`, then `scripts/docs`."


def _readme_section(title: str) -> str:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    _, found, rest = readme.partition(f"\n## {title}\n")
    if not found:
        raise ValueError(f"README.md has no section {title!r}")
    return rest.partition("\n## ")[0].strip()


def on_post_build(config: Any, **_: Any) -> None:
    """Lay the search's index down as a script, too: a page opened from a folder fetches nothing."""
    index = Path(config["site_dir"]) / "search" / "search_index.json"
    text = f"var __index = {index.read_text(encoding='utf-8')}"
    index.with_suffix(".js").write_text(text, encoding="utf-8")


def on_page_content(page_html: str, **_: Any) -> str:
    """Turn every equation into MathML, which browsers draw by themselves."""
    page_html = _BLOCK.sub(lambda m: _mathml(m.group(1), "block"), page_html)
    page_html = _INLINE.sub(lambda m: _mathml(m.group(1), "inline"), page_html)
    if "arithmatex" in page_html:
        raise ValueError("an equation was left that is no MathML")
    return page_html


def _mathml(latex: str, display: str) -> str:
    return convert(html.unescape(latex).strip(), display=display)
