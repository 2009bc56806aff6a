"""Watching the network: heartbeats of the devices, emergencies, error frames, other masters."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Collection
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from teleop_rt.axis import AxisFault
from teleop_rt.kernels.jit import kernel
from teleop_rt_drivers.canopen.sdo import BOOT_UP

OPERATIONAL = 5
"""State of a node in its heartbeat (CiA 301)."""
_NOBODY = -1  # no node has this id
# Of linux/can/error.h: classes of an error frame; passive in receiving or sending.
CAN_ERR_CONTROLLER = 0x004
CAN_ERR_BUS_OFF = 0x040
CONTROLLER_PASSIVE = 0x30
SEND_FAILURES_FAULT = 3
"""Frames in a row that cannot be sent, after which the bus is at fault; fewer are counted only."""
QUEUE_FULL = (errno.ENOBUFS, errno.EAGAIN)


class Life:
    """Fields of a node's life: COB-ID and timeout of its heartbeat, when it was heard, its state.

    `left_ns` is when it was last operational.
    """

    cob_id: int
    timeout_ns: int
    state: int
    seen_ns: int
    left_ns: int


Lives = NDArray[np.record]


def new_lives(nodes: int) -> Lives:
    """Return zeroed lives of so many nodes."""
    fields = np.dtype([(name, np.int64) for name in Life.__annotations__])
    return np.zeros(nodes, np.dtype((np.record, fields)))


@kernel
def hear(life: Life, state: int, now_ns: int) -> None:
    """Take a heartbeat: `state` is the node's NMT state, 0 its boot-up."""
    life.seen_ns, life.state = now_ns, state
    if state == OPERATIONAL:
        life.left_ns = now_ns
    if state == 0:
        life.left_ns = now_ns - life.timeout_ns - 1


@kernel
def lost_life(lives: Lives, now_ns: int) -> int:
    """Return the place of a node that is silent, has restarted or is not operational, or -1."""
    for index in range(len(lives)):
        life: Any = lives[index]
        if now_ns - min(life.seen_ns, life.left_ns) > life.timeout_ns:
            return index
    return -1


class HeartbeatConsumer:
    """Finds nodes that fall silent or leave the operational state (CiA 301, 7.2.8.3.2).

    `lives` are the records of kernels; a heartbeat of one that is `guarded` is left to the caller.
    """

    def __init__(self, timeouts_ms: dict[int, int], guarded: Collection[int] = ()) -> None:
        self._nodes = list(timeouts_ms)
        self.lives = new_lives(len(timeouts_ms))
        self.lives["cob_id"] = [
            _NOBODY if node in guarded else BOOT_UP + node for node in timeouts_ms
        ]
        self.lives["timeout_ns"] = [ms * 1_000_000 for ms in timeouts_ms.values()]
        self.start(0)

    def start(self, now_ns: int) -> None:
        """Begin to watch: every node has its whole timeout from now."""
        self.lives["seen_ns"] = self.lives["left_ns"] = now_ns
        self.lives["state"] = OPERATIONAL

    def heard(self, node: int, state: int, now_ns: int) -> None:
        """Take a heartbeat: `state` is the node's NMT state, 0 its boot-up."""
        hear(self.lives[self._nodes.index(node)], state, now_ns)

    def lost(self, now_ns: int) -> int | None:
        """Return a node that is silent, has restarted or is not operational, or None."""
        index = lost_life(self.lives, now_ns)
        return None if index < 0 else self._nodes[index]


class NodeGuards:
    """Asks devices without heartbeat for their state, and checks the toggle bit (CiA 301, 7.2.8).

    `due` gives the nodes to be asked by a remote frame now.
    """

    def __init__(self, periods_ms: dict[int, int]) -> None:
        self._period_ns = {node: ms * 1_000_000 for node, ms in periods_ms.items()}
        self._due_ns = dict.fromkeys(periods_ms, 0)
        self._toggle = dict.fromkeys(periods_ms, 0)

    def __contains__(self, node: int) -> bool:
        return node in self._period_ns

    def start(self) -> None:
        """Begin with toggle bit 0, as every device does after its boot-up."""
        for node in self._toggle:
            self._toggle[node] = self._due_ns[node] = 0

    def due(self, now_ns: int) -> list[int]:
        """Return the nodes that are to be asked now."""
        if not self._due_ns:
            return []
        due = [node for node, due_ns in self._due_ns.items() if now_ns >= due_ns]
        for node in due:
            self._due_ns[node] = now_ns + self._period_ns[node]
        return due

    def accepts(self, node: int, answer: int) -> bool:
        """Return whether an answer has the toggle bit that is its turn."""
        if answer >> 7 != self._toggle[node]:
            return False
        self._toggle[node] ^= 1
        return True


def send_fault(error: Exception) -> AxisFault:
    """Return the fault of frames that cannot be sent: with a full queue, nobody acknowledges."""
    full = (
        isinstance(error, can.CanTimeoutError) or getattr(error, "error_code", None) in QUEUE_FULL
    )
    return AxisFault.NOT_ACKNOWLEDGED if full else AxisFault.UNPLUGGED


def purge(bus: can.BusABC) -> None:
    """Drop frames that wait to be sent, where the adapter can: they would act with new power."""
    with contextlib.suppress(NotImplementedError, can.CanError, OSError):
        bus.flush_tx_buffer()


def error_frame_fault(error_class: int, data: bytes | bytearray) -> AxisFault:
    """Return the fault of an error frame, in SocketCAN's encoding (linux/can/error.h)."""
    if error_class & CAN_ERR_BUS_OFF:
        return AxisFault.BUS_OFF
    status = data[1] if len(data) > 1 else 0
    if error_class & CAN_ERR_CONTROLLER and status & CONTROLLER_PASSIVE:
        return AxisFault.ERROR_PASSIVE
    return AxisFault.NONE
