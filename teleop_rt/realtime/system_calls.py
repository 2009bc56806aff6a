"""Calls of the system from within kernels: to receive, send and read a clock, without waiting."""

from __future__ import annotations

import ctypes
import errno
import math
import os
import socket
import termios
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.lean_numba import numba
from teleop_rt.realtime.packets import SENDER_BYTES

if TYPE_CHECKING:
    from numpy.typing import NDArray

_C_TYPES = {"int32": ctypes.c_int32, "int64": ctypes.c_int64, "float64": ctypes.c_double}


def _of_c_library(name: str, result: str, *arguments: str) -> Callable[..., Any]:
    """Return a function of the C library for kernels; a pointer is an address, an `int64`.

    Compiled code holds only its name, so it is cached as any other. Plain Python calls it, too,
    where nothing is compiled.
    """
    if cast("Any", numba.config).DISABLE_JIT:
        function = getattr(ctypes.PyDLL(None, use_errno=True), name)
        function.restype, *function.argtypes = (_C_TYPES[one] for one in (result, *arguments))
        return cast("Callable[..., Any]", function)
    types: Any = numba.types
    signature = getattr(types, result)(*(getattr(types, one) for one in arguments))
    return cast("Callable[..., Any]", types.ExternalFunction(name, signature))


def _error_of_c_library() -> Callable[[], Sequence[int]]:
    """Return a function whose result's first item is the `errno` of the call before."""
    if cast("Any", numba.config).DISABLE_JIT:
        return lambda: (ctypes.get_errno(),)
    types: Any = numba.types
    signature = types.CPointer(types.int32)()
    return cast(
        "Callable[[], Sequence[int]]", types.ExternalFunction("__errno_location", signature)
    )


_receive = _of_c_library("recvmmsg", "int32", "int32", "int64", "int32", "int32", "int64")
_read = _of_c_library("read", "int64", "int32", "int64", "int64")
_write = _of_c_library("write", "int64", "int32", "int64", "int64")
_ioctl = _of_c_library("ioctl", "int32", "int32", "int64", "int64")
_send = _of_c_library("send", "int64", "int32", "int64", "int64", "int32")
_send_to = _of_c_library("sendto", "int64", "int32", "int64", "int64", "int32", "int64", "int32")
_poll = _of_c_library("poll", "int32", "int64", "int64", "int32")
_wait = _of_c_library("ppoll", "int32", "int64", "int64", "int64", "int64")
_wait_event = _of_c_library("epoll_pwait2", "int32", "int32", "int64", "int32", "int64", "int64")
EVENT_WORDS = 4
"""Room for a `struct epoll_event`, in words of 4 bytes; the first are the events that came."""
_set_timer = _of_c_library("timerfd_settime", "int32", "int32", "int32", "int64", "int64")
TIMER_WORDS = 4
"""A `struct itimerspec`: the time after which a timer repeats, and when it ends first."""
_to_number = _of_c_library("strtod", "float64", "int64", "int64")
_clock = _of_c_library("clock_gettime", "int32", "int32", "int64")
_error = _error_of_c_library()
_FLAGS, _SEND_FLAGS = socket.MSG_DONTWAIT, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL
_MONOTONIC = time.CLOCK_MONOTONIC
_COUNT_WAITING = termios.FIONREAD
COUNT_BYTES = 4
"""Bytes of the C int that FIONREAD writes."""
FOUND_BITS = 48
"""Place of the found events in the word of a `struct pollfd` [bits]."""
_ABSOLUTE = 1  # TFD_TIMER_ABSTIME
_TIMER_FLAGS = os.O_NONBLOCK | os.O_CLOEXEC  # TFD_NONBLOCK and TFD_CLOEXEC
_SECOND_NS = 1_000_000_000  # a second [ns], of which the system counts the rest apart
_AGAIN, _INTERRUPTED, _ENDED = errno.EAGAIN, errno.EINTR, errno.EPIPE


@kernel
def receive_packets(descriptor: int, headers: int, most: int) -> int:
    """Receive waiting packets into the `struct mmsghdr`s at an address; return their number.

    That is 0 where nothing waits, and minus the error's number where the socket is broken.
    """
    count: int = _receive(descriptor, headers, most, _FLAGS, 0)
    if count >= 0:
        return count
    code = _error()[0]
    return 0 if code in (_AGAIN, _INTERRUPTED) else -code


@kernel
def is_ready(place: int) -> bool:
    """Return whether the descriptor of the `struct pollfd` at an address is ready, or is gone.

    A negative descriptor is never ready.
    """
    found: int = _poll(place, 1, 0)
    return found != 0


@kernel
def wait_ready(
    polls: int, count: int, times: NDArray[np.int64], place: int, longest_ns: int
) -> int:
    """Wait until one of the `struct pollfd`s at an address is ready; return how many are.

    That is 0 after the longest time, and after a signal. `times` (2,), which lie at `place`, are
    written. No other thread of Python runs meanwhile.
    """
    times[0], times[1] = longest_ns // _SECOND_NS, longest_ns % _SECOND_NS
    found: int = _wait(polls, count, place, 0)
    return max(0, found)


@kernel
def wait_event(
    epoll: int,
    event: NDArray[np.uint32],
    event_place: int,
    times: NDArray[np.int64],
    place: int,
    longest_ns: int,
) -> int:
    """Wait for an event of a descriptor of an epoll; return its bits, such as EPOLLIN.

    They are 0 after the longest time, and after a signal. `event` (EVENT_WORDS,) and `times` (2,),
    which lie at the addresses after them, are written. A terminal that is watched for edges
    (EPOLLET) is not asked whether something waits, for which a `poll` waits until a worker of the
    kernel has done its part. No other thread of Python runs meanwhile.
    """
    times[0], times[1] = longest_ns // _SECOND_NS, longest_ns % _SECOND_NS
    found: int = _wait_event(epoll, event_place, 1, place, 0)
    return int(event[0]) if found > 0 else 0


def new_timer() -> int:
    """Return the descriptor of a timer, which becomes readable at the time that `set_timer` gave.

    Raises OSError.
    """
    descriptor: int = ctypes.CDLL(None, use_errno=True).timerfd_create(_MONOTONIC, _TIMER_FLAGS)
    if descriptor < 0:
        raise OSError(ctypes.get_errno(), "no timer")
    return descriptor


@kernel
def set_timer(descriptor: int, times: NDArray[np.int64], place: int, at_ns: int) -> None:
    """Let a timer's descriptor be readable from this time on, not before.

    `times` (TIMER_WORDS,), which lie at `place`, are written. A wait that ends by another event
    leaves it set, where the longest time of a wait would be set and taken back, each of which may
    take a virtual machine as long as ten other calls of the system.
    """
    times[0] = times[1] = 0
    times[2], times[3] = at_ns // _SECOND_NS, at_ns % _SECOND_NS
    _set_timer(descriptor, _ABSOLUTE, place, 0)


@kernel
def read_bytes(descriptor: int, place: int, room: int) -> int:
    """Read waiting bytes of a non-blocking descriptor to an address; return their number.

    That is 0 where nothing waits, and minus an error's number where the other end is gone.
    """
    count: int = _read(descriptor, place, room)
    if count > 0:
        return count
    if count == 0:
        return -_ENDED
    code = _error()[0]
    return 0 if code in (_AGAIN, _INTERRUPTED) else -code


@kernel
def count_delivered(descriptor: int, memory: NDArray[np.uint8], place: int) -> int:
    """Return how many bytes wait that a terminal's driver delivered.

    That is minus an error's number where the line is gone. The first COUNT_BYTES of `memory`, which
    lies at `place`, are written.
    """
    if _ioctl(descriptor, _COUNT_WAITING, place) < 0:
        return -_error()[0]
    count = np.int64(0)
    for byte in range(COUNT_BYTES):
        count |= np.int64(memory[byte]) << np.int64(8 * byte)
    return int(count)


@kernel
def read_delivered(descriptor: int, memory: NDArray[np.uint8], place: int) -> int:
    """Read the bytes that a terminal's driver delivered to an address; return their number.

    That is 0 where nothing waits, and minus an error's number where the line is gone. It is asked
    first: even a read that must not wait does so on a terminal on which nothing is, until a worker
    of the kernel, which has no priority, has delivered more.
    """
    count = count_delivered(descriptor, memory, place)
    return read_bytes(descriptor, place, len(memory)) if count > 0 else count


@kernel
def write_bytes(descriptor: int, place: int, length: int) -> int:
    """Write bytes that lie at an address to a non-blocking descriptor; return how many it took.

    That is 0 where it takes none now, and minus an error's number where the other end is gone.
    """
    count: int = _write(descriptor, place, length)
    if count >= 0:
        return count
    code = _error()[0]
    return 0 if code in (_AGAIN, _INTERRUPTED) else -code


@kernel
def send_bytes(descriptor: int, place: int, length: int) -> int:
    """Send a packet that lies at an address; return 0, or minus the number of an error."""
    return -_error()[0] if _send(descriptor, place, length, _SEND_FLAGS) < 0 else 0


@kernel
def send_bytes_to(descriptor: int, place: int, length: int, name: int) -> int:
    """Send a packet that lies at an address to the `struct sockaddr_in` at another.

    Return 0, or minus the number of an error.
    """
    sent = _send_to(descriptor, place, length, _SEND_FLAGS, name, SENDER_BYTES)
    return -_error()[0] if sent < 0 else 0


@kernel
def monotonic_ns(times: NDArray[np.int64], place: int) -> int:
    """Return the time of CLOCK_MONOTONIC by way of two numbers (2,), which lie at this address."""
    _clock(_MONOTONIC, place)
    return int(times[0] * _SECOND_NS + times[1])


@kernel
def number_in_text(place: int, ends: NDArray[np.int64], ends_place: int, length: int) -> float:
    """Return the number that lies at an address, correctly rounded; not-a-number if it is shorter.

    The text after it must not continue the number. `ends`, at `ends_place`, is written; in a locale
    with a decimal comma a number ends at its point.
    """
    value: float = _to_number(place, ends_place)
    return value if ends[0] - place == length else math.nan


@kernel
def keep_order() -> None:
    """Keep writes before this call ahead of writes after it.

    A compiler moves no store across a call of a function that it does not know.
    """
    _error()
