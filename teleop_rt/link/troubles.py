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
            "both sides have the same key and version; a peer with another key, or an operator "
            "removed from the rig's key file, gets no answer"
        ),
    ),
    (
        "clock",
        (
            "messages arrive later than at arming, or the peer's clock has changed: stop and arm "
            "the axis again; if you know the longest delay, set link.one_way_max_ms"
        ),
    ),
    (
        "taken",
        ("another master leads the slave now: agree on who leads, then start this master again"),
    ),
    (
        "silent",
        (
            "the peer has been silent for more than 2 s: check that it runs, and the network; a "
            "peer that was started again with another key, or an operator removed from the rig's "
            "key file, gets no answer"
        ),
    ),
    (
        "authentication",
        (
            "packets arrive damaged or forged, although earlier ones were good: check the network, "
            "and whether the peer was started again with another key"
        ),
    ),
)
"""The counter's name, and the message to the operator."""
KEY_TROUBLE, NOTHING_TROUBLE, CLOCK_TROUBLE, TAKEN_TROUBLE = 1, 5, 6, 7
SILENT_TROUBLE, DAMAGED_TROUBLE = 8, 9
"""Places of these in the table above."""


def first_refusal(statistics: Statistics) -> int:
    """Return the index of the first trouble for which packets are rejected now, or 0.

    A packet that was accepted since shows that the keys are right: those before were an attacker's.
    One that was accepted before shows that they were: another key is then not the likely cause.
    """
    for index, (reason, _) in enumerate(TROUBLES):
        if statistics.is_rejecting(reason):
            known = index == KEY_TROUBLE and statistics.received > 0
            return DAMAGED_TROUBLE if known else index
    return 0


def silent_trouble(statistics: Statistics) -> int:
    """Return the index of the trouble of silence: whether packets had arrived before, or none."""
    return SILENT_TROUBLE if statistics.received > 0 else NOTHING_TROUBLE
