"""The raw bus beside a trial, as .asc or .blf: written by python-can, in a process of its own.

`python -m teleop_rt_drivers.bus_log BUS FILE` opens the bus a second time, hears the frames of
daemon and devices, and writes until its standard input ends: so it costs the loop nothing, and ends
with the process that started it.
"""

from __future__ import annotations

import contextlib
import select
import subprocess
import sys
from typing import TYPE_CHECKING

import can

from teleop_rt.axis import AxisError
from teleop_rt_drivers.bus import BusConfig, open_bus

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

READY = "ready"
WAIT_S = 0.05
"""Longest wait for a frame before the logger looks whether it is to end."""
END_TIMEOUT_S = 5.0
"""Time that the logger has to write its frames."""


def log_file(folder: Path, part: str, bus: BusConfig) -> Path:
    """Return the file of a part's bus: bus.asc, or PART.asc of a mixed rig."""
    return folder / f"{part or 'bus'}.{bus.log}"


@contextlib.contextmanager
def logging_processes(buses: Mapping[str, BusConfig], folder: Path) -> Iterator[None]:
    """Log the buses that ask for it into the folder. Raises AxisError where one cannot be had."""
    loggers = []
    try:
        for part, bus in buses.items():
            if bus.log is not None:
                loggers.append(_start(bus, log_file(folder, part, bus)))
        yield
    finally:
        for logger in loggers:
            _end(logger)


def _start(bus: BusConfig, file: Path) -> subprocess.Popen[str]:
    logger = subprocess.Popen(  # noqa: S603 - our own interpreter and arguments
        [sys.executable, "-m", "teleop_rt_drivers.bus_log", bus.model_dump_json(), str(file)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert logger.stdout is not None  # noqa: S101 - opened as a pipe
    said = logger.stdout.readline().strip()
    if said != READY:
        _end(logger)
        raise AxisError(
            f"bus.log: the bus cannot be heard by a second program ({said or 'it ended at once'}): "
            "use SocketCAN, or leave `log` out"
        )
    return logger


def _end(logger: subprocess.Popen[str]) -> None:
    """Let a logger write its frames and end; kill one that does not."""
    for pipe in (logger.stdin, logger.stdout):
        if pipe is not None:
            pipe.close()
    try:
        logger.wait(END_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        logger.kill()
        logger.wait()


class LoggedBus(can.BusABC):
    """A bus that logs its frames; for simulated time, where nothing is late."""

    def __init__(self, bus: can.BusABC, file: Path, now_ns: Callable[[], int]) -> None:
        self.channel_info = f"logged {bus.channel_info}"
        self._bus = bus
        self._now_ns = now_ns
        self._logger = can.Logger(file)
        super().__init__(channel="log")
        self._is_shutdown = True  # `shutdown` releases all there is

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame, and write it down before its answers."""
        self._write(msg, is_rx=False)
        self._bus.send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, written down."""
        message = self._bus.recv(timeout)
        if message is not None:
            self._write(message, is_rx=True)
        return message

    def shutdown(self) -> None:
        """Close the log and the bus."""
        self._logger.stop()
        self._bus.shutdown()

    def _write(self, message: can.Message, *, is_rx: bool) -> None:
        stamp_s = self._now_ns() * 1e-9
        self._logger.on_message_received(_loggable(message, stamp_s, is_rx=is_rx))


def _loggable(message: can.Message, stamp_s: float, *, is_rx: bool) -> can.Message:
    """Return a frame as log formats know it: on channel 0, with a stamp and a direction."""
    return can.Message(
        timestamp=stamp_s,
        arbitration_id=message.arbitration_id,
        is_extended_id=message.is_extended_id,
        is_remote_frame=message.is_remote_frame,
        is_error_frame=message.is_error_frame,
        channel=0,
        dlc=message.dlc,
        data=message.data,
        is_rx=is_rx,
    )


def main() -> int:
    """Log one bus until standard input ends."""
    config, file = BusConfig.model_validate_json(sys.argv[1]), sys.argv[2]
    try:
        bus = open_bus(config)
        logger = can.Logger(file)
    except (AxisError, OSError, ValueError) as error:
        print(str(error).replace("\n", " "), flush=True)
        return 2
    print(READY, flush=True)
    ended = False
    while not ended:  # once more after the end, for frames that wait in the socket
        ended = bool(select.select([sys.stdin], [], [], 0)[0])
        with contextlib.suppress(can.CanError, OSError, ValueError):
            message = bus.recv(WAIT_S)
            while message is not None:
                logger.on_message_received(_loggable(message, message.timestamp, is_rx=True))
                message = bus.recv(0)
    logger.stop()
    bus.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
