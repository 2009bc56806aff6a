"""Why no session stands: told by either side, and in the log."""

from __future__ import annotations

TROUBLES: tuple[tuple[str, str], ...] = (
    ("", ""),
    (
        "authentication",
        "packets arrive that were made with another key: both sides need the same",
    ),
    (
        "version",
        "packets arrive of another protocol version: install the same on both sides",
    ),
    ("rate", "the peer's rate is outside of what this side accepts"),
    ("magic", "a foreign program sends to this port: choose another"),
    (
        "nothing",
        (
            "nothing has arrived from the peer: check that it runs, its address and port, and that "
            "both sides have the same key and version, for what does not verify is not answered"
        ),
    ),
)
"""Why no session stands: the counter's name, and what the operator is told."""
