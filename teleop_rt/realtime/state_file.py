"""State files that other processes read: small JSON files in a ring folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def leave(path: Path, content: Any) -> None:
    """Write JSON as a whole: a reader gets all of it, or the former one; we alone write it."""
    unfinished = path.with_name(f"{path.name}.part")
    unfinished.unlink(missing_ok=True)
    unfinished.touch(mode=0o640)
    unfinished.write_text(json.dumps(content), encoding="utf-8")
    unfinished.rename(path)


def found(path: Path) -> dict[str, Any] | None:
    """Return the JSON, None before the first write."""
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    return content
