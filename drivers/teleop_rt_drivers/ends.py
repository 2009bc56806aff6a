"""Which end of each bus and line a program opens: the daemon's, the devices', or one in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from teleop_rt_drivers.bus import open_bus
from teleop_rt_drivers.bus_log import LoggedBus, log_file
from teleop_rt_drivers.framed.stream import SerialStream
from teleop_rt_drivers.simulated.pipes import PipeStream, PseudoTerminal, pipe
from teleop_rt_drivers.simulated.synchronous_bus import SynchronousBus, synchronous_pair

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import can

    from teleop_rt_drivers.bus import BusConfig
    from teleop_rt_drivers.framed.stream import ByteStream


class Ends(Protocol):
    """Opens buses and lines; `key` identifies those of one rig."""

    def bus(self, key: str, config: BusConfig) -> can.BusABC:
        """Open a CAN bus. Raises AxisError."""

    def line(self, key: str, path: str, baud: int) -> ByteStream:
        """Open a serial line. Raises AxisError."""


class DaemonEnds:
    """The daemon's ends: the buses and ports that the config names."""

    def __init__(self, bus: can.BusABC | None = None) -> None:
        self._bus = bus
        self._opened: list[can.BusABC] = []

    def bus(self, key: str, config: BusConfig) -> can.BusABC:  # noqa: ARG002 - the config says which
        """Open a CAN bus, or return the one that was given. Raises AxisError."""
        if self._bus is not None:
            return self._bus
        self._opened.append(open_bus(config))
        return self._opened[-1]

    def give_up(self) -> None:
        """Release the buses that were opened here, for an axis that could not be made of them."""
        for bus in self._opened:
            bus.shutdown()

    def line(self, key: str, path: str, baud: int) -> ByteStream:  # noqa: ARG002 - the path says which
        """Open a serial port. Raises AxisError."""
        return SerialStream(path, baud)


class DeviceEnds(DaemonEnds):
    """The simulated devices' ends: the same buses, and pseudo-terminals in place of ports."""

    def line(self, key: str, path: str, baud: int) -> ByteStream:  # noqa: ARG002 - as above
        """Offer a pseudo-terminal under the path. Raises AxisError."""
        return PseudoTerminal(path)


class LockStepEnds:
    """Both ends of everything in one process: `devices` for the rig, itself for the daemon.

    Buses that ask for it are logged into `log_folder`, where there is one, with stamps of `now_ns`.
    """

    def __init__(
        self, log_folder: Path | None = None, now_ns: Callable[[], int] = lambda: 0
    ) -> None:
        self._log_folder = log_folder
        self._now_ns = now_ns
        self._buses: dict[str, tuple[SynchronousBus, SynchronousBus]] = {}
        self._lines: dict[str, tuple[PipeStream, PipeStream]] = {}
        self.devices = _DeviceSide(self)

    def bus(self, key: str, config: BusConfig) -> can.BusABC:
        """Return the daemon's end of a bus."""
        bus = self.bus_pair(key)[0]
        if config.log is None or self._log_folder is None:
            return bus
        return LoggedBus(bus, log_file(self._log_folder, key, config), self._now_ns)

    def line(self, key: str, path: str, baud: int) -> PipeStream:  # noqa: ARG002 - as above
        """Return the daemon's end of a line."""
        return self.line_pair(key)[0]

    def bus_pair(self, key: str) -> tuple[SynchronousBus, SynchronousBus]:
        """Return both ends of a bus."""
        return self._buses.setdefault(key, synchronous_pair())

    def line_pair(self, key: str) -> tuple[PipeStream, PipeStream]:
        """Return both ends of a line."""
        return self._lines.setdefault(key, pipe())

    def answer_with(self, process: Callable[[], None]) -> None:
        """Let the devices answer whenever the daemon sends, and before it finds nothing."""
        for daemon_bus, device_bus in self._buses.values():
            device_bus.on_arrival = daemon_bus.before_recv = process
        for daemon_line, _ in self._lines.values():
            daemon_line.on_use = process


class _DeviceSide:
    """The devices' ends."""

    def __init__(self, ends: LockStepEnds) -> None:
        self._ends = ends

    def bus(self, key: str, config: BusConfig) -> SynchronousBus:  # noqa: ARG002 - as above
        return self._ends.bus_pair(key)[1]

    def line(self, key: str, path: str, baud: int) -> PipeStream:  # noqa: ARG002 - as above
        return self._ends.line_pair(key)[1]
