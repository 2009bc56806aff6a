"""The trials and rigs that ship with the package, found by name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path

from teleop_rt.errors import ExpectedError

EXAMPLES = Path(__file__).parent / "examples"
"""In the repository a link to `config`, of whose files a wheel holds copies."""


class NoConfigError(ExpectedError):
    """A trial or rig was named that is neither a file nor an example."""


def example_names(kind: str) -> list[str]:
    """Return the names of the examples of a kind: `trials` or `rigs`."""
    return sorted(path.stem for path in (EXAMPLES / kind).glob("*.yaml"))


def example(kind: str, name: str) -> Path:
    """Return the file of an example. Raises NoConfigError, which lists those there are."""
    if name not in example_names(kind):
        raise NoConfigError(f"{name}: is not an example; {meant(name, (kind,))}")
    return EXAMPLES / kind / f"{name}.yaml"


def describe(file: Path) -> str:
    """Return the first sentence of the comment that a config begins with."""
    lines = file.read_text(encoding="utf-8").splitlines()
    comments = (line.lstrip("# ") for line in lines if line.startswith("# "))
    first = next((line for line in comments if not line.startswith("yaml-language-server")), "")
    return first.partition(". ")[0].rstrip(".")


def trial_file(named: str | Path) -> Path:
    """Return the trial that is named: a file, else the example of that name.

    Raises NoConfigError for a bare name of neither; a path is left to who opens it.
    """
    return _found(Path(named), ("trials",))


def config_file(named: str | Path) -> Path:
    """Return the trial or rig that is named, found and refused as by `trial_file`."""
    return _found(Path(named), ("trials", "rigs"))


def _found(given: Path, kinds: tuple[str, ...]) -> Path:
    named = str(given)
    if given.exists() or given.name != named or given.suffix:
        return given
    for kind in kinds:
        if named in example_names(kind):
            return example(kind, named)
    raise NoConfigError(
        f"{named}: no such file, and no example of that name; {meant(named, kinds)}"
    )


def meant(named: str, kinds: Iterable[str]) -> str:
    """Return the example that was probably meant, else those there are, by their kind."""
    known = {kind: example_names(kind) for kind in kinds}
    near = difflib.get_close_matches(named, sorted(set().union(*known.values())), n=1)
    if near:
        return f"did you mean {near[0]!r}?"
    return "; ".join(f"shipped {kind}: {', '.join(names)}" for kind, names in known.items())
