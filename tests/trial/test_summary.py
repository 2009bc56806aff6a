"""Summaries of runs in which something was lost."""

import numpy as np
import pytest

from teleop_rt.config.section import Units
from teleop_rt.link.troubles import KEY_TROUBLE, NOTHING_TROUBLE, TROUBLES
from teleop_rt.trial import summary_notes
from teleop_rt.trial.estimators import Replayed
from teleop_rt.trial.felt_force import rows_to_compare
from teleop_rt.trial.felt_lines import leash_lines
from teleop_rt.trial.grades import of_link
from teleop_rt.trial.summary import judged_link
from teleop_rt.trial.table import packets_in_words
from teleop_rt_dev.trial.files import silicone


def replayed(nrmse=0.01):
    row = {
        "model": "kelvin-voigt",
        "regression": "direct",
        "solver": "rls",
        "effects": None,
        "nrmse": nrmse,
    }
    return Replayed([row], row, "", 0.0, np.empty(0))


def outcome(**changes):
    return {
        "recorder": {"dropped": {"/slave": 0}},
        "link": {"master": {"rejected": 0}},
        "rendering": {"state": "ENGAGED"},
    } | changes


def test_nothing_is_noted_of_a_run_in_good_order():
    assert summary_notes.notes_of(outcome(), replayed()) == []


HANDLE = {"fault": {"code": 0}, "softenings": 0, "leash_slipped": False}


@pytest.mark.parametrize(
    ("changes", "nrmse", "words"),
    [
        ({"recorder": {"dropped": {"/slave": 3, "/master": 4}}}, 0.01, "7 rows were not recorded"),
        ({"recorder": {"dropped": {}, "alarm": "the disk refuses"}}, 0.01, "the disk refuses"),
        ({"privileges": ["a: granted (b)", "c: refused (d); e"]}, 0.01, "c: refused (d); e"),
        (
            {"recorder": {"dropped": None, "restarts": 2}},
            0.01,
            "recorder ended unexpectedly 2 times",
        ),
        ({"link": {"master": {"rejected": 9}}}, 0.01, "refused 9"),
        (
            {"rendering": {"state": "WAITING"}},
            0.01,
            "never engaged: nothing was rendered; log.jsonl lists",
        ),
        ({}, 0.36, "misses the force by 36 %"),
        ({}, 0.36, "do not trust its parameters; teleop-rt diagnose names"),
        (
            {"rendering": {"handle": HANDLE | {"softenings": 2}}},
            0.01,
            "2 times; teleop-rt calibrate device",
        ),
        (
            {"rendering": {"handle": HANDLE | {"leash_slipped": True}}},
            0.01,
            "; approach more slowly",
        ),
    ],
)
def test_what_spoils_the_figures_is_noted(changes, nrmse, words):
    (note,) = summary_notes.notes_of(outcome(**changes), replayed(nrmse))
    assert words in note


def test_a_force_above_the_cap_is_noted_with_its_size_and_its_longest_time():
    force, valid = np.full(100, 89.9), np.ones(100)
    force[10:14], force[40:47], force[80], valid[80] = 95.0, 101.0, 300.0, 0.0
    slave = {"force": force, "valid": valid, "in_contact": np.zeros(100)}
    slave |= {
        "stamp_ns": 1e6 * np.arange(100.0),
        "position": np.zeros(100),
        "surface": np.full(100, np.nan),
    }
    adequate = {"inadequate": False}
    given = (outcome(), replayed(), adequate, None, 20.0)
    (note,) = summary_notes.all_notes(silicone(), slave, *given)
    assert note.startswith(
        "the tool pressed with 101 N, above slave.force_cap 90 N, for up to 7 ms at a time: a wall "
    )
    slave["force"] = np.minimum(force, 90.0)
    assert not summary_notes.all_notes(silicone(), slave, *given)


def test_rows_that_were_not_recorded_leave_a_gap_and_no_false_step():
    ticks = np.array([1.0, 2.0, 3.0, 7.0, 8.0])
    master = {"tick": ticks, "rendered_force": np.array([1.0, 1.1, 1.2, 35.0, 35.1])}
    ticks_ns = 1e6 * ticks
    whole = rows_to_compare({"stamp_ns": ticks_ns}, master | {"stamp_ns": ticks_ns})
    assert whole["rendered_force"].size == 8
    steps = np.abs(np.diff(whole["rendered_force"]))
    assert np.nanmax(steps) == pytest.approx(0.1)


def test_a_master_that_engaged_and_waits_at_the_end_is_not_said_never_to_have():
    rendering = {"state": "WAITING", "engagement": {"engagements": 1}}
    assert summary_notes.notes_of(outcome(rendering=rendering), replayed()) == []


def test_what_the_master_renders_after_the_slaves_last_tick_is_not_judged():
    slave = {"stamp_ns": np.array([10.0, 20.0, 30.0])}
    master = {
        "tick": np.arange(4.0),
        "stamp_ns": np.array([9.0, 29.0, 31.0, 2000.0]),
        "rendered_force": np.arange(4.0),
    }
    assert rows_to_compare(slave, master)["rendered_force"].tolist() == [0.0, 1.0]
    assert rows_to_compare({}, master) is master


def test_packets_that_a_dead_process_counted_are_not_known():
    counts = {"received": 10, "lost": 2, "overtaken": 1, "refused": None}
    assert packets_in_words(dict.fromkeys(counts)) == "the slave's counts of packets are not known"
    assert packets_in_words(counts) == (
        "of the master's packets 10 came, 2 were lost, 1 came after a newer one, "
        "an unknown number were refused"
    )


def test_the_leash_has_a_line_where_it_held_the_hand():
    units = Units(position="m", force="N")
    handle = {"largest_leash_force": 7.291, "longest_lead": 0.0271}
    [(name, said)] = leash_lines({"rendering": {"handle": handle}}, units)
    assert name == "leash"
    assert said == (
        "up to 7.29 N in free air held the hand back, which led the tool by up to 27.1 mm before"
        " the first touch"
    )
    for quiet in ({"longest_lead": 0.02}, handle | {"largest_leash_force": 0.0}, None):
        assert not list(leash_lines({"rendering": {"handle": quiet}}, units))
    assert not list(leash_lines({"rendering": None}, units))


@pytest.mark.parametrize(("ran_s", "trouble", "grade"), [
    (0.3, NOTHING_TROUBLE, "unknown"), (9.0, NOTHING_TROUBLE, "bad"), (0.3, KEY_TROUBLE, "bad"),
])  # fmt: skip
def test_a_run_that_ends_before_its_link_could_stand_has_no_trouble_with_it(ran_s, trouble, grade):
    """Ctrl-C 0.3 s after the first tick, over a round trip of 1 s, was a red cross."""
    counts = {"trouble": TROUBLES[trouble][1], "round_trip_ms": None, "lost": 0, "received": 0}
    found = judged_link(counts | {"master": dict(counts)}, ran_s)
    assert (of_link(found), of_link(found["master"])) == (grade, grade)
