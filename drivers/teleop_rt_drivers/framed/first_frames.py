"""The message where a framed device gives no good frame: the bytes that came, and the cause."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt_drivers.framed.counters import REASONS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_WIRING = "check power, wiring and the device's own settings"
_LINE = "check baud or bit rate, and the sync bytes or ids of the format"
_CAUSES = {
    "bad_checksum": (
        "with a wrong checksum",
        (
            "check the checksum's kind and span in the format (without a span it begins behind"
            " `sync`), then the baud rate"
        ),
    ),
    "bad_end": ("with other end bytes", "check `end` and the fields' sizes in the format"),
    "wrong_length": ("of another length", "check the fields' sizes in the format"),
    "no_match": ("that do not match the pattern", "check `pattern` in the format, then the baud"),
    "too_long": ("that are too long", "check the end of a line in the format, then the baud rate"),
    "not_a_number": ("without a number", "check the field's type in the format"),
    "out_of_range": (
        "with a value out of range",
        (
            "check field, scale, sign and offset: a force beyond 3 times limits.force_max, or a"
            " position more than a whole travel beyond limits, is not believed"
        ),
    ),
    "impossible_jump": (
        "with a jump faster than limits.velocity_max allows",
        "check field and scale of the position",
    ),
    "bad_status": ("whose status is not good", "check `status.field` and `status.good`"),
}
"""Description of the frames that were rejected for a reason, and the next step."""


def nothing_good(silent: Sequence[str], timeout_ms: int, counted: Mapping[str, int]) -> str:
    """Return a sentence on the sources without a good frame, with the likely cause by the counts.

    A frame that is wrong is searched for others from its next byte on: its bytes are skipped, so
    skipped bytes are a cause only where nothing else is.
    """
    names = " and ".join(dict.fromkeys(silent))
    wrong = {reason: counted[reason] for reason in REASONS if counted[reason]}
    said = [f"{count} {_words(reason)}" for reason, count in wrong.items()]
    step = _LINE
    if wrong:
        most = max(wrong, key=wrong.__getitem__)
        _, step = _CAUSES.get(most, ("", f"{_WIRING}, then the frame's description"))
    elif not (counted["skipped_bytes"] or counted["frames"]):
        said, step = ["not a byte"], f"{_WIRING}, and the device that the rig names"
    elif counted["frames"]:
        said, step = [f"{counted['frames']} good ones of others"], f"{_WIRING}, then its format"
    else:
        said = [f"{counted['skipped_bytes']} bytes in which no frame was found"]
    return f"no good frame of {names} within {timeout_ms} ms, but {', '.join(said)}; {step}"


def _words(reason: str) -> str:
    words, _ = _CAUSES.get(reason, (f"rejected ({reason.replace('_', ' ')})", ""))
    return words
