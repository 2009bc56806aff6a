"""How a foreign table is laid out, as the command line says it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Table:
    """How a foreign file is laid out: column and unit by role, and the rate without a time."""

    columns: Mapping[str, str]
    units: Mapping[str, str]
    rate_hz: float | None
