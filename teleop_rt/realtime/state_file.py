"""State files that other processes read: small JSON files in a session's shared memory."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def leave(path: Path, content: Any) -> None:
    """Leave JSON: whoever reads it reads all of it, or what was there before; we alone write it."""
    unfinished = path.with_name(f"{path.name}.part")
    unfinished.unlink(missing_ok=True)
    unfinished.touch(mode=0o640)
    unfinished.write_text(json.dumps(content), encoding="utf-8")
    unfinished.rename(path)


def found(path: Path) -> dict[str, Any] | None:
    """Return what was left, None before the first time."""
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    return content
