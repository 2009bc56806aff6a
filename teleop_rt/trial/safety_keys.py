"""The keys of summary.json on the slave's safety chain."""

from __future__ import annotations

from typing import Literal, NotRequired

from teleop_rt.json_schema import Keys


class FaultAtEnd(Keys):
    """The fault in which a run ended."""

    code: int | None
    """Number of the fault, 0 for none; null if the process ended before it could report it."""
    name: str
    """Name of the fault, `none` without one."""
    cause: str
    """Its cause, as a sentence."""
    next_step: str
    """The next step, as a sentence."""
    said: NotRequired[str | None]
    """The device's own report of it; null if there was none, absent if it is not known."""


class TareFound(Keys):
    """Offset of the force sensor, found at rest; null where the tare was not finished."""

    offset: float | None
    """Offset [N or Nm]; null where the tare was not finished."""
    noise: float | None
    """Standard deviation of the noise [N or Nm]; null where the tare was not finished."""
    drift: float | None
    """Slope over the tare [N/s or Nm/s]; null where the tare was not finished."""


class ZerosFound(Keys):
    """The rig's zeros, as found before the run."""

    tare: TareFound | None
    """Zero of the force; null where the rig asks for no tare."""
    shift: float | None
    """Shift of the position by homing [m or rad]; null where the rig asks for no homing."""


class Safety(Keys):
    """The end of the slave's safety chain; values that its process could not report are absent."""

    state: Literal[
        "BOOT",
        "SELFTEST",
        "DISARMED",
        "ARMED",
        "RUN",
        "HOLD",
        "SAFE_STOP",
        "FAULT",
        "UNKNOWN",
    ]
    """State of the chain at the end; UNKNOWN where the process died."""
    fault: FaultAtEnd
    """The fault in which the run ended."""
    unsafe: NotRequired[list[str]]
    """Protections that the rig lacks, as sentences."""
    commands_limited: NotRequired[int]
    """Number of limited commands."""
    samples_rejected: NotRequired[int]
    """Number of rejected samples."""
    followings: NotRequired[int]
    """Number of times that the slave began to follow the master."""
    holds: NotRequired[int]
    """Number of times that the slave held its position."""
    reference: NotRequired[ZerosFound]
    """The rig's zeros."""
