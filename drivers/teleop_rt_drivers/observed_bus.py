"""A CAN bus that notes when each frame came: for the doctor, who judges timing and jitter."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import can
import numpy as np

from teleop_rt_drivers.ends import DaemonEnds
from teleop_rt_drivers.findings import Finding

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from teleop_rt_drivers.bus import BusConfig

LATE_SHARE = 0.8
"""Share of a period after which an answer to SYNC is in danger of missing its cycle."""
JITTER_SHARE = 0.5
"""Of the mean period: a larger deviation (99 %) is a warning."""


class ObservedBus(can.BusABC):
    """Passes everything on, and keeps the arrival of each id, and of each SYNC that was sent."""

    def __init__(
        self, bus: can.BusABC, sync_cob_id: int | None, clock_s: Callable[[], float] = time.time
    ) -> None:
        self.channel_info = bus.channel_info
        self.arrivals: dict[int, list[float]] = {}
        self.delays: dict[int, list[float]] = {}
        self._bus = bus
        self._sync_cob_id = sync_cob_id
        self._clock_s = clock_s
        self._sync_s = 0.0
        super().__init__(channel="observed")
        self._is_shutdown = True  # `shutdown` releases all there is

    def forget(self) -> None:
        """Start recording again."""
        self.arrivals.clear()
        self.delays.clear()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; note the time of a SYNC."""
        if msg.arbitration_id == self._sync_cob_id:
            self._sync_s = self._clock_s()
        self._bus.send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame and record its arrival, by the kernel's stamp if there is one."""
        message = self._bus.recv(timeout)
        if message is not None and not message.is_error_frame:
            stamp_s = message.timestamp or self._clock_s()
            self.arrivals.setdefault(message.arbitration_id, []).append(stamp_s)
            self.delays.setdefault(message.arbitration_id, []).append(stamp_s - self._sync_s)
        return message

    def fileno(self) -> int:
        """Return the descriptor, for waiting on it."""
        return self._bus.fileno()

    def flush_tx_buffer(self) -> None:
        """Drop the frames that wait to be sent."""
        self._bus.flush_tx_buffer()

    def shutdown(self) -> None:
        """Release the bus."""
        self._bus.shutdown()

    def timing(self, names: Mapping[int, str], period_s: float) -> list[Finding]:
        """Return period, jitter and, on CANopen, the delay after SYNC of each named frame."""
        return [self._timing(name, can_id, period_s) for can_id, name in names.items()]

    def _timing(self, name: str, can_id: int, period_s: float) -> Finding:
        stamps = self.arrivals.get(can_id, [])
        where = f"frame 0x{can_id:03X}"
        if len(stamps) < 3:
            step = "compare mapping, COB-ID or DBC with the device"
            return Finding(
                "error", f"{name} was received {len(stamps)} times, too few to measure", where, step
            )
        steps_us = 1e6 * np.diff(stamps)
        mean_us = float(steps_us.mean())
        jitter_us = float(np.percentile(abs(steps_us - mean_us), 99))
        what = f"{name} comes every {mean_us:.1f} us, within {jitter_us:.1f} us (p99)"
        late = False
        if self._sync_cob_id is not None:
            delay_us = 1e6 * np.percentile(self.delays[can_id], (50, 99))
            what += f", {delay_us[0]:.0f} us (p50), {delay_us[1]:.0f} us (p99) after SYNC"
            late = bool(delay_us[1] > 1e6 * LATE_SHARE * period_s)
        if late or jitter_us > JITTER_SHARE * mean_us:
            step = "lower rate_hz or the bus load, and end programs that load this machine"
            return Finding("warning", what, where, step)
        return Finding("ok", what, where)


class ObservingEnds(DaemonEnds):
    """The daemon's ends, each bus observed under the name of its part."""

    def __init__(self, sync_cob_ids: Mapping[str, int]) -> None:
        super().__init__()
        self.observed: dict[str, ObservedBus] = {}
        self._sync_cob_ids = sync_cob_ids

    def bus(self, key: str, config: BusConfig) -> ObservedBus:
        """Open a CAN bus, observed. Raises AxisError."""
        self.observed[key] = ObservedBus(super().bus(key, config), self._sync_cob_ids.get(key))
        return self.observed[key]
