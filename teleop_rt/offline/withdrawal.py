"""Withdrawal of an extended model: on fresh data it must not increase any error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

WITHDRAWN = "withdrawn.yaml"
_FREE_RUN, _ON_LINE = "force predicted in free run", "force predicted on-line"
_NO_FIGURE = {
    _FREE_RUN: "with the effects it cannot be predicted",
    _ON_LINE: "with the effects no estimate predicts it",
}
"""Why an error has no figure with the extended model, where one reason only is possible."""
_RUN_TO_RUN_FACTOR = 1.1
"""Factor by which an error may differ between two runs of one model."""


def keep_or_withdraw(
    model: Path, fresh: Mapping[str, Any], why_on_line: Callable[[], str | None] | None = None
) -> dict[str, Any]:
    """Return the answer's entries on an extended model with these errors on fresh data.

    If the model increases an error, its file is renamed, so that nobody uses it by its name.
    `why_on_line` says where a larger error of the on-line prediction comes from.
    """
    worse = made_worse(fresh)
    if why_on_line is not None and any(_ON_LINE in one for one in worse):
        why = why_on_line()
        worse = [f"{one} ({why})" if why and _ON_LINE in one else one for one in worse]
    if not worse:
        return {"extended_model": str(model), "withdrawn": None}
    kept = model.rename(model.with_name(WITHDRAWN))
    return {
        "extended_model": None,
        "withdrawn": worse,
        "reason": "the extended model increases errors on fresh data, so it is withdrawn (kept as"
        f" {kept}): {'; '.join(worse)}",
    }


def made_worse(fresh: Mapping[str, Any]) -> list[str]:
    """Return the errors on fresh data that the extended model made worse, in words.

    Below the noise floor of the force errors cannot be distinguished.
    """
    slave = fresh["slave"]
    floor = slave["free_run"]["noise_floor"] or 0.0
    found = []
    for words, error in (
        (_FREE_RUN, slave["free_run"]),
        (_ON_LINE, slave["on_line"]),
        ("force felt at the hand", fresh["master"]),
    ):
        before, after = error["before"], error["after"]
        if before is None:
            continue
        if after is None:
            without = _NO_FIGURE.get(words, "is unknown after")
            found.append(f"{words}, {before:.4f} before, {without}")
        elif after > max(_RUN_TO_RUN_FACTOR * before, floor):
            found.append(f"{words}, {before:.4f} before, is {after:.4f} after")
    return found
