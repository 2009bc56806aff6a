"""Every bound that the page on security states is the one in the code."""

from pathlib import Path

import pytest

from teleop_rt.config import yaml_file
from teleop_rt.link import handshake, peer_clock, session, sessions
from teleop_rt.service import config_check
from teleop_rt.view.live import bounded_http, server

ROOT = Path(__file__).parents[1]
S_NS = 1_000_000_000
PAGE = " ".join((ROOT / "docs" / "security.md").read_text(encoding="utf-8").split())


@pytest.mark.parametrize(
    "stated",
    [
        f"new ones every {sessions.REKEY_AFTER_NS // (60 * S_NS)} min, none older",
        f"none older than {sessions.REJECT_AFTER_NS // (60 * S_NS)} min",
        f"a window of {session.REPLAY_WINDOW} packets",
        f"at most {handshake.HANDSHAKES_PER_S} handshakes a second",
        f"{handshake.RETRIES_PER_HOST} to each host, {handshake.RETRIES_PER_S} to all",
        f"a poll spends at most {handshake.HASHES_PER_POLL} hashes",
        f"moves by at most {peer_clock.SLEW_PPM} ppm",
        f"hides {peer_clock.SLEW_PPM * 60e-3:g} ms of delay in a minute",
        f"limited to {config_check.CPU_S} s of processor time and",
        f"of processor time and {config_check.MOST_BYTES >> 30} GB",
        f"must be complete within {bounded_http.WHOLE_WITHIN_S:g} s",
        f"a message from a browser has at most {bounded_http.LONGEST_MESSAGE} bytes",
        f"at most {bounded_http.MOST_ASKING} connections and {server.MOST_BROWSERS} browsers",
        f"at most {yaml_file.MOST_BYTES >> 10} KB, {yaml_file.MOST_NODES // 1000} 000 values",
        f"values and a depth of {yaml_file.DEEPEST}",
    ],
)  # fmt: skip
def test_a_stated_bound_is_that_of_the_code(stated):
    assert stated in PAGE
