"""Commands, options, keys and files that README, changelog and documentation name exist."""

import re
import tomllib
from pathlib import Path
from typing import get_args

import pytest

from teleop_rt import __version__
from teleop_rt.cli import app
from teleop_rt.cli.schema import SchemaName
from teleop_rt.cli.schemas import schema_named
from teleop_rt.config.realtime import LateConfig
from teleop_rt.config.yaml_file import read_yaml
from teleop_rt.contact.effect import Acts, Compensation, Family, Stage

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    [
        *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "drivers").glob("*.md"),
    ]
)
GROUPS = ("study", "calibrate", "schema")
CODE = re.compile(r"^(?: {4}|\t)(\S.*)$|```[a-z]*\n(.*?)```|`([^`\n]+)`", re.MULTILINE | re.DOTALL)

LINK = re.compile(r"\]\(([^)\s]+)\)")


def named(path):
    return path.relative_to(ROOT).as_posix()


def code_of(page):
    """Yield the lines of code of a page: indented, fenced, and within a sentence."""
    for parts in CODE.findall(page.read_text().replace("\\\n", " ")):
        yield from "".join(parts).splitlines()


def calls_of(page):
    """Yield the words of every call of the program: without a comment, up to a pipe."""
    for line in code_of(page):
        for call in re.findall(r"(?:^|[\s(])teleop-rt ([^|;&#<>]+)", line):
            words = call.split()
            if words:
                yield words


def commands_of(words):
    """Return the commands that the words of a call name, `a | b | c` and groups followed."""
    name = words[0]
    if name.startswith("-"):
        return app, words
    command = app.load(name)
    rest = words[1:]
    if name in GROUPS and rest and hasattr(command, "commands") and not rest[0].startswith("-"):
        return command.commands[rest[0]], rest[1:]
    return command, rest


def options_of(command):
    return {
        one for parameter in command.params for one in (*parameter.opts, *parameter.secondary_opts)
    }


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_command_and_option_that_a_page_names_exists(page):
    for words in calls_of(page):
        name = words[0]
        if name.isupper() or name in {"...", "*"} or not re.fullmatch(r"[\w-]+", name):
            continue
        assert name.startswith("-") or name in app.commands, " ".join(words)
        command, rest = commands_of(words)
        known = options_of(command) | {"--help"}
        for word in rest:
            if re.fullmatch(r"--[a-z][\w-]*(=.*)?", word):
                assert word.partition("=")[0] in known, f"teleop-rt {' '.join(words)}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_link_leads_to_a_file_of_the_tree(page):
    """Whoever reads the source, without the site that `scripts/docs` builds, follows them too."""
    for target in LINK.findall(page.read_text()):
        if not re.match(r"[a-z]+:|#", target):
            assert (page.parent / target.partition("#")[0]).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_one_of_several_commands_that_a_page_names_exists(page):
    for line in code_of(page):
        for listed in re.findall(r"teleop-rt ([a-z-]+(?: \| [a-z-]+)+)", line):
            assert set(listed.split(" | ")) <= set(app.commands), line


FOLDERS = ("config", "docs", "drivers", "scripts", "teleop_rt", "teleop_rt_dev", "tests")
PLACE = re.compile(rf"\b(?:{'|'.join(FOLDERS)})/[\w./-]*\w")


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_file_that_a_page_names_exists(page):
    missing = [
        place
        for line in code_of(page)
        for place in PLACE.findall(line)
        if not (ROOT / place).exists() and not (ROOT / "drivers" / place).exists()
    ]
    assert missing == []


def keys_of(schema):
    """Yield every key that a schema declares."""
    if isinstance(schema, dict):
        for name, inner in schema.items():
            yield from inner if name == "properties" else ()
            yield from keys_of(inner)
    elif isinstance(schema, list):
        for inner in schema:
            yield from keys_of(inner)


@pytest.fixture(scope="module")
def keys():
    """Every key of the files that the program reads, and of the JSON that it prints."""
    return {key for name in SchemaName for key in keys_of(schema_named(name))}


SECTIONS = ("axis", "bus", "contact", "coupling", "drive", "estimation", "limits", "link", "master",
            "operator", "plant", "realtime", "recording", "rig", "sensors", "slave",
            "supervision")  # fmt: skip
KEY = re.compile(rf"`((?:{'|'.join(SECTIONS)})(?:\.[A-Za-z_0-9]+)+)(?:: [^`]*)?`")
FILE_ENDINGS = {"asc", "blf", "mcap", "py", "yaml"}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_key_of_a_file_that_a_page_names_exists_with_or_without_its_unit(page, keys):
    if page == ROOT / "drivers" / "README.md":
        pytest.skip("names attributes of Python by the same form")
    for path in KEY.findall(page.read_text()):
        section, *names = path.split(".")
        if FILE_ENDINGS.isdisjoint(names):
            for name in (section, *names):
                assert any(f"{key}_".startswith(f"{name}_") for key in keys), path


TREE = ("config", "drivers", "scripts", "teleop_rt", "teleop_rt_dev", "tests")
TEXTS = {"", ".py", ".yaml", ".service", ".j2", ".eds", ".dbc", ".sh"}
OF_OTHERS = {
    "WATCHDOG_TIMER_EXPIRED": "an error of an ODrive",
    "config_rig": "a module of 0.2.0",
    "mechPos": "a register of a CyberGear",
    "moteus_tool": "a program of mjbots",
    "my_handle": "a file of the reader",
    "vX": "a version in general",
}
"""Names that a page may use although nothing here has them."""
IN_A_SENTENCE = re.compile(r"`([^`\n]+)`")
IDENTIFIER = re.compile(r"\w*(?:\w_\w|[a-z][A-Z])\w*(?![\w*])")


@pytest.fixture(scope="module")
def words():
    """Every word of the tree's texts, but of this one, and of the names of its files."""
    files = [file for folder in TREE for file in (ROOT / folder).rglob("*") if file.is_file()]
    read = (file for file in files if file.suffix in TEXTS and file != Path(__file__))
    texts = (file.read_text(errors="ignore") for file in read)
    return {word for text in (*map(named, files), *texts) for word in re.findall(r"\w+", text)}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_name_in_code_that_a_page_uses_exists(page, words):
    """A key, signal, fault, class or file that was renamed or removed is found on its page."""
    prose = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    used = {name for code in IN_A_SENTENCE.findall(prose) for name in IDENTIFIER.findall(code)}
    assert used - words - OF_OTHERS.keys() == set()


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_a_command_with_its_arguments_has_the_options_that_it_requires(page):
    """So that it can be run as it stands; a name alone is no call."""
    for words in calls_of(page):
        name = words[0]
        if name not in app.commands:
            continue
        command, rest = commands_of(words)
        required = [one for one in command.params if one.required and one.opts[0].startswith("--")]
        if rest and "..." not in rest and not hasattr(command, "commands"):
            given = {word.partition("=")[0] for word in rest}
            lacking = [one.opts[0] for one in required if not given & set(one.opts)]
            assert lacking == [], f"teleop-rt {' '.join(words)}"


def test_the_readme_names_the_data_that_a_command_needs_before_it():
    page = (ROOT / "README.md").read_text()
    for command in ("scripts/run measured_spring", "scripts/campaign measured "):
        assert page.index("need recordings that are not included") < page.index(command)
    hardware = page.partition("## Moving the trial to hardware")[2]
    assert "(docs/howto/rehearsal.md)" in hardware.partition("\n1. ")[0]


def test_each_figure_of_the_readme_is_one_of_the_measurements():
    """All numbers of a figure stand on one line of the page with all measurements."""
    table = (ROOT / "README.md").read_text().partition("| quantity | figure | command |")[2]
    figures = re.findall(r"^\| [^|\n]+ \| ([^|\n]*\d[^|\n]*) \| ", table, re.MULTILINE)
    assert len(figures) == 10
    measured = [
        set(re.findall(r"\d+(?:\.\d+)?", line))
        for line in (ROOT / "docs" / "measured.md").read_text().splitlines()
    ]
    for figure in figures:
        numbers = set(re.findall(r"\d+(?:\.\d+)?", figure))
        assert any(numbers <= line for line in measured), figure


def test_the_bounds_of_a_stall_are_those_that_the_readme_states():
    """The bounds that a reader copies to hardware, and those of each rig that ships."""
    words = " ".join((ROOT / "README.md").read_text().split())
    on_hardware = LateConfig()
    assert (
        f"These bounds are {on_hardware.hold_ms:g} ms, {on_hardware.stop_ms:g} ms and"
        f" {on_hardware.stop_share:g} on hardware"
    ) in words
    assert "they are 5 ms, 50 ms (45 ms with makers' drives) and 1, below" in words
    assert "watchdogs of 60 ms (50 ms)" in words
    bounds = {
        path.stem.removeprefix("simulated_"): late
        for path in (ROOT / "config" / "rigs").glob("simulated_*.yaml")
        if (late := read_yaml(path).data["realtime"]["late"])
    }
    of_makers = {rig for rig, late in bounds.items() if late["stop_ms"] == 45}
    assert {rig.partition("_")[0] for rig in of_makers} == {
        "damiao", "moteus", "odrive", "robstride", "vesc",
    }  # fmt: skip
    assert {(one["hold_ms"], one["stop_ms"], one["stop_share"]) for one in bounds.values()} == {
        (5, 50, 1), (5, 45, 1),
    }  # fmt: skip
    for rig in bounds:
        text = (ROOT / "config" / "rigs" / f"simulated_{rig}.yaml").read_text()
        watchdogs = re.findall(r"(?:watchdog|daemon_timeout)_ms: (\d+)", text)
        assert set(watchdogs) <= {"50" if rig in of_makers else "60"}, rig


@pytest.mark.parametrize(
    ("field", "words"),
    [("family", Family), ("stage", Stage), ("acts", Acts), ("compensation", Compensation)],
)
def test_the_words_that_a_declared_effect_takes_are_those_of_the_how_to(field, words):
    rows = (ROOT / "docs/howto/effect.md").read_text().splitlines()
    (row,) = (row for row in rows if row.startswith(f"| `{field}`"))
    assert set(re.findall(r"`(.+?)`", row.split("|")[2])) == set(get_args(words))


def test_the_version_is_the_newest_release_or_a_development_of_the_next_one():
    changelog = (ROOT / "CHANGELOG.md").read_text()
    (version, date), *_ = re.findall(r"^## \[([\d.]+)\] - (\S+)$", changelog, re.MULTILINE)
    unreleased = changelog.partition("## [Unreleased]")[2].partition(f"## [{version}]")[0]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == __version__
    if unreleased.strip():
        base = __version__.removesuffix(".dev0")
        assert base != __version__, "an unreleased version is no release"
        assert [*map(int, base.split("."))] > [*map(int, version.split("."))]
    else:
        assert __version__ == version
    citation = read_yaml(ROOT / "CITATION.cff").data
    assert (str(citation["version"]), str(citation["date-released"])) == (version, date)
