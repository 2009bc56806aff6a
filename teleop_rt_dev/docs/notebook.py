"""Run docs/example.ipynb and keep its outputs: `scripts/docs notebook`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from teleop_rt_dev.paths import ROOT

NOTEBOOK = ROOT / "docs" / "example.ipynb"
TIMEOUT_S = 300.0  # of one cell, on a loaded machine


def run(path: Path) -> nbformat.NotebookNode:
    """Return the notebook as it is after all its cells have run in a kernel of their own."""
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(notebook, timeout=TIMEOUT_S, record_timing=False)
    client.create_kernel_manager().transport = "ipc"  # files, no ports of this machine
    client.execute()
    notebook.metadata["language_info"] = {"name": "python"}  # not of which version
    result: nbformat.NotebookNode = notebook
    return result


def main(_arguments: Sequence[str]) -> int:
    nbformat.write(run(NOTEBOOK), NOTEBOOK)
    print(f"outputs kept in {NOTEBOOK}")
    return 0
