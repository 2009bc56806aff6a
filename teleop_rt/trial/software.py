"""The software of a run, and its machine: a reader of a summary needs both to repeat it."""

from __future__ import annotations

import json
import platform
import shutil
import subprocess
from importlib import metadata
from pathlib import Path

from teleop_rt import __version__

_TIMEOUT_S = 5.0
"""Longest wait for git, which names the commit."""


def software() -> dict[str, str | None]:
    """Return version, commit (None where it is not known), Python and platform."""
    return {
        "version": __version__,
        "commit": _commit(),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


def version_line() -> str:
    """Return one line: version, commit where it is known, Python and numba."""
    commit = _commit()
    return (
        f"teleop-rt {__version__}"
        f"{'' if commit is None else f' (commit {commit})'}"
        f", Python {platform.python_version()}, numba {metadata.version('numba')}"
    )


def _commit() -> str | None:
    """Return the commit of the source tree, or of the repository that pip installed from."""
    tree = Path(__file__).parents[2]
    return _commit_of_tree(tree) if (tree / ".git").exists() else _commit_of_installation()


def _commit_of_tree(tree: Path) -> str | None:
    """Return the commit that a source tree stands at, `-dirty` where it was changed since."""
    git = shutil.which("git")
    if git is None:
        return None
    try:
        described = subprocess.run(  # noqa: S603 - git itself, on our own source tree
            [git, "-C", str(tree), "describe", "--always", "--dirty", "--exclude=*"],
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return described.stdout.strip() or None


def _commit_of_installation() -> str | None:
    """Return the commit that an installer recorded (PEP 610); None where it was a plain wheel."""
    try:
        origin = metadata.distribution("teleop-rt").read_text("direct_url.json")
    except metadata.PackageNotFoundError:
        return None
    commit = json.loads(origin or "{}").get("vcs_info", {}).get("commit_id")
    return commit if isinstance(commit, str) else None
