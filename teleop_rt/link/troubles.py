"""Why no session stands, or none is followed: reported by either side, and in the log."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # status names these troubles beside the loop, where no compiler is loaded
    from teleop_rt.link.statistics import Statistics

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
    ("rate", "the peer's rate is outside of this side's link.accepted_rates_hz"),
    ("magic", "a foreign program sends to this port: choose another"),
    (
        "nothing",
        (
            "nothing has arrived from the peer: check that it runs, its address and port, and that "
            "both sides have the same key and version; a packet that does not verify is not "
            "answered, nor an operator whose line was removed from the rig's key file"
        ),
    ),
    (
        "clock",
        (
            "messages come later than when the axis was armed, or the peer's clock has changed: "
            "stop and arm again, or give link.one_way_max_ms"
        ),
    ),
    (
        "taken",
        ("another master has taken the slave over: agree on who leads, and start this one again"),
    ),
)
"""The counter's name, and the message to the operator."""
NOTHING_TROUBLE, CLOCK_TROUBLE, TAKEN_TROUBLE = 5, 6, 7
"""Places of these three in the table above."""


def first_refusal(statistics: Statistics) -> int:
    """Return the index of the first trouble for which packets are rejected now, or 0.

    A packet that was accepted since shows that the keys are right: those before were an attacker's.
    """
    for index, (reason, _) in enumerate(TROUBLES):
        if statistics.is_rejecting(reason):
            return index
    return 0
