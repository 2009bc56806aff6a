"""Where records lie in the bytes of an MCAP file, for tests that damage them."""

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

_HEAD_BYTES = 9  # opcode and length before the content


def contents_of(data: bytes, opcode: Opcode) -> list[tuple[int, int]]:
    """Return where the content of each record of a kind begins and ends."""
    found, at = [], len(MCAP0_MAGIC)
    while at < len(data) - len(MCAP0_MAGIC):
        begin = at + _HEAD_BYTES
        end = begin + int.from_bytes(data[at + 1 : begin], "little")
        if data[at] == int(opcode):
            found.append((begin, end))
        at = end
    return found
