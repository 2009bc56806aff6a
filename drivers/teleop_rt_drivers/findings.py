"""Findings of `check` and `doctor`, each with cause, place and next step."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

Severity = Literal["ok", "warning", "danger", "error"]
"""A danger is known and allowed: a safeguard that the rig goes without."""


_WORST_FIRST: tuple[Severity, ...] = ("error", "danger", "warning")


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    severity: Severity
    what: str
    where: str
    next_step: str = ""

    def __str__(self) -> str:
        tail = f"; {self.next_step}" if self.next_step else ""
        return f"{self.severity:7} {self.where}: {self.what}{tail}"

    def as_dict(self) -> dict[str, str]:
        """Return the finding for JSON."""
        return asdict(self)


def worst(findings: list[Finding]) -> Severity:
    """Return the worst severity of all."""
    for severity in _WORST_FIRST:
        if any(finding.severity == severity for finding in findings):
            return severity
    return "ok"
