"""The status of a daemon as lines for people."""

import pytest

from teleop_rt.service.commands import lines

LINK = (
    "link: last packet 1 ms ago, 1 of 100 packets lost, 2 refused; followed 3 times, held 4 "
    "times without fresh motion"
)


def status_with(silence_ms: float | None):
    link = {
        "trouble": "", "cause": "", "silence_ms": silence_ms, "packets_lost": 1,
        "packets_received": 99, "packets_rejected": 2, "followings": 3, "holds": 4,
    }  # fmt: skip
    return {
        "rig": "Bench rig", "state": "RUN", "trial": "cube", "pid": 7, "tick": 1000, "link": link,
        "fault": {"code": 0}, "last_fault": None, "units": {"position": "m", "force": "N"},
        "position": 0.01, "force": 2.0, "in_contact": True, "folder": "runs/cube",
        "timing_us": {"wake_latency": {"p50": 20.0, "p99": 50.0, "max": 300.0}, "work": None},
        "recorder": {"dropped": {"/slave": 1, "/events": 2}}, "alarms": ["the disk is full"],
        "privileges": ["a: granted (b)", "c: refused (d)"],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("silence_ms", "said"), [(0.25, "0.25 ms"), (-0.4, "0 ms"), (None, "unknown")]
)
def test_the_age_of_the_last_packet_is_never_negative(silence_ms, said):
    """A packet that came after the status' own stamp would be from the future."""
    (line,) = (one for one in lines(status_with(silence_ms)) if one.startswith("link"))
    assert line.startswith(f"link: last packet {said} ago, 1 of 100 packets lost, 2 refused;")


def test_what_is_as_it_should_be_takes_no_line():
    assert list(lines(status_with(1.0))) == [
        "Bench rig: RUN (trial cube, process 7)",
        "position 0.01 m, force 2 N, in contact, 1000 ticks",
        LINK,
        "wake latency: p50 20, p99 50, max 300 us",
        "recording in runs/cube, 3 rows dropped",
        "ALARM: the disk is full",
        "c: refused (d)",
    ]
