"""Which software ran, and where: what a reader of a summary needs to repeat it."""

from __future__ import annotations

import platform
import shutil
import subprocess
from pathlib import Path

from teleop_rt import __version__

_TIMEOUT_S = 5.0


def software() -> dict[str, str | None]:
    """Return version, commit of the source tree (None where it is none), Python and platform."""
    return {
        "version": __version__,
        "commit": _commit(Path(__file__).parents[2]),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


def _commit(tree: Path) -> str | None:
    """Return the commit that a source tree stands at, `-dirty` where it was changed since."""
    git = shutil.which("git")
    if git is None or not (tree / ".git").exists():
        return None
    try:
        told = subprocess.run(  # noqa: S603 - git itself, on our own source tree
            [git, "-C", str(tree), "describe", "--always", "--dirty", "--exclude=*"],
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return told.stdout.strip() or None
