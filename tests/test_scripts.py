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


@pytest.mark.parametrize("script", ["run", "test"])
@pytest.mark.parametrize(
    ("python", "words"),
    [(OLD_PYTHON, "needs Python 3.11 or newer"), (NO_VENV, "venv module is missing")],
)
def test_a_missing_venv_or_an_old_python_gets_one_clear_sentence(tmp_path, script, python, words):
    clone, tools = tmp_path / "clone", tmp_path / "bin"
    (clone / "scripts").mkdir(parents=True)
    tools.mkdir()
    for name in ("setup.sh", script):
        shutil.copy(ROOT / "scripts" / name, clone / "scripts" / name)
    for name in ("pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, clone / name)
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
