"""The state that a driver requests of its drive, whatever the drive's protocol calls it."""

from __future__ import annotations

from enum import Enum


class Intent(Enum):
    """The requested state of the drive."""

    IDLE = "no power"
    ARMING = "on the way to following the target"
    RUNNING = "following the target"
    STOPPED = "stopped, and stays so until armed again"


# By these names a tick finds them at once: in Python 3.11 each look-up in an enum is a call.
IDLE, ARMING, RUNNING, STOPPED = Intent
POWERING = (ARMING, RUNNING)
