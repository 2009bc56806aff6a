"""Data of the live page: rows of a run or a recording, and the lamps made of them."""

import os

import numpy as np
import pytest

from teleop_rt.cli.wiring import open_bench
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.ring import RingReader
from teleop_rt.realtime.ring_folder import describe, new_ring_folder
from teleop_rt.slave.faults import State
from teleop_rt.trial.estimators import recording_metadata
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt.trial.sides import merge_outcomes, slave_outcome
from teleop_rt_dev.trial.files import SILICONE, silicone

pytest.importorskip("bokeh")

from teleop_rt.view.live.feed import Feed, Thinner, Window
from teleop_rt.view.live.source import RecordingSource, RingSource, find_ring_folder
from teleop_rt.view.live.words import chain, fault


@pytest.fixture
def ring_folder():
    with new_ring_folder() as folder:
        yield folder


def started(ring_folder, *changes):
    trial = LockstepTrial(silicone(*changes), SILICONE.parent, open_bench, ring_folder)
    describe(ring_folder, recording_metadata(trial.trial))
    trial.slave.configure()
    return trial


def steps(trial, count):
    for _ in range(count):
        trial.step()


def test_a_run_is_found_and_shows_state_force_and_model(ring_folder):
    trial = started(ring_folder)
    feed = Feed(RingSource(lambda: find_ring_folder(os.getpid())), 10.0)
    for _ in range(40):
        steps(trial, 100)
        feed.poll()
    feed.judge()
    assert feed.about.trial == "silicone_cube"
    assert (feed.about.force_unit, feed.about.period_s) == ("N", 0.001)
    assert feed.health.state == State.RUN
    assert feed.health.in_contact
    assert feed.about.rows[feed.health.selected][0] in {"kelvin-voigt", "mass-spring-damper"}
    assert feed.health.loop.grade == "good"
    assert "ms one way" in feed.health.link.title
    shown = feed.shown["/slave"].columns["stamp_ns"]
    assert np.all(np.diff(shown) == 10e6)
    assert shown[-1] - shown[0] > 1.9e9


def test_packets_refused_are_those_of_both_ends_as_in_the_summary(ring_folder):
    trial = started(ring_folder)
    for end, packets in ((trial.slave_endpoint, 3), (trial.master_endpoint, 2)):
        for _ in range(packets):
            end.statistics.reject("authentication")
    feed = Feed(RingSource(lambda: find_ring_folder(os.getpid())), 10.0)
    for _ in range(40):
        steps(trial, 100)
        feed.poll()
    feed.judge()
    ends = (
        slave_outcome(trial.slave, trial.slave_endpoint, simulated=True),
        trial.master.outcome(),
    )
    assert merge_outcomes("simulated", *ends, {})["link"]["refused"] == 5
    assert "5 packets refused" in feed.health.link.text


def test_a_fault_stays_on_the_page_with_its_next_step_also_after_a_reset(ring_folder):
    trial = started(ring_folder)
    feed = Feed(RingSource(lambda: find_ring_folder(os.getpid())), 10.0)
    while trial.slave.safety.state != State.RUN:
        trial.step()
    trial.bench.axis.stop()
    trial.slave.stop(trial.slave.safety.fault.__class__(12, "force_limit", "", ""))
    for _ in range(30):
        trial.slave.cycle()
    feed.poll()
    feed.judge()
    assert feed.health.state in {State.SAFE_STOP, State.FAULT}
    text = fault(feed.health)
    assert 'class="lamp bad"' in text
    assert "raise limits.stiffness_max" in text  # no hand can move a simulated tool
    assert 'now stop" aria-current="true">' in chain(feed.health.state)
    while trial.slave.safety.state is not State.FAULT:
        trial.slave.cycle()
    assert trial.slave.safety.reset()
    trial.slave.cycle()
    feed.poll()
    feed.judge()
    assert feed.health.state == State.DISARMED
    assert "last fault: force limit" in fault(feed.health)
    assert 'class="lamp attention"' in fault(feed.health)


def test_a_reader_of_a_ring_cannot_write_to_it(ring_folder):
    started(ring_folder)
    reader = RingReader(ring_folder / "slave.ring")
    with pytest.raises(ValueError, match="read-only"):  # no public method writes
        reader._header[3] = 7


def test_a_recording_plays_at_its_own_pace_whole_and_once(recorded):
    now = [100.0]
    source = RecordingSource(recorded, lambda: now[0])
    assert source.about().trial == "silicone_cube"
    source.read()
    now[0] += 1.0
    rows = source.read()["/slave"]["tick"]
    assert rows.size == 1000
    assert not source.ended
    now[0] += 60.0
    rest = source.read()["/slave"]["tick"]
    assert source.ended
    assert source.read() == {}
    whole = read_topics(recorded, ["/slave"])["/slave"]["tick"]
    assert rows.size + rest.size == whole.size - 1


def test_a_recording_is_sought_held_paced_and_looped(recorded):
    now = [100.0]
    feed = Feed(RecordingSource(recorded, lambda: now[0]), 2.0)

    def shown():
        feed.poll()
        t = (feed.shown["/slave"].columns["stamp_ns"] - feed.start_ns) * 1e-9
        return t[0], t[-1]

    def after(seconds):
        now[0] += seconds
        return shown()

    shown()
    length_s = feed.source.length_s
    whole = read_topics(recorded, ["/slave"])["/slave"]["stamp_ns"]
    assert length_s == pytest.approx((whole[-1] - whole[0]) * 1e-9, abs=0.5)
    assert after(0.5)[1] == pytest.approx(0.5, abs=0.02)
    assert feed.ask({"seek": 0.9 * length_s})
    first_s, last_s = shown()
    assert last_s == pytest.approx(0.9 * length_s, abs=0.02)
    assert last_s - first_s >= min(2.0, last_s) - 0.05  # the length of the window before it
    assert feed.ask({"seek": 0.2})
    assert shown()[1] == pytest.approx(0.2, abs=0.02)
    assert not feed.ask({"play": False})
    assert after(5.0)[1] == pytest.approx(0.2, abs=0.02)
    assert not feed.ask({"play": True, "speed": 2.0})
    assert after(0.25)[1] == pytest.approx(0.7, abs=0.02)
    assert not feed.ask({"loop": True})
    after(60.0)
    assert feed.source.ended
    assert feed.again()
    assert after(0.1)[1] == pytest.approx(0.2, abs=0.02)
    assert not feed.again()


@pytest.mark.parametrize(
    "asked",
    [
        *({"speed": 0}, {"speed": 1e9}, {"seek": "now"}, {"seek": True}, {"play": 1}, {"x": 2}),
        *({"seek": 10**900}, {"speed": -(10**900)}),
    ],
)
def test_what_is_no_wish_of_a_playback_changes_nothing(recorded, asked):
    feed = Feed(RecordingSource(recorded, lambda: 7.0), 2.0)
    playback = feed.source.playback
    before = (playback.speed, playback.playing, playback.loops, playback.place_s)
    assert not feed.ask(asked)
    assert (playback.speed, playback.playing, playback.loops, playback.place_s) == before


def test_a_run_is_asked_nothing(ring_folder):
    feed = Feed(RingSource(find_ring_folder), 2.0)
    assert not feed.ask({"seek": 0.0})
    assert not feed.again()


def test_a_truncated_recording_is_played_as_far_as_it_goes(recorded, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[: recorded.stat().st_size // 2])
    now = [0.0]
    source = RecordingSource(cut, lambda: now[0])
    source.read()
    now[0] += 60.0
    ticks = source.read()["/slave"]["tick"]
    assert 500 < ticks.size < 2500
    assert np.all(np.diff(ticks) == 1)
    assert source.ended


def test_a_long_recording_is_played_from_the_file_not_from_memory(recorded):
    now = [0.0]
    source = RecordingSource(recorded, lambda: now[0])
    source.read()
    # Memory, which nothing public shows.
    held = sum(len(rows) for rows in source._ahead.values())
    assert held < 2 * 1500


def test_every_row_is_shown_once_whatever_the_size_of_the_pieces():
    ticks = np.arange(1000.0)
    thin, window = Thinner(5), Window(1e9)
    seen, taken = 0, []
    for piece in np.split(ticks, [3, 4, 9, 333, 334, 720]):
        window.take(thin({"stamp_ns": piece}))
        taken += window.between(seen, window.count)["stamp_ns"].tolist()
        seen = window.count
    assert taken == ticks[::5].tolist()


def test_a_window_forgets_what_is_older_and_a_late_browser_gets_the_rest():
    window = Window(0.010)
    for start in range(0, 100, 10):
        window.take({"stamp_ns": np.arange(start, start + 10) * 1e6})
    assert window.columns["stamp_ns"].tolist() == (np.arange(89, 100) * 1e6).tolist()
    assert window.between(0, window.count)["stamp_ns"].size == 11
    assert window.between(0, window.count - 4)["stamp_ns"].size == 7
    assert window.between(window.count, window.count)["stamp_ns"].size == 0
