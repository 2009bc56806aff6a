"""Watching the network: heartbeats of the devices, emergencies, error frames, other masters."""

from __future__ import annotations

import contextlib
import errno

import can

from teleop_rt.axis import AxisFault

OPERATIONAL = 5
CAN_ERR_CONTROLLER = 0x004
CAN_ERR_BUS_OFF = 0x040
CONTROLLER_PASSIVE = 0x30
QUEUE_FULL = (errno.ENOBUFS, errno.EAGAIN)


class HeartbeatConsumer:
    """Finds nodes that fall silent or leave the operational state (CiA 301, 7.2.8.3.2)."""

    def __init__(self, timeouts_ms: dict[int, int]) -> None:
        self._timeout_ns = {node: ms * 1_000_000 for node, ms in timeouts_ms.items()}
        self._seen_ns = dict.fromkeys(timeouts_ms, 0)
        self._state = dict.fromkeys(timeouts_ms, OPERATIONAL)
        self._left_ns = dict.fromkeys(timeouts_ms, 0)
        self._earliest_ns = 0

    def start(self, now_ns: int) -> None:
        """Begin to watch: every node has its whole timeout from now."""
        for node in self._seen_ns:
            self._seen_ns[node] = self._left_ns[node] = now_ns
            self._state[node] = OPERATIONAL
        self._earliest_ns = 0

    def heard(self, node: int, state: int, now_ns: int) -> None:
        """Take a heartbeat: `state` is the node's NMT state, 0 its boot-up."""
        self._seen_ns[node] = now_ns
        self._state[node] = state
        if state == OPERATIONAL:
            self._left_ns[node] = now_ns
        if state == 0:
            self._left_ns[node] = now_ns - self._timeout_ns[node] - 1
            self._earliest_ns = 0

    def lost(self, now_ns: int) -> int | None:
        """Return a node that is silent, has restarted or is not operational, or None."""
        if now_ns < self._earliest_ns:
            return None
        earliest = now_ns + min(self._timeout_ns.values())
        for node, timeout in self._timeout_ns.items():
            last = min(self._seen_ns[node], self._left_ns[node])
            if now_ns - last > timeout:
                return node
            earliest = min(earliest, last + timeout)
        self._earliest_ns = earliest
        return None


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
    """Drop what waits to be sent, where the adapter can: it would act when power returns."""
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
