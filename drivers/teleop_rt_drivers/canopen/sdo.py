"""Configuration over SDO without threads: the bus is pumped by hand while an answer is awaited."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, cast

import can
from canopen.objectdictionary import ObjectDictionaryError
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from teleop_rt.axis import AxisError
from teleop_rt_drivers.canopen.eds import describe_entry, variable
from teleop_rt_drivers.canopen.entries import Entry, address

if TYPE_CHECKING:
    from collections.abc import Callable

    from canopen.network import Network
    from canopen.objectdictionary import ObjectDictionary

BOOT_UP = 0x700
"""COB-ID of a boot-up message, plus the node's id (CiA 301)."""
SDO_ABORT = 0x80
"""Command byte of an SDO abort (CiA 301)."""
_RIGHT_EDS = "name the EDS of this device"
MOST_DISCARDED = 10_000
"""Old frames dropped before a question: a bus that never falls silent must not hold it up."""


class ConfigurationBus:
    """The bus before the loop owns it: sends frames, and waits for one in particular.

    A bus whose peers answer synchronously has nothing more to deliver once `recv` returns None,
    so waiting ends there on a simulated clock too.
    """

    def __init__(self, bus: can.BusABC, now_ns: Callable[[], int]) -> None:
        self._bus = bus
        self._now_ns = now_ns

    def send(self, cob_id: int, data: bytes) -> None:
        """Send one frame; raises AxisError if the bus refuses it."""
        try:
            self._bus.send(can.Message(arbitration_id=cob_id, is_extended_id=False, data=data))
        except (can.CanError, OSError) as error:
            raise AxisError(
                f"the bus refuses to send: {error}; check adapter and wiring"
            ) from error

    def discard(self) -> None:
        """Drop waiting answers: one that came too late must not be taken for a new one."""
        for _ in range(MOST_DISCARDED):
            try:
                if self._bus.recv(0) is None:
                    return
            except (can.CanError, OSError):
                continue

    def wait(self, wanted: Callable[[can.Message], bool], timeout_s: float) -> can.Message | None:
        """Return the first frame that is wanted, or None after `timeout_s`; others are dropped."""
        end_ns = self._now_ns() + round(1e9 * timeout_s)
        while (left_ns := end_ns - self._now_ns()) > 0:
            try:
                message = self._bus.recv(left_ns / 1e9)
            except (can.CanError, OSError):
                continue
            if message is None:
                return None
            if not message.is_error_frame and wanted(message):
                return message
        return None


class _Client(SdoClient):
    """The canopen package's SDO client on a pumped bus."""

    RESPONSE_TIMEOUT = 0.0

    def __init__(
        self, bus: ConfigurationBus, node_id: int, dictionary: ObjectDictionary, timeout_s: float
    ) -> None:
        super().__init__(0x600 + node_id, 0x580 + node_id, dictionary)  # type: ignore[no-untyped-call]
        self.network = cast("Network", self)  # the client only ever sends through it
        self._bus = bus
        self._timeout_s = timeout_s

    def send_message(self, can_id: int, data: bytes) -> None:
        """Send a request, as the client expects of its network."""
        self._bus.discard()
        self._bus.send(can_id, bytes(data))

    def abort(self, abort_code: int = 0x08000000) -> None:
        """Notify the device of the end of a transfer; the caller reports it to the user."""
        self.send_message(self.rx_cobid, struct.pack("<B3xL", SDO_ABORT, abort_code))

    def read_response(self) -> bytes:
        """Pump the bus until the answer is there, then hand it to the client."""
        answer = self._bus.wait(self._is_answer, self._timeout_s)
        if answer is not None:
            self.responses.put(bytes(answer.data))
        response: bytes = super().read_response()  # type: ignore[no-untyped-call]
        return response

    def _is_answer(self, message: can.Message) -> bool:
        return message.arbitration_id == self.tx_cobid and len(message.data) == 8


class SdoNode:
    """Reads and writes the object dictionary of one device; all errors are AxisError."""

    def __init__(
        self,
        name: str,
        node_id: int,
        dictionary: ObjectDictionary,
        bus: ConfigurationBus,
        where: str,
        timeout_s: float,
    ) -> None:
        self.label = f"node 0x{node_id:02X} ({name})"
        self.node_id = node_id
        self.dictionary = dictionary
        self._client = _Client(bus, node_id, dictionary, timeout_s)
        self._where = where

    def read(self, entry: Entry, attempts: int = 1) -> int | float:
        """Return the number in an entry, trying so many times to get an answer."""
        index, subindex = address(entry)
        for attempt in range(attempts):
            try:
                data = self._client.upload(index, subindex)
                return self._number(entry, data)
            except SdoCommunicationError as error:
                if attempt == attempts - 1:
                    raise self._no_answer(error) from error
            except SdoAbortedError as error:
                raise self._refused("read", entry, error) from error
            except KeyError as error:
                raise AxisError(
                    f"{self.label}: the EDS has no object {entry}: {_RIGHT_EDS}"
                ) from error
        raise AssertionError("attempts must be positive")

    def upload(self, index: int, subindex: int) -> bytes:
        """Return the bytes of an entry. Raises AxisError, saying only why."""
        try:
            return bytes(self._client.upload(index, subindex))
        except SdoCommunicationError as error:
            raise AxisError("no answer") from error
        except SdoAbortedError as error:
            raise AxisError(str(error)) from error

    def _number(self, entry: Entry, data: bytes) -> int | float:
        """Return the number that an answer holds; raises AxisError when there is none."""
        try:
            value = variable(self.dictionary, *address(entry)).decode_raw(data)
        except ObjectDictionaryError as error:
            raise AxisError(
                f"{self.label}: {entry} has another size than in the EDS: {_RIGHT_EDS}"
            ) from error
        if not isinstance(value, int | float):
            raise AxisError(f"{self.label}: {entry} is no number: {_RIGHT_EDS}")
        return value

    def write(self, entry: Entry, value: int) -> None:
        """Write an entry."""
        index, subindex = address(entry)
        try:
            data = variable(self.dictionary, index, subindex).encode_raw(value)
            self._client.download(index, subindex, data)
        except SdoCommunicationError as error:
            raise self._no_answer(error) from error
        except SdoAbortedError as error:
            raise self._refused(f"write {value} to", entry, error) from error
        except KeyError as error:
            raise AxisError(f"{self.label}: the EDS has no object {entry}: {_RIGHT_EDS}") from error
        except ValueError as error:
            raise AxisError(
                f"{self.label}: {value} does not fit into {entry} ({error}): correct the value"
            ) from error

    def write_checked(self, entry: Entry, value: int) -> None:
        """Write an entry, read it back, and refuse a device that kept another value."""
        self.write(entry, value)
        self.expect(entry, value)

    def expect(self, entry: Entry, value: int) -> None:
        """Refuse a device in which an entry has another value than the config says."""
        found = self.read(entry)
        if found != value:
            raise AxisError(
                f"{self.label}: {describe_entry(entry, self.dictionary)} is {_text(found)}, "
                f"the rig's config says {_text(value)}: correct one of the two"
            )

    def _no_answer(self, error: Exception) -> AxisError:
        return AxisError(
            f"no answer from {self.label} on {self._where} ({error}): check power, wiring, "
            "termination, bit rate and node id; `teleop-rt sim TRIAL` starts a simulated rig"
        )

    def _refused(self, verb: str, entry: Entry, error: Exception) -> AxisError:
        named = describe_entry(entry, self.dictionary)
        return AxisError(
            f"{self.label} refuses to {verb} {named}: {error}: "
            f"see the device's manual, or {_RIGHT_EDS}"
        )


def _text(value: float) -> str:
    """Return a value in decimal and, where it is a whole number, in hexadecimal."""
    return f"{value} (0x{value:X})" if isinstance(value, int) and value > 9 else str(value)
