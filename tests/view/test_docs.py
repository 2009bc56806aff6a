"""The documentation: its reference follows the code, and it builds without a complaint."""

import json
import re
from contextlib import contextmanager
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml
from browser import WIDTHS, console_errors, overflow, resize, until
from page_checks import contrast_failures

from teleop_rt.signals import SLAVE
from teleop_rt.slave.faults import FAULTS
from teleop_rt_dev.docs import keys, reference
from teleop_rt_dev.paths import ROOT


@pytest.fixture(scope="module")
def pages():
    return reference.pages()


def test_every_key_is_in_the_reference_with_unit_bounds_and_meaning(pages):
    noise = "| `force_noise_N` | number | > 0, ≤ 1000000 | required | Standard deviation of"
    assert noise in pages["rig-sensors"]
    assert "| `round_trip_ms` | number | ≥ 0, ≤ 10000 | `0` | Delay added" in pages["trial-link"]
    for page, section in (
        ("trial", "TrialConfig"),
        ("rig-axis", "`axis` (CanopenConfig)"),
        ("trial-plant", "`plant` (SimulatedPlantConfig)"),
    ):
        assert f"## {section}\n" in pages[page]
    whole = "\n".join(pages.values())
    named = set(re.findall(r"section ([A-Z]\w+)", whole))
    assert named <= set(re.findall(r"^##+ .*?\b(\w+)\)?$", whole, re.MULTILINE))


def test_every_page_of_keys_is_listed_and_begins_with_an_example_that_has_its_key(pages):
    (listed,) = (one["Trial"] for one in keys.nav() if "Trial" in one)
    assert "reference/trial-link.md" in listed
    assert {Path(one).stem for one in listed} <= set(pages)
    shown = 0
    for name in [name for name in pages if name.startswith(("trial-", "rig-"))]:
        file, key = name.split("-", 1)
        example = re.search(r"(?s)\nFrom `(\S+)`:\n\n```yaml\n(.*?)```", pages[name])
        if example is None:
            assert not any(key in yaml.safe_load(one.read_text()) for one in shipped(f"{file}s"))
            continue
        whole = yaml.safe_load((ROOT / example[1]).read_text())
        assert yaml.safe_load(example[2]) == {key: whole[key]}
        shown += 1
    assert shown > 10


def shipped(folder):
    """Return the files that ship of one kind."""
    return (ROOT / "config" / folder).glob("*.yaml")


def test_every_command_signal_and_fault_is_in_the_reference(pages):
    for command in ("run", "diagnose", "report", "live", "study chapter4"):
        assert f"## `teleop-rt {command}`" in pages["commands"]
    assert "--beside" not in pages["commands"]
    for signal in SLAVE:
        assert f"| `{signal.name}` | `{signal.unit}` |" in pages["signals"]
    for fault in FAULTS.values():
        assert f"| {fault.code} | `{fault.name}` |" in pages["faults"]
    assert "| `second_layer` | environment, material |" in pages["effects"]
    for page, key in (("summary", "round_trip_ms"), ("answer", "absorbed_by_base")):
        assert f"| `{key}` | number or null | " in pages[page]
    assert "### Answer\n" in pages["answer"]
    assert "### Problem\n" in pages["answer"]
    assert "| `selected.parameters" in pages["summary"] or "| `selected` |" in pages["summary"]


def test_every_rig_that_ships_is_on_the_page_of_drives(pages):
    for rig in (ROOT / "config" / "rigs").glob("*.yaml"):
        assert f"| `{rig.name}` | `" in pages["rigs"]
    assert "| `simulated_canopen.yaml` | `canopen` |" in pages["rigs"]


def test_every_command_of_the_tutorial_is_one_of_the_program_with_options_that_it_has(pages):
    docs_pictures = pytest.importorskip("teleop_rt_dev.docs.pictures", exc_type=ImportError)
    commands = docs_pictures.commands_of((ROOT / "docs" / "tutorial.md").read_text())
    assert len(commands) == 6
    for program, *words in commands:
        name = "run" if program == "scripts/run" else words[0]
        _, _, section = pages["commands"].partition(f"## `teleop-rt {name}`\n")
        assert section, name
        section = section.partition("\n## ")[0]
        assert {word for word in words if word.startswith("--")} <= set(
            re.findall(r"--[a-z-]+", section)
        )
        files = [word for word in words if word.startswith("config/")]
        assert all((ROOT / file).is_file() for file in files)


@pytest.mark.parametrize(
    ("fault", "forgiven"), [("late_ticks", True), ("force_limit", False), (None, False)]
)
def test_of_a_tutorial_only_a_machine_that_is_late_is_forgiven(tmp_path, fault, forgiven):
    docs_pictures = pytest.importorskip("teleop_rt_dev.docs.pictures", exc_type=ImportError)
    if fault is not None:
        summary = {"safety": {"fault": {"name": fault}}}
        (tmp_path / "summary.json").write_text(json.dumps(summary))
    assert docs_pictures.was_late(["run", "--out", "."], tmp_path) is forgiven


class Sources(HTMLParser):
    """Collects the addresses that a page would fetch by itself."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag in {"script", "img"} and values.get("src"):
            self.found.append(values["src"])
        if tag == "link" and values.get("rel") == "stylesheet":
            self.found.append(values["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Give the folder of the site, built without a complaint."""
    build = pytest.importorskip("mkdocs.commands.build")
    config = pytest.importorskip("mkdocs.config")
    folder = tmp_path_factory.mktemp("site")
    build.build(config.load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder)))
    return folder


def test_the_search_works_where_the_pages_are_opened_from_the_folder(chromium, site):
    console_errors(chromium)
    chromium.get((site / "howto" / "watch.html").as_uri())
    chromium.execute_script("document.getElementById('__search').click()")
    typed = (
        "const f = document.querySelector('input.md-search__input'); f.value = arguments[0];"
        "for (const name of ['focus', 'input', 'keyup']) f.dispatchEvent(new Event(name))"
    )
    results = "return document.querySelector('.md-search-result__list').textContent.trim()"
    # Typed again until the index is there, which is read after the page.
    until(
        chromium,
        lambda: chromium.execute_script(results),
        lambda: chromium.execute_script(typed, "passivity"),
    )
    assert "passivity" in chromium.execute_script(results).lower()
    assert console_errors(chromium) == []


_STILL = """
const still = document.createElement('style');
still.textContent = '* {transition: none !important; animation: none !important}';
document.head.append(still);
"""
"""A drawer that is still moving is no width of a page."""


def test_no_page_of_the_site_is_wider_than_its_window(chromium, site):
    too_wide = []
    with without_search(chromium):
        widths = WIDTHS
        for page in sorted(site.rglob("*.html")):
            chromium.get(page.as_uri())
            chromium.execute_script(_STILL)
            widths = widths[::-1]  # begins with the one at which the page was loaded
            for width in widths:
                resize(chromium, width)
                assert chromium.execute_script("return window.innerWidth") == width
                if pixels := overflow(chromium):
                    too_wide.append(f"{page.name}: {pixels} px wider than {width} px")
    assert too_wide == []


@contextmanager
def without_search(browser):
    """Let pages load without the index of the search, which each would read and build again."""
    browser.execute_cdp_cmd("Network.enable", {})
    browser.execute_cdp_cmd(
        "Network.setBlockedURLs", {"urls": ["*/search/search_index*", "*/workers/search*"]}
    )
    try:
        yield
    finally:
        browser.execute_cdp_cmd("Network.setBlockedURLs", {"urls": []})
        browser.execute_cdp_cmd("Network.disable", {})


def test_the_site_fetches_nothing_and_holds_what_the_code_and_the_readme_say(site):
    written = list(site.rglob("*.html"))
    assert len(written) > 18
    sources = Sources()
    for page in written:
        text = page.read_text()
        sources.feed(text)
        assert "arithmatex" not in text
    assert [source for source in sources.found if re.match(r"(https?:)?//", source)] == []
    measured = (site / "measured.html").read_text()
    assert "<td>default trial (12 ± 8 mm), 20 seeds" in measured
    assert "README:" not in measured
    assert "<math" in (site / "theory" / "rendering.html").read_text()
    for name in ("reference/yaml", "reference/faults", "reference/effects", "example"):
        # The tree's own page only refers to this one.
        assert "makes this page" not in (site / f"{name}.html").read_text()


def test_the_example_shows_the_cells_of_the_notebook_and_their_outputs(site):
    text = (site / "example.html").read_text()
    assert "teleop_rt" in text
    assert "diagnose" in text
    assert "<caption>arrays: named</caption>" in text, "the table of the diagnosis"
    assert "a spring alone: " in text, "the output of a cell"
    assert 'src="data:image/png;base64,' in text, "its figure"


@contextmanager
def without_memory(browser):
    """Let each page begin with no stored scheme: a page keeps that of the last one."""
    forget = {"source": "localStorage.clear()"}
    added = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", forget)
    try:
        yield
    finally:
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)


_NOT_REACHED = """
return [...document.querySelectorAll('.md-content *')]
  .filter((one) => one.scrollWidth > one.clientWidth + 1 && one.tabIndex < 0)
  .filter((one) => ['auto', 'scroll'].includes(getComputedStyle(one).overflowX))
  .map((one) => one.outerHTML.slice(0, 80));
"""


@pytest.mark.parametrize(("width", "scheme"), [(400, "light"), (1400, "dark")])
def test_the_site_has_contrast_and_a_keyboard_reaches_what_scrolls(chromium, site, width, scheme):
    resize(chromium, width, scheme)
    found = []
    with without_search(chromium), without_memory(chromium):
        for name in ("index", "python", "howto/odrive", "howto/effect", "reference/trial-plant"):
            chromium.get((site / f"{name}.html").as_uri())
            body = chromium.find_element("css selector", "body")
            ground = {"light": "default", "dark": "slate"}[scheme]
            assert body.get_attribute("data-md-color-scheme") == ground
            found += [f"{name}: {one}" for one in contrast_failures(chromium)]
            missed = chromium.execute_script(_NOT_REACHED)
            found += [f"{name}: not reached: {one}" for one in missed]
            dialog = chromium.find_element("css selector", "[role=dialog]")
            assert dialog.get_attribute("aria-label") == "search"
    assert found == []
