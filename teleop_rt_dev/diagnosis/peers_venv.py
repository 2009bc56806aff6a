"""The peers of diagnosis in an environment of their own, so that none of their needs meets ours."""

from __future__ import annotations

import subprocess
import sys
import venv
from pathlib import Path

from teleop_rt_dev.paths import ROOT

ENVIRONMENT = ROOT / ".venv-peers"
PACKAGES = ("pysindy", "sysidentpy")


def peers_python() -> Path | None:
    """Return the interpreter of the peers' environment, made at the first call; None without."""
    python = ENVIRONMENT / "bin" / "python"
    stamp = ENVIRONMENT / "peers.stamp"
    if not stamp.exists():
        venv.create(ENVIRONMENT, with_pip=True)
        for package in PACKAGES:
            install = [str(python), "-m", "pip", "install", "--quiet", package]
            if subprocess.run(install, check=False).returncode != 0:
                print(f"peer {package} could not be installed", file=sys.stderr)
                return None
        stamp.touch()
    return python
