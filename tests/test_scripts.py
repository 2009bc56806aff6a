"""Messages of the set-up on a machine that lacks something, without touching any .venv."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOOLS = ("bash", "cat", "chmod", "cksum", "cp", "dirname", "mkdir")
OLD_PYTHON = "#!/bin/sh\nexit 1\n"
NO_VENV = '#!/bin/sh\ncase "$*" in *version_info*) exit 0;; esac\nexit 1\n'


RECORDING = '#!/bin/sh\necho "$*" >>"$(dirname "$0")/asked"\n'
INSTALLS_UV = (
    RECORDING
    + """
case "$*" in *" uv") cp "$(dirname "$0")/uv-of-the-index" "$(dirname "$0")/uv" ;; esac
"""
)
SET_UP = """
. scripts/setup.sh
setup_venv report,live
setup_venv report,test
setup_venv live,test
setup_venv live
echo "# another pin" >>constraints.txt
setup_venv test
setup_venv live
"""


def clone_of(folder, *scripts):
    clone = folder / "clone"
    (clone / "scripts").mkdir(parents=True)
    for name in ("setup.sh", *scripts):
        shutil.copy(ROOT / "scripts" / name, clone / "scripts" / name)
    for name in ("pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, clone / name)
    return clone


def tools_in(folder, **programs):
    """Make a folder for PATH: the few tools that the scripts need, and these programs."""
    folder.mkdir()
    for name in TOOLS:
        found = shutil.which(name)
        assert found is not None
        (folder / name).symlink_to(found)
    for name, text in programs.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    return folder


ALL = ["report,live", "report,test", "test", "live"]
FAILING = RECORDING + "exit 1\n"


@pytest.mark.parametrize(
    ("uv", "of_the_index", "installed"),
    [
        (None, RECORDING, {"bin/uv": [], "python": ["uv"], "uv": ALL}),
        (
            None,
            None,
            {"bin/uv": [], "python": ["uv", ALL[0], "uv", ALL[1], "uv", ALL[2], "uv", ALL[3]]},
        ),
        (RECORDING, RECORDING, {"bin/uv": ALL, "python": [], "uv": []}),
        (FAILING, RECORDING, {"bin/uv": ALL, "python": ALL, "uv": []}),
    ],
    ids=["without uv", "with no uv in the index", "with uv", "with a uv that fails"],
)
def test_what_is_installed_is_not_installed_again_before_a_pin_changes(
    tmp_path, uv, of_the_index, installed
):
    clone = clone_of(tmp_path)
    python = clone / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(INSTALLS_UV if of_the_index else RECORDING)
    python.chmod(0o755)
    if of_the_index:
        (python.parent / "uv-of-the-index").write_text(of_the_index)
        (python.parent / "uv-of-the-index").chmod(0o755)
    programs = {"python3": OLD_PYTHON.replace("1", "0"), **({"uv": uv} if uv else {})}
    tools = tools_in(tmp_path / "bin", **programs)
    done = subprocess.run(
        [tools / "bash", "-euc", SET_UP], cwd=clone, check=True, capture_output=True, text=True,
        env={"PATH": str(tools)},
    )  # fmt: skip
    ours = [line for line in asked_of(python.parent) if str(clone) in line]
    assert wanted_of(line for line in ours if "--python" in line) == installed.get("uv", [])
    assert wanted_of(line for line in ours if "--python" not in line) == installed["python"]
    assert wanted_of(asked_of(tools)) == installed["bin/uv"]
    result = [line for line in done.stderr.splitlines() if line.startswith("packages for ")]
    assert len(result) == 4
    assert all(re.fullmatch(r"packages for [a-z,]+ \.\.\. \d+\.\d s", line) for line in result)


def asked_of(folder):
    """Return the arguments of a folder's programs."""
    path = folder / "asked"
    return path.read_text().splitlines() if path.exists() else []


def wanted_of(lines):
    """Return the request of each installation: extras of ours, or a package."""
    return [
        line.rpartition("[")[2].rstrip("]") if line.endswith("]") else line.split()[-1]
        for line in lines
        if " install " in line
    ]


def test_a_failed_installation_names_its_log_and_keeps_the_noise_there(tmp_path):
    clone = clone_of(tmp_path, "run")
    python = clone / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\necho a lot of noise\nexit 1\n")
    python.chmod(0o755)
    tools = tools_in(tmp_path / "bin", python3=OLD_PYTHON.replace("1", "0"))
    done = subprocess.run(
        [tools / "bash", clone / "scripts" / "run"], env={"PATH": str(tools)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    log = clone / ".venv" / "setup.log"
    assert str(log) in done.stderr
    assert "noise" not in done.stderr
    assert "noise" in log.read_text()


@pytest.mark.parametrize("script", ["run", "test"])
@pytest.mark.parametrize(
    ("python", "words"),
    [(OLD_PYTHON, "needs Python 3.11 or newer"), (NO_VENV, "venv module is missing")],
)
def test_a_missing_venv_or_an_old_python_gets_one_clear_sentence(tmp_path, script, python, words):
    clone = clone_of(tmp_path, script)
    tools = tools_in(tmp_path / "bin", python3=python)
    done = subprocess.run(
        [tools / "bash", clone / "scripts" / script],
        env={"PATH": str(tools), "HOME": os.environ.get("HOME", "/")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    (sentence,) = done.stderr.splitlines()
    assert words in sentence
    assert "apt install" in sentence
    assert not (clone / ".venv").exists()


def test_every_test_file_that_the_suite_runs_without_compiler_exists():
    """A renamed file would end the whole suite with an error of pytest after minutes."""
    script = (ROOT / "scripts" / "test").read_text(encoding="utf-8")
    rules = re.search(r"^rules=\(.*?\)$", script, re.MULTILINE | re.DOTALL)[0]
    listed = subprocess.run(
        ["/bin/bash", "-c", rules + '\nprintf "%s\\n" "${rules[@]}"'],
        capture_output=True, text=True, check=True,
    ).stdout.split()  # fmt: skip
    files = [name for name in listed if name.endswith(".py")]
    assert len(files) > 10
    assert [name for name in files if not (ROOT / name).is_file()] == []
