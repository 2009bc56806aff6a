"""Data of the live page: rows of a session or a recording, and the lamps made of them."""

import asyncio
import base64
import json
import os
import pty
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import closing, contextmanager
from socket import socket
from urllib.parse import urlsplit

import numpy as np
import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from teleop_rt.cli.wiring import open_bench
from teleop_rt.realtime.recording import read_topics
from teleop_rt.realtime.ring import RingReader
from teleop_rt.realtime.session import describe, new_session
from teleop_rt.slave.faults import State
from teleop_rt.trial.estimators import recording_metadata
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import LockstepTrial, run_lockstep
from teleop_rt.trial.sides import merge_outcomes, slave_outcome
from teleop_rt_dev.trial.files import SILICONE, silicone

pytest.importorskip("bokeh")

from teleop_rt.view.live import source as source_module
from teleop_rt.view.live.feed import Feed, Thinner, Window
from teleop_rt.view.live.frames import Frames
from teleop_rt.view.live.server import FULL_RATE_BROWSERS, Audience
from teleop_rt.view.live.source import RecordingSource, RingSource, find_session
from teleop_rt.view.live.words import chain, fault


@pytest.fixture
def session():
    with new_session() as folder:
        yield folder


def started(session, *changes):
    trial = LockstepTrial(silicone(*changes), SILICONE.parent, open_bench, session)
    describe(session, recording_metadata(trial.trial))
    trial.slave.configure()
    return trial


def steps(trial, count):
    for _ in range(count):
        trial.step()


def test_a_running_session_is_found_and_shows_state_force_and_model(session):
    trial = started(session)
    feed = Feed(RingSource(lambda: find_session(os.getpid())), 10.0)
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


def test_packets_refused_are_those_of_both_ends_as_in_the_summary(session):
    trial = started(session)
    for end, packets in ((trial.slave_endpoint, 3), (trial.master_endpoint, 2)):
        for _ in range(packets):
            end.statistics.reject("authentication")
    feed = Feed(RingSource(lambda: find_session(os.getpid())), 10.0)
    for _ in range(40):
        steps(trial, 100)
        feed.poll()
    feed.judge()
    ends = (slave_outcome(trial.slave, trial.slave_endpoint), trial.master.outcome())
    assert merge_outcomes("simulated", *ends, {})["link"]["refused"] == 5
    assert "5 packets refused" in feed.health.link.text


def test_a_fault_stays_on_the_page_with_its_next_step_also_after_a_reset(session):
    trial = started(session)
    feed = Feed(RingSource(lambda: find_session(os.getpid())), 10.0)
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
    assert "move the tool away" in text
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


def test_an_address_of_another_machine_is_refused(call, recorded):
    for host in ("192.0.2.7", "no such name"):
        code, out, err = call("live", recorded, "--host", host)
        assert (code, out) == (2, "")
        assert f"--host {host}: is no address of this machine" in err


def test_a_reader_of_a_ring_cannot_write_to_it(session):
    started(session)
    reader = RingReader(session / "slave.ring")
    with pytest.raises(ValueError, match="read-only"):
        reader._header[3] = 7


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("live") / "run"
    folder.mkdir()
    trial = silicone("duration_s=3.0")
    write_trial(folder, trial)
    run_lockstep(trial, SILICONE, open_bench, folder, lambda _seconds: None)
    return folder / "recording.mcap"


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
    assert last_s - first_s >= min(2.0, last_s) - 0.05  # what a window before it holds
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


def test_a_running_session_is_asked_nothing(session):
    feed = Feed(RingSource(find_session), 2.0)
    assert not feed.ask({"seek": 0.0})
    assert not feed.again()


PATIENCE_S = 120


async def _look(address, frames):
    """Open the page as a browser does, and return so many frames."""
    patience = {"connect_timeout": PATIENCE_S, "request_timeout": PATIENCE_S}
    headers = {"Origin": address.removesuffix("/")}
    request = HTTPRequest(address.replace("http", "ws") + "frames", headers=headers, **patience)
    line = await websocket_connect(request)
    sent = [json.loads(await line.read_message()) for _ in range(frames)]
    line.close()
    while await line.read_message() is not None:
        pass
    return sent


@contextmanager
def served(*arguments):
    """Give the address of a live page that another process serves."""
    command = [sys.executable, "-m", "teleop_rt", "live", *map(str, arguments), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield re.search(r"(http|ws)://\S+", server.stdout.readline()).group()
        finally:
            server.terminate()


@pytest.fixture(scope="module")
def page(recorded):
    with served(recorded) as address:
        yield address


def test_fifty_browsers_at_once_all_see_the_force_and_so_does_the_next_one(page):
    async def fifty(address):
        return await asyncio.gather(*(_look(address, 3) for _ in range(50)))

    looks = asyncio.run(asyncio.wait_for(fifty(page), PATIENCE_S))
    later = asyncio.run(asyncio.wait_for(_look(page, 1), PATIENCE_S))
    for sent in (*looks, later):
        assert "silicone_cube" in sent[0]["words"]["about"]
        assert force_in(sent).size > 0
        assert np.all(np.isfinite(force_in(sent)))
    notes = [frame["words"].get("note", "") for sent in looks for frame in sent]
    assert any(re.match(r"\d+ browsers look: \d+ frames/s for each", note) for note in notes)


@pytest.mark.parametrize("path", ["", "frames"])
def test_a_page_is_given_under_its_own_name_alone(page, path):
    """A page elsewhere may have its own name lead to this machine (DNS rebinding)."""
    port = urlsplit(page).port
    evil = f"evil.example:{port}"
    upgrade = {
        "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Origin": f"http://{evil}",
    }  # fmt: skip
    asked = urllib.request.Request(f"http://127.0.0.1:{port}/{path}", headers={"Host": evil})
    for name, value in upgrade.items() if path else ():
        asked.add_header(name, value)
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(asked, timeout=PATIENCE_S)  # noqa: S310 - our own page
    assert refused.value.code == 403
    refused.value.close()


def force_in(frames):
    """Return the forces in some frames, as the page reads them."""
    slaves = [frame["sources"]["slave"] for frame in frames if "slave" in frame["sources"]]
    pieces = [slave["columns"]["filtered_force"] for slave in slaves]
    return np.frombuffer(b"".join(map(base64.b64decode, pieces)), "<f8")


class Browser:
    """A line that keeps what it is sent, as the page does."""

    def __init__(self):
        self.free, self.frames, self.rows, self.row = True, [], {}, None

    def send(self, text):
        self.frames.append(text)
        for name, sent in json.loads(text)["sources"].items():
            held = {} if sent["replace"] else self.rows[name]
            for column, packed in sent["columns"].items():
                values = np.frombuffer(base64.b64decode(packed), "<f8")
                held[column] = np.append(held.get(column, []), values)[-sent["keep"] :]
            self.rows[name] = held


class Counted(Frames):
    """Frames that count how often they are composed."""

    composed = 0

    def next(self, note=""):
        self.composed += 1
        return super().next(note)

    def whole(self, note=""):
        self.composed += 1
        return super().whole(note)


@pytest.fixture
def stage(recorded):
    """Give what serves a page, on a recording whose time is stepped by hand."""
    now = [0.0]
    feed = Feed(RecordingSource(recorded, lambda: now[0]), 10.0)
    frames = Counted(feed)
    audience = Audience(frames)

    def tick(count=1):
        for _ in range(count):
            now[0] += 0.04
            feed.poll()
            feed.judge()
            audience.tick()

    return feed, frames, audience, tick


def test_plots_name_their_units_and_parameters_as_the_report_does(stage):
    feed, _, audience, tick = stage
    browser = Browser()
    audience.join(browser)
    tick(5)
    assert estimators_in(browser)["selected"] == -1
    tick(60)
    plots = plots_in(browser)
    assert plots["plot_force"]["label"] == "force [N]"
    assert plots["plot_position"]["label"] == "position [mm]"
    estimators = estimators_in(browser)
    assert estimators["names"][0] == "Kelvin-Voigt, RLS"
    assert estimators["selected"] == feed.health.selected == 0
    assert estimators["parameters"] == {
        "0": [
            {"title": "k of Kelvin-Voigt, RLS", "label": "k [N/m]"},
            {"title": "b of Kelvin-Voigt, RLS", "label": "b [N s/m]"},
        ]
    }
    shown = 1e3 * feed.shown["/slave"].columns["position"]
    np.testing.assert_array_equal(browser.rows["slave"]["position"], shown)


def plots_in(browser):
    """Return the last description of each plot that a browser received."""
    sent = {}
    for text in browser.frames:
        sent |= json.loads(text)["plots"]
    return sent


def estimators_in(browser):
    """Return the last description of the estimators that a browser received."""
    sent = [json.loads(text) for text in browser.frames]
    return [frame["estimators"] for frame in sent if "estimators" in frame][-1]


def test_each_browser_chooses_an_estimator_and_gets_its_rows_from_their_beginning(stage):
    feed, _, audience, tick = stage
    one, other = Browser(), Browser()
    audience.join(one)
    audience.join(other)
    tick(60)
    assert set(estimators_in(one)["parameters"]) == {"0"}
    one.row, other.row = 2, 10_000  # no estimator has that row
    tick(10)
    assert set(estimators_in(one)["parameters"]) == {"0", "2"}
    assert estimators_in(one)["parameters"]["2"][2]["label"] == "n [-]"
    window = feed.shown["/estimates/hunt-crossley/direct/rls"]
    assert one.rows["estimate 2"]["t"].size > 5
    assert one.rows["estimate 2"]["t"].size == pytest.approx(window.size, abs=5)
    one.row = None
    tick(5)
    held = one.rows["estimate 2"]["t"].size
    tick(20)
    assert one.rows["estimate 2"]["t"].size == held  # nobody looks: nothing is sent
    assert one.rows["estimate 0"]["t"].size > held


def test_frames_are_composed_once_however_many_look(stage):
    _, frames, audience, tick = stage
    browsers = [Browser() for _ in range(FULL_RATE_BROWSERS)]
    for browser in browsers:
        audience.join(browser)
    tick(20)
    assert frames.composed == 20 + 1
    assert all(len(browser.frames) == 20 for browser in browsers)
    assert len({text for browser in browsers for text in browser.frames}) == 20
    assert not any("browsers look" in text for text in browsers[0].frames)


def test_beyond_a_stated_number_the_frames_are_shared_out_and_the_page_says_so(stage):
    _, frames, audience, tick = stage
    browsers = [Browser() for _ in range(2 * FULL_RATE_BROWSERS + 1)]
    for browser in browsers:
        audience.join(browser)
    tick(60)
    assert frames.composed == 20 + 1
    assert all(len(browser.frames) == 20 for browser in browsers)
    assert f"{len(browsers)} browsers look: 8 frames/s for each" in browsers[-1].frames[0]
    for browser in browsers[1:]:
        audience.leave(browser)
    tick(10)
    assert len(browsers[0].frames) == 30
    assert json.loads(browsers[0].frames[-1])["words"].get("note", "") == ""


def test_who_comes_late_or_lags_ends_up_with_what_the_others_have(stage):
    feed, _, audience, tick = stage
    first, lagging, late = Browser(), Browser(), Browser()
    audience.join(first)
    audience.join(lagging)
    tick(8)
    lagging.free = False
    tick(7)
    audience.join(late)
    tick(7)
    lagging.free = True
    tick(14)
    assert len(lagging.frames) == 8 + 14
    for other in (lagging, late):
        for name in ("slave", "master", "residual", "estimate 0"):
            for column, values in first.rows[name].items():
                np.testing.assert_array_equal(other.rows[name][column], values)
    shown = feed.shown["/slave"].columns
    np.testing.assert_array_equal(first.rows["slave"]["filtered_force"], shown["filtered_force"])


def test_a_page_of_another_site_may_not_look(page):
    async def look():
        headers = {"Origin": "http://elsewhere.example"}
        await websocket_connect(HTTPRequest(page.replace("http", "ws") + "frames", headers=headers))

    with pytest.raises(HTTPClientError, match="403"):
        asyncio.run(asyncio.wait_for(look(), PATIENCE_S))


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
    held = sum(len(rows) for rows in source._ahead.values())
    assert held < 2 * 1500


async def _first_row(address, topic):
    """Subscribe to a topic as Foxglove does; return every announced topic, and the first row."""
    patience = {"connect_timeout": PATIENCE_S, "request_timeout": PATIENCE_S}
    line = await websocket_connect(
        HTTPRequest(address, **patience), subprotocols=["foxglove.sdk.v1"]
    )
    topics, row = {}, None
    while row is None:
        sent = await line.read_message()
        assert sent is not None
        if isinstance(sent, bytes):
            row = json.loads(sent[13:])
            continue
        sent = json.loads(sent)
        topics |= {c["topic"]: c["id"] for c in sent.get("channels", ())}
        if topic in topics:  # again after a refusal: a channel is announced before it can be used
            wanted = [{"id": 1, "channelId": topics[topic]}]
            await line.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    line.close()
    while await line.read_message() is not None:
        pass
    return topics, row


def test_foxglove_gets_every_topic_and_its_rows_from_the_start(recorded):
    pytest.importorskip("foxglove")
    with served(recorded, "--foxglove") as address:
        topics, row = asyncio.run(asyncio.wait_for(_first_row(address, "/slave"), PATIENCE_S))
    assert {"/slave", "/master"} <= set(topics)
    first = {
        name: values[0] for name, values in read_topics(recorded, ["/slave"])["/slave"].items()
    }
    assert row == {name: None if np.isnan(value) else value for name, value in first.items()}


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


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.mcap"], "nowhere.mcap: no such file: give a recording"),
        (["{file}"], "not an MCAP recording"),
    ],
)
def test_what_cannot_be_shown_is_refused(call, tmp_path, arguments, words):
    file = tmp_path / "text.mcap"
    file.write_text("not a recording at all")
    code, out, err = call("live", *(argument.format(file=file) for argument in arguments))
    assert (code, out) == (2, "")
    assert words in err


@pytest.fixture
def nobody(monkeypatch, tmp_path):
    """Give an empty place for sessions, where nothing else on this machine is seen."""
    shared = tmp_path / "shm"
    shared.mkdir()
    monkeypatch.setattr(source_module, "shared_folder", lambda: shared)
    monkeypatch.setenv("TELEOP_RT_RUN_DIR", str(tmp_path / "run"))
    return shared


def test_without_a_run_it_says_what_to_do(call, nobody):
    code, out, err = call("live")
    assert (code, out) == (2, "")
    assert "nothing runs on this machine" in err
    assert "start `teleop-rt run --live` or `teleop-rt slave TRIAL`, or name a recording" in err


def test_a_page_whose_run_died_while_it_loaded_ends(call, nobody, monkeypatch):
    monkeypatch.setattr(source_module, "end_with_parent", lambda: None)
    code, out, err = call("live", "--beside", 1 + os.getpid())
    assert (code, out) == (2, "")
    assert f"the run of process {1 + os.getpid()} has ended" in err


def test_rings_of_another_user_are_refused_with_who_may_read_them(call, nobody, monkeypatch):
    session = nobody / f"teleop-rt-{os.getpid()}-other"
    session.mkdir()
    monkeypatch.setattr(source_module.os, "access", lambda *_: False)
    code, out, err = call("live")
    assert (code, out) == (2, "")
    assert f"process {os.getpid()} runs, and this user may not read its rings" in err
    assert f"look as {session.owner()}, or join the group {session.group()}" in err


def test_a_daemon_at_its_place_comes_before_a_newer_run_without_one(nobody, tmp_path):
    daemon, newer = (nobody / f"teleop-rt-{os.getpid()}-{name}" for name in ("a", "b"))
    daemon.mkdir()
    newer.mkdir()
    os.utime(newer, (4e9, 4e9))
    assert find_session() == newer
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "rig.session").symlink_to(daemon)
    assert find_session() == daemon


def test_the_live_page_of_a_run_stays_at_a_terminal_until_it_is_interrupted(tmp_path):
    ours, theirs = pty.openpty()
    words = ["run", SILICONE, "--clock", "simulated", "--duration", "1", "--live", "--port", "0"]
    command = [sys.executable, "-m", "teleop_rt", *map(str, words), "--out", tmp_path / "run"]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        shown = ""
        while "the live page stays" not in shown:
            shown += os.read(ours, 1 << 16).decode()
        address = re.search(r"http://[\d.:]+/", shown).group()
        with urllib.request.urlopen(address) as page:  # noqa: S310 - http, above
            assert page.status == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    os.close(ours)
    assert "safety" in shown  # the summary came before
    assert shown.index("reading the recording") < shown.index("writing the report")
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(address)  # noqa: S310 - as above


@pytest.mark.parametrize("command", [["live"], ["run", "--live"]])
def test_a_port_in_use_is_reported_before_anything_moves(call, tmp_path, recorded, command):
    with closing(socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        file = recorded if command == ["live"] else SILICONE
        code, out, err = call(*command, file, "--port", port)
    assert (code, out) == (2, "")
    assert f"--port {port}: Address already in use: choose another" in err
    assert not (tmp_path / "runs").exists()
