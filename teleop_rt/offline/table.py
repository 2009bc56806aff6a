"""The layout of a foreign table, given on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Table:
    """Layout of a foreign file: column and unit by role, and the rate if there is no time."""

    columns: Mapping[str, str]
    units: Mapping[str, str]
    rate_hz: float | None
