"""The compiled kernels that a packet passes, loaded before the first one comes."""

from __future__ import annotations

import functools

from teleop_rt.link import intake
from teleop_rt.link.codec import HEADER_BYTES
from teleop_rt.link.peer_clock import PeerClock
from teleop_rt.link.session import ReplayWindow
from teleop_rt.link.statistics import Statistics


@functools.cache
def load_kernels() -> None:
    """Compile or load the kernels of a packet, so that the first one does not wait for them."""
    link, clock, statistics = intake.new_words(0, 0), PeerClock(), Statistics()
    words = (link, clock.words, statistics.words)
    intake.read_header(link, bytes(HEADER_BYTES))
    intake.take_in(*words, b"", 0, 0, 0)
    intake.take_stamps(*words, 0)
    window = ReplayWindow()
    window.check(1)
    window.add(1)
    clock.exchange(0, 0, 0, 0)
    clock.fix()  # asks for the link's own time, now that there is one
