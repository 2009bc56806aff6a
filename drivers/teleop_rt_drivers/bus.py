"""Open a CAN bus by name, and add the next step to the system's errors."""

from __future__ import annotations

import errno
import math
import secrets
import socket
import time
from functools import partial
from typing import Literal

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.udp_multicast import UdpMulticastBus
from pydantic import Field

from teleop_rt.axis import AxisError
from teleop_rt.config.section import Section
from teleop_rt.extras import install_command
from teleop_rt_drivers.fdcanusb_bus import FdcanusbBus
from teleop_rt_drivers.socketcan_bus import DirectSocketcanBus
from teleop_rt_drivers.unix_bus import UnixBus

UNIX = "unix"
"""Our own interface for several processes of one machine; its channel is a name, or a folder."""
SOCKETCAN = "socketcan"
FDCANUSB = "fdcanusb"
"""Interface of mjbots' adapter, which python-can does not know; its channel is a serial port."""
RECEIVE_BUFFER_BYTES = 4 << 20
"""Asked of the kernel for frames that wait while the process is held up."""


ADAPTERS = {
    "gs_usb": (
        f"`{install_command('gs_usb')}` installs its library, and the user needs access to the "
        "USB device; with the kernel's driver it is socketcan instead: `ip link` shows it as can0"
    ),
    "slcan": (
        "channel is the adapter's serial port, such as /dev/ttyACM0 (`ls -l /dev/serial/by-id`); "
        "the user must be in the group that owns it, and the adapter needs slcan firmware"
    ),
    FDCANUSB: (
        "channel is the adapter's serial port, such as /dev/fdcanusb or /dev/ttyACM0 (`ls -l "
        "/dev/serial/by-id`); the user must be in the group that owns it"
    ),
    "pcan": (
        "PEAK's own library PCAN-Basic is needed; with the kernel's driver it is socketcan instead:"
        " `ip link` shows it as can0"
    ),
}
"""Next step if an adapter cannot be opened, by its interface."""
_NO_SOCKETCAN = (
    "this kernel has no SocketCAN: `modprobe can_raw` loads it where it was built, which the"
    " kernels of containers and small virtual machines often lack; slcan, gs_usb and fdcanusb do"
    " without it"
)


class BusConfig(Section):
    """The CAN bus: keys that are left out come from python-can's own configuration.

    That is the environment (CAN_INTERFACE, CAN_CHANNEL, CAN_BITRATE), then can.conf.
    """

    interface: str | None = Field(
        None,
        description=(
            "Kind of CAN interface: socketcan on hardware, fdcanusb for mjbots' adapter, unix "
            "between processes of one machine, or any other name that python-can knows; null takes "
            "python-can's own configuration."
        ),
    )
    channel: str | None = Field(
        None,
        description=(
            "Which bus of that kind: can0 for socketcan, any name for unix; null takes "
            "python-can's own configuration."
        ),
    )
    bitrate: int | None = Field(
        None,
        ge=10_000,
        le=1_000_000,
        description=(
            "Bit rate of the bus; `check` computes the bus load from it, 1 Mbit/s where it is null."
        ),
    )
    fd: bool = Field(
        default=False, description="Whether the bus carries CAN FD frames, as moteus needs."
    )
    data_bitrate: int | None = Field(
        None,
        ge=10_000,
        le=10_000_000,
        description="Bit rate of the data of CAN FD frames: 5000000 for moteus; null without fd.",
    )
    port: int | None = Field(
        None,
        ge=1024,
        le=65535,
        description="UDP port of udp_multicast; each run on a machine takes its own.",
    )
    log: Literal["asc", "blf"] | None = Field(
        None,
        description=(
            "Format in which the raw bus is recorded beside the recording: asc or blf; null "
            "records none."
        ),
    )

    def __str__(self) -> str:
        port = "" if self.port is None else f":{self.port}"
        return f"{self.interface or 'default interface'} {self.channel or ''}{port}".strip()


class MulticastBus(UdpMulticastBus):
    """`udp_multicast` that distinguishes its own frames, which it also receives, from foreign ones.

    Each frame carries the sender's random token in its channel field; nothing leaves the machine
    (hop limit 0).
    """

    def __init__(self, channel: str, port: int) -> None:
        self._token = secrets.token_hex(4)
        super().__init__(channel=channel, port=port, hop_limit=0, fd=False)
        view = socket.socket(fileno=self.fileno())
        try:
            view.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        finally:
            view.detach()

    def send(self, msg: can.Message, timeout: float | None = 0.0) -> None:
        """Send a frame without waiting, marked as ours."""
        msg.channel = self._token
        super().send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame of somebody else, or None."""
        while True:
            message = receive(self, timeout)
            if message is None or message.channel != self._token:
                return message


STAMPING = (UNIX, SOCKETCAN)
"""Interfaces that stamp each frame on arrival, by this machine's clock."""
NOT_WATCHED = ("gs_usb", "udp_multicast")
"""Interfaces whose frames have neither a stamp of this clock nor a descriptor to wait on."""
STAMPED_S = 2e-5
"""Deviation of a stamp by a kernel, with a frame's wait for the bus."""
WATCHED_SHARE, READ_SHARE = 0.1, 1.0 / math.sqrt(12.0)
"""Deviation over the period of the loop: of frames watched but while the loop works (half of the
period at most), and of those that are only read once a cycle."""


def stamp_deviation_s(config: BusConfig, period_s: float) -> float:
    """Return the standard deviation of an arrival's stamp on a bus [s]."""
    if config.interface in STAMPING:
        return STAMPED_S
    return period_s * (READ_SHARE if config.interface in NOT_WATCHED else WATCHED_SHARE)


def stamps_arrivals(bus: can.BusABC) -> bool:
    """Return whether a bus stamps its frames on arrival, by this machine's clock."""
    return isinstance(bus, UnixBus | SocketcanBus)


def descriptor_of(bus: can.BusABC) -> int:
    """Return the descriptor that an arrival makes readable, -1 where an adapter has none."""
    try:
        return bus.fileno()
    except (NotImplementedError, OSError, can.CanError):
        return -1


def receive(bus: can.BusABC, timeout: float | None = None) -> can.Message | None:
    """Return the next frame that passes the filters, or None where none comes in time [s].

    In place of python-can's own `recv`, which measures by the wall clock: set back by an hour while
    it looks, even `recv(0)` waits for an hour.
    """
    ends_s = None if timeout is None else time.monotonic() + timeout
    while True:
        message, filtered = bus._recv_internal(timeout)  # noqa: SLF001 - the interface's method
        if message is not None and (filtered or bus._matches_filters(message)):  # noqa: SLF001
            return message
        if ends_s is not None:
            timeout = ends_s - time.monotonic()
            if timeout <= 0:
                return None


def open_bus(config: BusConfig) -> can.BusABC:
    """Open the bus of a rig; raises AxisError with the next step when it cannot be had."""
    try:
        if config.interface == "udp_multicast":
            return MulticastBus(
                config.channel or UdpMulticastBus.DEFAULT_GROUP_IPv4, config.port or 43113
            )
        if config.interface == UNIX:
            return UnixBus(config.channel or "can")
        bus = _fdcanusb(config) if config.interface == FDCANUSB else _of_python_can(config)
    except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
        if isinstance(error, OSError) and error.errno == errno.EAFNOSUPPORT:
            raise AxisError(f"cannot open the bus {config}: {_NO_SOCKETCAN}") from error
        raise AxisError(f"cannot open the bus {config}: {error}; {_advice(config)}") from error
    if type(bus).recv is can.BusABC.recv:
        bus.recv = partial(receive, bus)  # type: ignore[method-assign]
    return bus


def _fdcanusb(config: BusConfig) -> can.BusABC:
    port = config.channel or "/dev/fdcanusb"
    return FdcanusbBus(port, config.bitrate, config.data_bitrate, fd=config.fd)


def _of_python_can(config: BusConfig) -> can.BusABC:
    options = config.model_dump(exclude_none=True, exclude={"port", "log"})
    if not config.fd:
        options.pop("fd")  # not every interface of python-can knows the word
    if config.interface == "slcan":
        options["timeout"] = 0  # of its serial port: by default an empty recv(0) waits 1 ms
    if config.interface == SOCKETCAN and not config.fd:
        found = can.util.load_config(config=options)
        return DirectSocketcanBus(**{key: found[key] for key in found if key != "interface"})
    return can.Bus(**options)


def _advice(config: BusConfig) -> str:
    """Return the next step for a bus that could not be opened."""
    if config.interface == "udp_multicast":
        if _port_taken(config.port or 43113):
            return "another program holds this UDP port: choose another `port` in the bus section"
        return (
            "if this machine has no multicast route, `ip link set lo up` and "
            "`ip route add 239.0.0.0/8 dev lo` give it one; a channel must be a multicast group "
            "such as 239.74.163.2"
        )
    if config.interface == UNIX:
        return "where two users share a bus, give `channel` the path of a folder that both may use"
    if config.interface == SOCKETCAN:
        return (
            f"`ip link set {config.channel or 'can0'} up type can bitrate "
            f"{config.bitrate or 1_000_000}` brings the interface up; `ip link` shows which exist"
        )
    if config.interface in ADAPTERS:
        return ADAPTERS[config.interface]
    return "check interface, channel and the adapter; python-can's `can.detect_available_configs`"


def _port_taken(port: int) -> bool:
    """Return whether another program holds the UDP port without sharing it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        try:
            probe.bind(("", port))
        except OSError as error:
            return error.errno == errno.EADDRINUSE
    return False
