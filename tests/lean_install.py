"""An installation without the extra `report`, as a rig's own computer may be."""

import os
from pathlib import Path


def without_report(folder: Path) -> dict[str, str]:
    """Return an environment whose Python finds no matplotlib, so that a run draws no report.

    A report takes longer to draw than most of what these runs show.
    """
    lean = folder / "lean"
    lean.mkdir(parents=True, exist_ok=True)
    (lean / "matplotlib.py").write_text("raise ImportError('the extra report is not installed')\n")
    path = os.pathsep.join(filter(None, (str(lean), os.environ.get("PYTHONPATH"))))
    return os.environ | {"PYTHONPATH": path}
