"""Hooks of mkdocs: equations become MathML, and the reference is generated from the code."""

from __future__ import annotations

import html
import re
import sys
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
import docs_reference

_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)
_FROM_README = re.compile(r"<!-- README: (.+?) -->")


def on_files(files, config):
    """Add the generated pages: nothing is written to the tree, so nothing can drift."""
    for name, page in docs_reference.pages().items():
        files.append(File.generated(config, f"reference/{name}.md", content=page))
    return files


def on_page_markdown(markdown, **_):
    """Take a section over from the README where a page says so: a figure has one source."""
    return _FROM_README.sub(lambda found: _readme_section(found.group(1)), markdown)


def _readme_section(title: str) -> str:
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    _, found, rest = readme.partition(f"\n## {title}\n")
    if not found:
        raise ValueError(f"README.md has no section {title!r}")
    return rest.partition("\n## ")[0].strip()


def on_post_build(config, **_):
    """Lay the search's index down as a script, too: a page opened from a folder fetches nothing."""
    index = Path(config["site_dir"]) / "search" / "search_index.json"
    text = f"var __index = {index.read_text(encoding='utf-8')}"
    index.with_suffix(".js").write_text(text, encoding="utf-8")


def on_page_content(page_html, **_):
    """Turn every equation into MathML, which browsers draw by themselves."""
    page_html = _BLOCK.sub(lambda m: _mathml(m.group(1), "block"), page_html)
    page_html = _INLINE.sub(lambda m: _mathml(m.group(1), "inline"), page_html)
    if "arithmatex" in page_html:
        raise ValueError("an equation was left that is no MathML")
    return page_html


def _mathml(latex: str, display: str) -> str:
    return convert(html.unescape(latex).strip(), display=display)
