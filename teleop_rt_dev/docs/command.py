"""Build the documentation into build/site, or make its pictures and figures again.

Without a name it builds, and options go to mkdocs. `pictures [FOLDER] [--still]`: by the commands
of the tutorial, still without the live page; `gallery [RUNS]`: every page at two widths, light and
dark; `notebook`: the example and its outputs.
Pictures and gallery need chromium and chromium-driver.
"""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Sequence

from teleop_rt_dev.paths import ROOT

MADE = ("pictures", "gallery", "notebook")


def main(arguments: Sequence[str]) -> int:
    """Make the part that the first argument names, or build all pages with options of mkdocs."""
    if arguments and arguments[0] in {"-h", "--help"}:
        print(f"usage: teleop-rt-dev docs [{' | '.join(MADE)} | OPTIONS]\n\n{__doc__}")
        return 0
    if arguments and arguments[0] in MADE:
        code: int = importlib.import_module(f"{__package__}.{arguments[0]}").main(arguments[1:])
        return code
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", *arguments]
    return subprocess.run(words, cwd=ROOT, check=False).returncode
