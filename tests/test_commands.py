"""Commands that are listed, and modules that they load: a light command loads no compiler."""

import os
import platform
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from rich.markup import render

from teleop_rt import __version__
from teleop_rt.cli import app
from teleop_rt.cli.lazy import LazyCommand, LazyGroup
from teleop_rt.contact.models import MODELS
from teleop_rt.diagnosis.models.base import MODELS as BASE_MODELS
from teleop_rt.diagnosis.models.base import TERMS
from teleop_rt.ids import MODEL_IDS, REGRESSIONS, SOLVERS, TERM_IDS

HEAVY = ("numba", "scipy", "matplotlib", "bokeh", "teleop_rt.diagnosis")
DEVICES = ("can", "canopen", "serial", "teleop_rt_drivers")
LOADING = """
import sys
from teleop_rt.__main__ import main
sys.argv[0] = "teleop-rt"
try:
    main()
except SystemExit as end:
    code = end.code
print("loaded", *sys.modules, file=sys.stderr)
sys.exit(code)
"""


def loaded_by(*arguments: str, **environment: str) -> tuple[int, set]:
    """Return the exit code of a command in a process of its own, and its imported modules."""
    done = subprocess.run(
        [sys.executable, "-c", LOADING, *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("loaded "))
    return done.returncode, set(line.split())


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--help"], 0),
        (["--version"], 0),
        (["new", "mine"], 0),
        (["status"], 2),
        (["keygen", "link.key"], 0),
        (["no-such-command"], 2),
    ],
)
def test_a_light_command_loads_neither_solvers_nor_drivers(tmp_path, monkeypatch, arguments, code):
    monkeypatch.chdir(tmp_path)
    ended, modules = loaded_by(*arguments, TELEOP_RT_RUN_DIR=str(tmp_path))
    assert ended == code
    assert "teleop_rt.cli" in modules
    assert modules.isdisjoint({*HEAVY, *DEVICES})


@pytest.mark.parametrize(
    ("typed", "completed"),
    [("teleop-rt r", "replay"), ("teleop-rt run sil", "silicone_cube"),
     ("teleop-rt run --cl", "--clock"), ("teleop-rt new --r", "--rig")],
)  # fmt: skip
def test_a_shell_completes_commands_and_trials_without_a_compiler(typed, completed):
    asked = {
        "_TELEOP_RT_COMPLETE": "complete_bash",
        "COMP_WORDS": typed,
        "COMP_CWORD": str(len(typed.split()) - 1),
    }
    done = subprocess.run(
        [sys.executable, "-c", LOADING], env=os.environ | asked, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert completed in done.stdout.split()
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("loaded "))
    assert set(line.split()).isdisjoint({*HEAVY, *DEVICES})


GROUPS = ("study", "calibrate")
EVERY_COMMAND = (
    f"GROUPS = {GROUPS}"
    """
import os, sys
from teleop_rt.__main__ import main
from teleop_rt.cli import app

def ask(*arguments, **environment):
    os.environ.update(environment)
    sys.argv[:] = ["teleop-rt", *arguments]
    try:
        main()
    except SystemExit:
        pass

names = [[name] for name in app.commands]
names += [[group, name] for group in GROUPS for name in app.load(group).commands]
for name in names:
    ask(*name, "--help")
for name in names:
    words = " ".join(["teleop-rt", *name, "--"])
    ask(_TELEOP_RT_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=str(len(name) + 1))
print("loaded", *sys.modules, file=sys.stderr)
"""
)


def test_help_and_completion_of_every_command_load_no_compiler_and_no_driver():
    done = subprocess.run(
        [sys.executable, "-c", EVERY_COMMAND], capture_output=True, text=True, check=True
    )
    usages = re.findall(r"Usage: teleop-rt ([\w-]+(?: [a-z][\w-]*)?)", done.stdout)
    asked = [*app.commands, *(f"{g} {name}" for g in GROUPS for name in app.load(g).commands)]
    assert sorted(usages) == sorted(asked)
    for option in ("--models", "--solvers", "--arm", "--foxglove", "--cycles", "--topic", "--mode"):
        assert option in done.stdout.partition("--help\n")[2].split(), option
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("loaded "))
    loaded = set(line.split()) - {"teleop_rt_drivers", "teleop_rt_drivers.commands"}
    assert loaded.isdisjoint({*HEAVY, *DEVICES})
    assert not any(name.startswith("teleop_rt_drivers") for name in loaded)


def test_the_ids_that_the_help_lists_are_all_that_there_are():
    assert tuple(MODELS) == tuple(BASE_MODELS) == MODEL_IDS
    assert tuple(TERMS) == TERM_IDS


def test_what_runs_beside_the_loop_loads_neither_solvers_nor_drivers():
    beside = "import sys, teleop_rt.service.server, teleop_rt.trial.recorder_main as _; "
    beside += "print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", beside], capture_output=True, text=True, check=True
    )
    modules = set(done.stdout.split())
    assert "teleop_rt.service.server" in modules
    assert modules.isdisjoint({*HEAVY, *DEVICES, "rich", "asyncio"})


A_SLAVE = """
import sys, tempfile
from pathlib import Path
import teleop_rt.cli.side_mains
print(*sys.modules)
from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.shipped import example
from teleop_rt.trial.lockstep_run import LockstepTrial
trial = example("trials", "silicone_cube")
with tempfile.TemporaryDirectory() as rings:
    world = LockstepTrial(load_trial_file(trial, []), trial.parent, open_bench, Path(rings))
    world.slave.configure()
    while world.slave.safety.state.name != "RUN":
        world.step()
print(*sys.modules)
"""


def test_a_slave_that_runs_has_loaded_nothing_that_draws_prints_tables_or_fits():
    done = subprocess.run(
        [sys.executable, "-c", A_SLAVE], capture_output=True, text=True, check=True
    )
    begun, running = (set(line.split()) for line in done.stdout.splitlines())
    assert "teleop_rt.slave.slave" in begun
    unwanted = {"scipy", "matplotlib", "bokeh", "jinja2", "coverage"}
    unwanted |= {"teleop_rt.view", "teleop_rt.diagnosis"}
    assert running & unwanted == set()
    # The log of a whole run prints by rich, and on simulated time the rig is in this process.
    assert begun & {*unwanted, "rich", "teleop_rt_drivers.simulated.rig"} == set()


AT_THE_END = """
import atexit, gc, sys
from teleop_rt.__main__ import program
visited = []
gc.callbacks.append(lambda phase, _: visited.append(len(gc.get_objects())))
atexit.register(lambda: print(max(visited, default=0), len(gc.get_objects()), len(sys.modules)))
sys.argv = ["teleop-rt", "check", "silicone_cube"]
program()
"""


def test_a_command_begins_and_ends_without_looking_through_all_that_it_loaded():
    done = subprocess.run(
        [sys.executable, "-c", AT_THE_END], capture_output=True, text=True, check=True
    )
    visited, left, modules = map(int, done.stdout.splitlines()[-1].split())
    assert modules > 500
    assert visited < 10_000
    assert left < 10_000


def test_what_the_help_says_of_a_command_is_what_the_command_says_of_itself():
    for name, command in app.load_all().items():
        first_paragraph = " ".join((command.help or "").split("\n\n")[0].split())
        assert app.commands[name].help == first_paragraph, name
        assert app.commands[name].hidden == command.hidden, name


def test_the_version_is_one_line_with_commit_python_and_numba(call):
    code, out, _ = call("--version")
    assert code == 0
    assert out.startswith(f"teleop-rt {__version__}")
    for words in (f"Python {platform.python_version()}", f"numba {metadata.version('numba')}"):
        assert words in out
    commit = subprocess.run(
        ["git", "-C", Path(__file__).parent, "rev-parse", "--short=7", "HEAD"],  # noqa: S607
        capture_output=True, text=True, check=False,
    ).stdout.strip()  # fmt: skip
    assert (f"(commit {commit}" in out) if commit else "commit" not in out


def test_the_help_groups_the_commands_and_completion_is_installed_at_the_top(call):
    code, out, _ = call("--help")
    assert code == 0
    panels = [line.split("─ ")[1].split(" ─")[0] for line in out.splitlines() if "╭─" in line]
    assert panels == ["Options", "Run a trial", "On the rig", "Recordings and runs", "Tools"]
    assert "--install-completion" in out
    assert "--install-completion" not in call("study", "--help")[1]


def every_command():
    """Return every command, those of groups too, by the words that call it."""
    commands = dict(app.load_all())
    for group in GROUPS:
        commands |= {f"{group} {name}": one for name, one in commands[group].commands.items()}
    return commands


def test_no_word_in_brackets_is_lost_from_a_help_text():
    """Rich takes a unit such as [s] for a style, and drops it."""
    for name, command in every_command().items():
        for words in (command.help, *(getattr(one, "help", None) for one in command.params)):
            assert render(words or "").plain == (words or ""), name


def test_no_flag_of_any_command_shows_a_type(call):
    for name in every_command():
        code, out, _ = call(*name.split(), "--help")
        assert code == 0, name
        assert "bool" not in out, name


@pytest.mark.parametrize("ids", [MODELS, SOLVERS, REGRESSIONS])
def test_the_help_of_replay_lists_every_model_solver_and_regression(call, ids):
    _, out, _ = call("replay", "--help")
    words = set(re.findall(r"[\w-]+", out))
    assert set(ids) <= words


def test_a_command_is_loaded_when_it_is_called_and_no_other():
    group = LazyGroup(
        "some commands",
        {
            "here": LazyCommand("teleop_rt.cli.keygen:keygen", "There is one."),
            "gone": LazyCommand("teleop_rt.cli.nowhere:gone", "There is none."),
        },
    )
    context = group.make_context("group", ["here"])
    name, command, rest = group.resolve_command(context, ["here", "file"])
    assert (name, rest) == ("here", ["file"])
    assert command.params[0].name == "path"
    with pytest.raises(ModuleNotFoundError, match="nowhere"):
        group.resolve_command(context, ["gone"])
