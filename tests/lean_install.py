"""An installation without the extra `report`, as a rig's own computer may be."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


def without_report(folder: Path) -> dict[str, str]:
    """Return an environment whose Python finds no matplotlib, so that a run draws no report.

    A report takes longer to draw than most of these runs.
    """
    lean = folder / "lean"
    lean.mkdir(parents=True, exist_ok=True)
    (lean / "matplotlib.py").write_text("raise ImportError('the extra report is not installed')\n")
    path = os.pathsep.join(filter(None, (str(lean), os.environ.get("PYTHONPATH"))))
    return os.environ | {"PYTHONPATH": path}


@contextmanager
def without_pages() -> Iterator[None]:
    """Let this process find no module that draws pages, as without the extra `report`."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("teleop_rt.view.commands", "teleop_rt.view.diagnosis_page"):
            patch.setitem(sys.modules, module, None)
        yield
