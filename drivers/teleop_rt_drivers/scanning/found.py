"""A device that answered: what of it belongs into a rig's file, and what it says that it is."""

from __future__ import annotations

from typing import NamedTuple

Value = int | float | str


class Found(NamedTuple):
    """Keys of the rig's section of the device with their values, and the device in words."""

    number: int
    values: dict[tuple[str, ...], Value]
    words: str
