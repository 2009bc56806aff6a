"""The peers of diagnosis in an environment of their own, so that none of their needs meets ours."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import venv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt_dev.diagnosis import peers
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


def answers_of_peers(arrays: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return every peer's answer to every record, in their environment; none without it."""
    python = peers_python()
    if python is None:
        return []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "records.npz"
        np.savez(file, **arrays)
        printed = subprocess.run(
            [str(python), "-P", peers.__file__, str(file)],
            check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip
    return [json.loads(line) for line in printed.splitlines()]
