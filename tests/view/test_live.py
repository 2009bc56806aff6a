"""What the live page is fed: rows of a session or a recording, and the lamps made of them."""

import asyncio
import json
import os
import re
import subprocess
import sys
from contextlib import closing
from socket import socket

import numpy as np
import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect
from trial_files import SILICONE, silicone

from teleop_rt.cli.wiring import open_bench
from teleop_rt.realtime.recording import read_topics
from teleop_rt.realtime.ring import RingReader
from teleop_rt.realtime.session import new_session
from teleop_rt.slave.faults import State
from teleop_rt.trial.folder import write_trial
from teleop_rt.trial.lockstep_run import LockstepTrial, run_lockstep

pytest.importorskip("bokeh")

from teleop_rt.view.live.feed import Feed, Thinner, Window
from teleop_rt.view.live.source import RecordingSource, RingSource, find_session
from teleop_rt.view.live.words import chain, fault


@pytest.fixture
def session():
    with new_session() as folder:
        yield folder


def started(session, *changes):
    trial = LockstepTrial(silicone(*changes), SILICONE.parent, open_bench, session)
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
    assert np.all(np.diff(shown) == 5e6)
    assert shown[-1] - shown[0] > 1.9e9


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
    trial.slave.safety.state = State.FAULT
    assert trial.slave.safety.reset()
    trial.slave.cycle()
    feed.poll()
    feed.judge()
    assert feed.health.state == State.DISARMED
    assert "last fault: force limit" in fault(feed.health)
    assert 'class="lamp attention"' in fault(feed.health)


def test_an_address_of_another_machine_is_told(call, recorded):
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


PATIENCE_S = 120


async def _look(address, frames):
    """Open the page as a browser does, and read until so many frames have come."""
    patience = {"connect_timeout": PATIENCE_S, "request_timeout": PATIENCE_S}
    client = AsyncHTTPClient(force_instance=True)
    page = await client.fetch(address, **patience)
    client.close()
    (token,) = re.findall(r'"token":"([^"]+)"', page.body.decode())
    headers = {"Origin": address.removesuffix("/")}
    request = HTTPRequest(address.replace("http", "ws") + "ws", headers=headers, **patience)
    line = await websocket_connect(request, subprotocols=["bokeh", token])
    seen = 0
    while seen < frames:
        message = await line.read_message()
        assert message is not None
        seen += "PATCH-DOC" in str(message)
    line.close()
    while await line.read_message() is not None:
        pass


def test_five_browsers_all_get_their_frames_and_the_next_one_too(recorded):
    command = [sys.executable, "-m", "teleop_rt", "live", recorded, "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            address = re.search(r"http://\S+", server.stdout.readline()).group()

            async def five():
                await asyncio.gather(*(_look(address, 2) for _ in range(5)))

            asyncio.run(asyncio.wait_for(five(), PATIENCE_S))
            asyncio.run(asyncio.wait_for(_look(address, 1), PATIENCE_S))
        finally:
            server.terminate()


def test_foxglove_is_told_every_topic_and_its_rows(recorded):
    pytest.importorskip("foxglove")
    command = [sys.executable, "-m", "teleop_rt", "live", recorded, "--foxglove", "--port", "0"]

    async def listen(address):
        line = await websocket_connect(
            HTTPRequest(address, connect_timeout=PATIENCE_S, request_timeout=PATIENCE_S),
            subprotocols=["foxglove.sdk.v1"],
        )
        topics = {}
        while "/slave" not in topics or "/master" not in topics:
            told = await line.read_message()
            if isinstance(told, str) and json.loads(told)["op"] == "advertise":
                topics |= {c["topic"]: c["id"] for c in json.loads(told)["channels"]}
        wanted = [{"id": 1, "channelId": topics["/slave"]}]
        await line.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        while not isinstance(row := await line.read_message(), bytes):
            assert row is not None
        line.close()
        while await line.read_message() is not None:
            pass
        return json.loads(row[13:])

    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            address = re.search(r"ws://\S+", server.stdout.readline()).group()
            row = asyncio.run(asyncio.wait_for(listen(address), PATIENCE_S))
        finally:
            server.terminate()
    assert row["stamp_ns"] > 0
    assert {"force", "position", "predicted_force"} <= set(row)


def test_every_row_is_shown_once_whatever_the_size_of_the_pieces():
    ticks = np.arange(1000.0)
    thin, window = Thinner(5), Window(1e9)
    seen, taken = 0, []
    for piece in np.split(ticks, [3, 4, 9, 333, 334, 720]):
        window.take(thin({"stamp_ns": piece}))
        taken += window.since(seen)["stamp_ns"].tolist()
        seen = window.count
    assert taken == ticks[::5].tolist()


def test_a_window_forgets_what_is_older_and_a_late_browser_gets_the_rest():
    window = Window(0.010)
    for start in range(0, 100, 10):
        window.take({"stamp_ns": np.arange(start, start + 10) * 1e6})
    assert window.columns["stamp_ns"].tolist() == (np.arange(89, 100) * 1e6).tolist()
    assert window.since(0)["stamp_ns"].size == 11
    assert window.since(window.count)["stamp_ns"].size == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.mcap"], "no such recording: wait for the run to begin"),
        (["{file}"], "not an MCAP recording"),
    ],
)
def test_what_cannot_be_shown_is_told(call, tmp_path, arguments, words):
    file = tmp_path / "text.mcap"
    file.write_text("not a recording at all")
    code, out, err = call("live", *(argument.format(file=file) for argument in arguments))
    assert (code, out) == (2, "")
    assert words in err


@pytest.mark.parametrize("command", [["live"], ["run", "--live"]])
def test_a_port_in_use_is_told_before_anything_moves(call, tmp_path, recorded, command):
    with closing(socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        file = recorded if command == ["live"] else SILICONE
        code, out, err = call(*command, file, "--port", port)
    assert (code, out) == (2, "")
    assert f"--port {port}: Address already in use: choose another" in err
    assert not (tmp_path / "runs").exists()
