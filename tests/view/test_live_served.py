"""The live page as a command serves it: permitted viewers, and refusals."""

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

from teleop_rt.realtime.reading import read_topics
from teleop_rt_dev.trial.files import SILICONE

pytest.importorskip("bokeh")

from teleop_rt.view.live import source as source_module
from teleop_rt.view.live.source import find_ring_folder

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


def test_a_page_of_another_site_may_not_look(page):
    async def look():
        headers = {"Origin": "http://elsewhere.example"}
        await websocket_connect(HTTPRequest(page.replace("http", "ws") + "frames", headers=headers))

    with pytest.raises(HTTPClientError, match="403"):
        asyncio.run(asyncio.wait_for(look(), PATIENCE_S))


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


def test_the_live_page_of_a_run_stays_at_a_terminal_until_it_is_interrupted(tmp_path):
    ours, theirs = pty.openpty()
    words = ["run", SILICONE, "--clock", "simulated", "--duration", "1", "--live", "--port", "0"]
    words += ["--set", "estimation.models=[kelvin-voigt]", "--out", tmp_path / "run"]
    command = [sys.executable, "-m", "teleop_rt", *map(str, words)]
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


def test_an_address_of_another_machine_is_refused(call, recorded):
    for host in ("192.0.2.7", "no such name"):
        code, out, err = call("live", recorded, "--host", host)
        assert (code, out) == (2, "")
        assert f"--host {host}: is no address of this machine" in err


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
    """Give an empty place for ring folders, where nothing else on this machine is seen."""
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
    ring_folder = nobody / f"teleop-rt-{os.getpid()}-other"
    ring_folder.mkdir()
    monkeypatch.setattr(source_module.os, "access", lambda *_: False)
    code, out, err = call("live")
    assert (code, out) == (2, "")
    assert f"process {os.getpid()} runs, and this user may not read its rings" in err
    assert f"look as {ring_folder.owner()}, or join the group {ring_folder.group()}" in err


def test_a_daemon_at_its_place_comes_before_a_newer_run_without_one(nobody, tmp_path):
    daemon, newer = (nobody / f"teleop-rt-{os.getpid()}-{name}" for name in ("a", "b"))
    daemon.mkdir()
    newer.mkdir()
    os.utime(newer, (4e9, 4e9))
    assert find_ring_folder() == newer
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "rig.rings").symlink_to(daemon)
    assert find_ring_folder() == daemon
