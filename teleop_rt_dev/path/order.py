"""Draw the order of the packages from the import rule that holds it."""

from __future__ import annotations

import tomllib

from teleop_rt_dev.paths import ROOT


def order() -> str:
    """Return the packages of the core from top to bottom, a line for those on one level."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    rules = settings["tool"]["importlinter"]["contracts"]
    (layers,) = (rule["layers"] for rule in rules if rule.get("containers") == ["teleop_rt"])
    return "\n".join(f"    {layer.replace(' | ', ', ')}" for layer in layers)
