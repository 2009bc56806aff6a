"""The tools of developers: one entry, found from any folder, and no part of a wheel."""

import os
import re
import subprocess
import sys

import pytest

from teleop_rt_dev import __main__ as entry
from teleop_rt_dev.bench import command as bench
from teleop_rt_dev.bench import lockstep
from teleop_rt_dev.campaign.command import campaigns
from teleop_rt_dev.path import command as path
from teleop_rt_dev.paths import ROOT


def test_one_help_lists_every_command_and_a_missing_one_ends_with_2(capsys):
    assert entry.main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert all(f"\n  {name} " in shown for name in entry.COMMANDS)
    assert entry.main([]) == 2
    folders = {file.parent.name for file in (ROOT / "teleop_rt_dev").glob("*/command.py")}
    assert folders == set(entry.COMMANDS)


def test_every_campaign_says_in_a_line_what_it_is_and_an_unknown_one_ends_with_2(capsys):
    assert all(meaning.endswith(".") for meaning in campaigns().values())
    assert entry.main(["campaign", "nothing"]) == 2
    assert "hands" in capsys.readouterr().err


def test_every_bench_of_the_help_is_a_module():
    folder = ROOT / "teleop_rt_dev" / "bench"
    named = {*bench.NAMES, *bench.ON_REQUEST}
    for name in named:
        text = (folder / f"{name}.py").read_text()
        assert re.search(r"^def run\(_?rounds: int\)", text, re.MULTILINE), name


def test_the_bench_in_lock_step_counts_calls_and_instructions_of_all_functions_within():
    def inner():
        pass

    def outer():
        inner()
        inner()

    alone, calls = lockstep.count(inner)
    both, all_calls = lockstep.count(outer)
    assert (calls, all_calls) == (1, 3)
    assert both > 2 * alone > 0
    assert lockstep.count(outer) == (both, all_calls)


@pytest.mark.parametrize("place", ["README.md", "CONTRIBUTING.md", ".ci/run", "docs"])
def test_every_campaign_and_bench_that_a_text_names_exists(place):
    named = ROOT / place
    files = sorted(named.rglob("*.md")) if named.is_dir() else [named]
    text = "\n".join(file.read_text() for file in files)
    assert set(re.findall(r"scripts/campaign ([a-z]+)", text)) <= set(campaigns())
    known = {*bench.NAMES, *bench.ON_REQUEST}
    for words in re.findall(r"scripts/bench(?: --rounds \d+)?((?: [a-z]+)*)`", text):
        assert set(words.split()) <= known
    paths = re.findall(r"\b(?:scripts|teleop_rt_dev)/[a-z_./-]*[a-z]", text)
    assert [name for name in paths if not (ROOT / name).exists()] == []


def test_a_campaign_runs_from_another_folder(tmp_path):
    done = subprocess.run(
        [sys.executable, "-P", "-m", "teleop_rt_dev", "campaign", "kwidth", "--help"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "teleop-rt-dev campaign kwidth" in done.stdout


@pytest.mark.parametrize("folder", ["tests", "teleop_rt_dev", "scripts", "teleop_rt", "drivers"])
def test_no_module_is_found_by_a_changed_search_path(folder):
    changing = re.compile(r"sys\.path(\.insert|\.append|\[:0\])")
    found = [p for p in (ROOT / folder).rglob("*.py") if changing.search(p.read_text())]
    assert found == []


def test_the_pictures_of_the_path_and_of_the_order_are_those_of_the_code():
    text = path.CONTRIBUTING.read_text()
    assert path.drawn(text) == text, "run scripts/teleop-rt-dev path"


def test_the_path_to_a_tick_is_printed_for_whoever_asks_and_written(monkeypatch, tmp_path, capsys):
    own = tmp_path / "CONTRIBUTING.md"
    own.write_text(f"{path.BEGIN}\nolder\n{path.END}\n{path.ORDER_BEGIN}\nolder\n{path.ORDER_END}")
    monkeypatch.setattr(path, "CONTRIBUTING", own)
    assert path.main([]) == 0
    assert path.picture() in own.read_text()
    assert path.order() in own.read_text()
    assert path.picture() in capsys.readouterr().out
    lines = path.picture().splitlines()
    assert lines[0].split()[:2] == ["run", "cli/running.py"]
    assert lines[-1].split()[:2] == ["Slave.cycle", "slave/slave.py"]
    assert lines[-1].endswith(
        "_sense, _decide, _advance_zeros, _hold_clock, _act, _note_fault, _write_row"
    ), "also a kernel that the object holds, where the decisions are made"


def test_a_path_that_the_code_does_not_take_is_refused(monkeypatch):
    monkeypatch.setattr(path, "PATH", (path.PATH[0], path.PATH[-1]))
    with pytest.raises(SystemExit, match=r"run no longer leads to Slave\.cycle"):
        path.picture()
    monkeypatch.setattr(path, "PATH", (path.Step("slave/slave.py", "Slave.nothing"),) * 2)
    with pytest.raises(SystemExit, match=r"has no Slave\.nothing"):
        path.picture()
