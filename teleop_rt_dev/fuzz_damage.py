"""Damage to the inputs of `scripts/campaign fuzz`, and the target that reads them."""

from __future__ import annotations

import random
from collections.abc import Callable

from teleop_rt.errors import ExpectedError

WORDS = [
    *(b"", b"0", b"-1", b"1e308", b"1e-320", b"nan", b".inf", b"null", b"[", b"{", b"&a [*a]"),
    *(b"*", b"!!python/object", b"\xff\xfe", b"\x00", b"9" * 400, b"\n\n", b": ", b"- "),
]
EDGES = [number.to_bytes(8, "little") for number in (0, 2**63 - 1, 2**63, 2**64 - 1024, 2**64 - 1)]
"""Whole numbers at the ends of their range: no random byte comes near them."""


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return the bytes with a few flipped, cut, doubled or replaced."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randint(0, len(changed))
        length = rng.choice((1, 2, 4, 16, 200))
        match rng.randint(0, 6):
            case 0 if at < len(changed):
                changed[at] ^= 1 << rng.randint(0, 7)
            case 1:
                del changed[at : at + length]
            case 2:
                changed[at:at] = changed[at : at + length]
            case 3:
                changed[at : at + rng.choice((0, length))] = rng.choice(WORDS)
            case 4:
                changed[at:at] = rng.randbytes(length)
            case 5:
                del changed[at + length * 50 :]
            case 6:
                changed[at : at + 8] = rng.choice(EDGES)
    return bytes(changed)


class Target:
    """One reader; `last` holds its last input."""

    def __init__(self, one: Callable[[bytes], object], seeds: list[bytes]) -> None:
        self._one = one
        self._seeds = seeds
        self.last = b""

    def warm_up(self) -> None:
        """Read an undamaged file once: importing its reader is no case's time."""
        self._one(self._seeds[0])

    def run(self, rng: random.Random) -> None:
        """Read one damaged input; a refusal is an answer."""
        self.last = damaged(rng.choice(self._seeds), rng)
        try:
            self._one(self.last)
        except ExpectedError:
            return
