"""What the set-up says on a machine that lacks something, without touching any .venv."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOOLS = ("bash", "cat", "cksum", "dirname")
OLD_PYTHON = "#!/bin/sh\nexit 1\n"
NO_VENV = '#!/bin/sh\ncase "$*" in *version_info*) exit 0;; esac\nexit 1\n'


RECORDING = '#!/bin/sh\necho "$*" >>"$(dirname "$0")/asked"\n'
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


def test_what_is_installed_is_not_installed_again_before_a_pin_changes(tmp_path):
    clone = clone_of(tmp_path)
    python = clone / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(RECORDING)
    python.chmod(0o755)
    subprocess.run(["bash", "-euc", SET_UP], cwd=clone, check=True, capture_output=True)  # noqa: S607
    asked = (python.parent / "asked").read_text().splitlines()
    installs = [line.rpartition("[")[2].rstrip("]") for line in asked if " install " in line]
    assert installs == ["report,live", "report,test", "test", "live"]


@pytest.mark.parametrize("script", ["run", "test"])
@pytest.mark.parametrize(
    ("python", "words"),
    [(OLD_PYTHON, "needs Python 3.11 or newer"), (NO_VENV, "venv module is missing")],
)
def test_a_missing_venv_or_an_old_python_gets_one_clear_sentence(tmp_path, script, python, words):
    clone, tools = clone_of(tmp_path, script), tmp_path / "bin"
    tools.mkdir()
    for name in TOOLS:
        found = shutil.which(name)
        assert found is not None
        (tools / name).symlink_to(found)
    (tools / "python3").write_text(python)
    (tools / "python3").chmod(0o755)
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
