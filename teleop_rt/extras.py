"""Packages that only some commands need: how to add them where this program runs."""

from __future__ import annotations

import re
import shlex
from importlib.metadata import PackageNotFoundError, requires

_DISTRIBUTION = "teleop-rt"
_OF_EXTRA = re.compile(r"""^(?P<package>[^;]+?)\s*;\s*extra\s*==\s*["'](?P<extra>[^"']+)["']$""")


def install_command(extra: str) -> str:
    """Return the command that installs the packages of an extra.

    It names the packages, as this program's metadata has them: the program itself may come from a
    clone or a wheel and then be in no index.
    """
    try:
        declared = requires(_DISTRIBUTION) or ()
    except PackageNotFoundError:  # a source tree that was never installed
        declared = ()
    found = [match for one in declared if (match := _OF_EXTRA.match(one))]
    packages = [one["package"] for one in found if one["extra"] == extra.replace("_", "-")]
    named = packages or [f"{_DISTRIBUTION}[{extra}]"]
    return " ".join(["pip install", *(shlex.quote(one) for one in named)])
