"""Summary and truth as they were written into a run folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from teleop_rt.errors import RecordingError
from teleop_rt.trial.folder import SUMMARY


def read_summary(folder: Path) -> dict[str, Any] | None:
    """Return summary.json, None where the run has left none, or only a part of one.

    Raises RecordingError where it may not be read.
    """
    return written_json(folder / SUMMARY)


def written_json(path: Path) -> dict[str, Any] | None:
    """Return the JSON object of a file; None where it is missing, or was not written to its end.

    A power failure, or a copy to a full disk, leaves an empty or cut off file. Raises
    RecordingError for a file that may not be read.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None
    except OSError as error:
        raise RecordingError(
            f"{path}: cannot be read: {error.strerror}: let this user read it (`chmod u+r`)"
        ) from None
    return content if isinstance(content, dict) else None
