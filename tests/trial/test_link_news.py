"""A master that was started alone reports why it does not reach the slave."""

import pytest

from teleop_rt.link.troubles import NOTHING_TROUBLE, TROUBLES
from teleop_rt.trial.alone import PlainEvents
from teleop_rt.trial.link_news import report_link


class EndsAfter:
    """An event that comes after a number of looks at the link, without waiting."""

    def __init__(self, looks) -> None:
        self._left = looks

    def wait(self, _timeout):
        self._left -= 1
        return self._left < 0


@pytest.mark.parametrize(
    ("codes", "said"),
    [
        ([0, 0, 0], []),
        ([0, NOTHING_TROUBLE, NOTHING_TROUBLE], [TROUBLES[NOTHING_TROUBLE][1]]),
        ([NOTHING_TROUBLE, 0, 0], []),
        ([1, NOTHING_TROUBLE], [TROUBLES[1][1]]),
        ([1] + 2 * [NOTHING_TROUBLE], [TROUBLES[1][1], TROUBLES[NOTHING_TROUBLE][1]]),
        ([1, 0, 0, 1], [TROUBLES[1][1], "the slave answers", TROUBLES[1][1]]),
    ],
)
def test_each_trouble_is_reported_once_and_its_end_too(codes, said, capsys):
    report_link(iter(codes).__next__, PlainEvents("master"), EndsAfter(len(codes)))
    assert capsys.readouterr().out.splitlines() == [f"master: link: {words}" for words in said]


@pytest.mark.parametrize(
    ("reasons", "said"),
    [
        ({}, []),
        (
            {"magic": 3, "version": 0, "authentication": 20},
            ["master: 23 packets were rejected: 3 for magic, 20 for authentication"],
        ),
    ],
)
def test_a_side_says_at_its_end_how_many_packets_it_rejected_and_why(reasons, said, capsys):
    link = {"rejected": sum(reasons.values()), "rejected_by_reason": reasons}
    PlainEvents("master")("done", link=link)
    assert capsys.readouterr().out.splitlines() == ["master: done", *said]


@pytest.mark.parametrize(("received", "said"), [(0, 1), (3, 0)])
def test_a_slave_to_which_nothing_came_names_the_checks_at_its_end(received, said, capsys):
    safety = {"state": "DISARMED", "fault": {"name": "none"}}
    link = {"received": received, "rejected": 0}
    PlainEvents("slave")("done", link=link, safety=safety, missed_ticks=0)
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:] == said * [f"slave: link: {TROUBLES[NOTHING_TROUBLE][1]}"]


def test_the_truth_of_a_simulated_handle_is_no_line_for_people(capsys):
    PlainEvents("master")("truth", handle={"energy_J": 1.5})
    assert capsys.readouterr().out == ""
