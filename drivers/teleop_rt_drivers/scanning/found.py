"""A device that answered: its keys of a rig's file, and its own description."""

from __future__ import annotations

from typing import NamedTuple

Value = int | float | str


class Found(NamedTuple):
    """Keys of the rig's section of the device with their values, and the device in words."""

    number: int
    values: dict[tuple[str, ...], Value]
    words: str
