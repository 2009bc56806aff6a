"""The status of a daemon as lines for people."""

import pytest

from teleop_rt.link.troubles import TROUBLES
from teleop_rt.service.commands import lines, result

LINK = [
    "link: last packet 1 ms ago",
    "packets: 1 of 100 lost, 2 refused",
    "axis: followed the master 3 times, held 4 times without fresh motion",
]
MOST_WORDS = 30
"""Words of a line that is read at one glance."""


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
    assert line == f"link: last packet {said} ago"


def test_what_is_as_it_should_be_takes_no_line():
    assert list(lines(status_with(1.0))) == [
        "Bench rig: RUN (trial cube, process 7)",
        "position 0.01 m, force 2 N, in contact, 1000 ticks",
        *LINK,
        "wake latency: p50 20, p99 50, max 300 us",
        "recording in runs/cube, 3 rows dropped",
        "ALARM: the disk is full",
        "c: refused (d)",
    ]


@pytest.mark.parametrize(("trouble", "cause"), TROUBLES[1:])
def test_trouble_with_the_link_is_a_line_of_its_cause_and_one_of_the_next_step(trouble, cause):
    status = status_with(None)
    status["link"] |= {"trouble": trouble, "cause": cause}
    shown = list(lines(status))
    place = next(i for i, line in enumerate(shown) if line.startswith("link: "))
    assert cause.startswith(shown[place].removeprefix("link: "))
    assert all(len(line.split()) <= MOST_WORDS for line in shown if not line.startswith("  next"))
    assert "packets: 1 of 100 lost, 2 refused" in shown


@pytest.mark.parametrize(("state", "meaning"), [
    ("DISARMED", "the drive has no power; `teleop-rt arm` powers it"),
    ("ARMED", "the drive has power, the axis holds its position; `teleop-rt start` lets it"),
    ("RUN", "the axis follows the master"),
    ("HOLD", "the axis holds its position until fresh motion comes from the master"),
])  # fmt: skip
def test_a_command_gives_the_resulting_state_in_one_line(state, meaning):
    (line,) = result(status_with(1.0) | {"state": state, "alarms": []})
    assert line.startswith(f"Bench rig: {state}: {meaning}")


def test_a_command_that_leaves_a_fault_or_an_alarm_gives_both():
    fault = {"code": 3, "name": "force", "cause": "too much", "next_step": "reset"}
    shown = list(result(status_with(1.0) | {"state": "FAULT", "fault": fault}))
    said = ["Bench rig: FAULT", "fault: force: too much; reset", "ALARM: the disk is full"]
    assert shown == said
