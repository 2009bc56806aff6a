"""A summary as it was written into its run folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from teleop_rt.errors import RecordingError
from teleop_rt.trial.folder import SUMMARY


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Return summary.json, None where the run has left none. Raises RecordingError for no JSON."""
    path = folder / SUMMARY
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RecordingError(
            f"{path}: cannot be read: {error}; `teleop-rt run` writes one, so run the trial again"
        ) from None
    return dict(content)
