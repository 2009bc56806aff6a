"""Serial lines that are asked in one step whether anything waits on them."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.axis import NO_AXIS_FAULT
from teleop_rt.kernels.jit import bound, kernel
from teleop_rt.realtime.system_calls import COUNT_BYTES, count_delivered
from teleop_rt_drivers.framed.serial_port import SerialPort

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from teleop_rt_drivers.framed.source import FramedPort


@kernel
def none_waits(descriptors: NDArray[np.int64], memory: NDArray[np.uint8], place: int) -> bool:
    """Return whether no byte waits on these terminals (n,), and none of them is gone.

    `memory` (COUNT_BYTES,) lies at `place`.
    """
    for index in range(len(descriptors)):
        if count_delivered(descriptors[index], memory, place) != 0:
            return False
    return True


class QuietLines:
    """The open ports of an axis, each a terminal: none need be drained while nothing waits."""

    def __init__(self, ports: Sequence[SerialPort]) -> None:
        self._ports = ports
        descriptors = np.array([port.descriptor for port in ports], np.int64)
        memory = np.zeros(COUNT_BYTES, np.uint8)
        place = memory.ctypes.data
        self._none_waits = functools.partial(bound(none_waits, (descriptors, memory), 0), place)

    def are_quiet(self, now_ns: int) -> bool:
        """Return whether the lines are watched and nothing waits: they were empty at that time.

        Where nobody watches, the frames of a period wait: the lines are not asked twice. A port
        with a fault is not quiet.
        """
        ports = self._ports
        if not ports[0].empty_ns or not self._none_waits():
            return False
        for port in ports:
            if port.fault is not NO_AXIS_FAULT:
                return False
            port.empty_ns = now_ns
        return True


def quiet_lines(ports: Sequence[FramedPort]) -> QuietLines | None:
    """Return the open ports as lines; None where one is no terminal, or must be asked for more."""
    lines = [port for port in ports if isinstance(port, SerialPort) and port.only_listens]
    return QuietLines(lines) if lines and len(lines) == len(ports) else None
