"""The keys of summary.json on the time of a loop: stalls, latency, work."""

from __future__ import annotations

from typing import Literal

from teleop_rt.json_schema import Keys


class LateBounds(Keys):
    """Bounds of lateness."""

    hold_ms: float
    """Stall from which the axis holds [ms]."""
    stop_ms: float
    """Stall from which the axis stops [ms]."""
    stop_share: float
    """Share of a second's ticks that may be late before the axis stops [1]."""


class LateStop(Keys):
    """The stop that lateness asked for."""

    after_s: float
    """Time under power until then [s]."""
    bound: Literal["stop_ms", "stop_share"]
    """The bound that was passed."""
    stall_ms: float
    """The stall of that tick [ms]."""


class LateByBounds(Keys):
    """Lateness of a loop under power, judged by one set of bounds."""

    bounds: LateBounds
    """The bounds that judged it."""
    longest_stall_ms: float
    """Longest stall [ms]."""
    late_ticks: int
    """Number of deadlines without a tick."""
    holds: int
    """Number of stalls above hold_ms."""
    stop: LateStop | None
    """The stop that was asked for; null if there was none."""


class LoopLateness(LateByBounds):
    """Lateness of a loop under power."""

    on_hardware: LateByBounds
    """The same judged by the default bounds of hardware."""


class Quantiles(Keys):
    """Quantiles of a time over all ticks."""

    p50: float
    """Median [us]."""
    p99: float
    """99 % quantile [us]."""
    p999: float
    """99.9 % quantile [us]."""
    max: float
    """Maximum [us]."""
