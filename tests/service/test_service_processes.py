"""The daemon as its own process: as systemd starts it, commanded, killed beside, and ended."""

import json
import os
import re
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import can
import pytest
from browser import console_errors, headless_chromium, points, text, until
from machine_witness import undisturbed

from teleop_rt.realtime.reading import read_topics
from teleop_rt.slave.faults import State
from teleop_rt_dev.paths import SILICONE, TRIALS
from teleop_rt_dev.service.lab import POLL_S, READY, Lab
from teleop_rt_drivers.canopen.receiver import EMERGENCY
from teleop_rt_drivers.unix_bus import UnixBus

pytestmark = pytest.mark.realtime

RIGS = TRIALS.parent / "rigs"
RATE_HZ = 250
"""Slow: beside a rig and its daemon others need the machine, a browser for one."""
RATE = f"rig.rate_hz={RATE_HZ}"
HELD_UP = {"late_ticks", "samples_lost"}
STOPPED_OR_ARMED = r'aria-current="true">(ARMED|SAFE_STOP|FAULT)<'


@pytest.fixture
def lab(tmp_path):
    with Lab(tmp_path, RATE) as one:
        yield one


def test_a_daemon_lives_takes_commands_keeps_its_fault_and_ends(lab):
    daemon = lab.start("slave")
    assert READY in lab.heard()
    status = lab.settled()
    assert (status["state"], status["pid"]) == ("DISARMED", daemon.pid)
    assert (Path(status["ring_folder"]) / "slave.ring").exists()
    while lab.polled()["tick"] < status["tick"] + RATE_HZ:
        time.sleep(POLL_S)
    assert b"WATCHDOG=1" in lab.heard()
    assert len(list(Path(f"/proc/{daemon.pid}/task").iterdir())) == 1

    code, _, errors = lab.call("slave", *lab.trial, "--out", lab.folder / "second")
    assert code == 2
    assert f"this rig is in use by process {daemon.pid}" in errors
    assert not (lab.folder / "second").exists()

    code, _, errors = lab.call("start")
    assert (code, errors) == (1, "the axis is not armed: `teleop-rt arm` first\n")
    code, out, _ = lab.call("arm")
    if code == 0:  # a machine that holds the loop up stops it rightly, and sooner
        assert "ARMED" in out

    lab.rig.kill()
    assert lab.call("stop")[0] == 0
    assert lab.status()["state"] in {"DISARMED", "SAFE_STOP", "FAULT"}
    lab.heard()  # a manager that does not listen gets nothing more
    daemon.terminate()
    out, errors = daemon.communicate()
    assert daemon.returncode == (1 if "stopped:" in errors else 0), errors
    assert "slave: done" in out
    assert out.splitlines()[-1] == f"files in {lab.folder / 'slave'}"
    summary = json.loads((lab.folder / "slave" / "summary.json").read_text())
    assert summary["recorder"]["alarm"] == ""
    listed = lab.call("runs", lab.folder / "slave", "--json")[1]
    assert json.loads(listed)["ended"].startswith("slave alone: ")
    assert b"STOPPING=1" in lab.heard()
    assert lab.call("status")[0] == 2
    assert not list((lab.folder / "run").glob("*.s*"))


def test_helpers_of_a_daemon_that_are_killed_are_started_again_while_its_loop_goes_on(lab):
    daemon = lab.start("slave")
    ticks_before = lab.polled()["tick"]
    for name in ("commands", "recorder"):
        victim = lab.helper(name)
        os.kill(victim, signal.SIGKILL)
        while lab.helper(name) in {victim, None}:
            time.sleep(0.01)
    second = lab.folder / "slave" / "recording.part0002.mcap"
    while (status := lab.polled())["recorder"]["restarts"] == 0 or not second.exists():
        time.sleep(POLL_S)
    assert status["pid"] == daemon.pid
    assert status["tick"] > ticks_before
    assert status["commands"] == {"restarts": 1, "last_end": "killed by signal 9"}
    assert [alarm.partition(" and ")[0] for alarm in status["alarms"]] == [
        "the recorder ended unexpectedly once",
        "the command server ended unexpectedly once",
    ]
    assert (
        "ALARM: the recorder ended unexpectedly once and was started again" in lab.call("status")[1]
    )
    daemon.terminate()
    daemon.communicate()
    summary = json.loads((lab.folder / "slave" / "summary.json").read_text())
    assert summary["recorder"]["restarts"] == summary["commands"]["restarts"] == 1
    assert any(
        note.startswith("the command server ended unexpectedly") for note in summary["notes"]
    )
    assert summary["notes"][0].startswith("the recorder ended unexpectedly once")
    ticks = read_topics(lab.folder / "slave" / "recording.mcap", ["/slave"])["/slave"]["tick"]
    assert int(ticks[-1] - ticks[0]) + 1 - ticks.size == summary["missed_ticks"]


def test_a_fault_ends_a_slave_that_is_armed_at_once_with_exit_code_1(lab):
    lab.start("slave", "--arm")
    slave = lab.processes[-1]
    while slave.poll() is None and lab.state() < State.ARMED:
        time.sleep(0.01)
    lab.rig.kill()
    _, errors = lab.processes[-1].communicate()
    assert lab.processes[-1].returncode == 1
    assert "stopped: " in errors
    summary = json.loads((lab.folder / "slave" / "summary.json").read_text())
    assert summary["safety"]["state"] in {"FAULT", "SAFE_STOP"}
    assert summary["safety"]["fault"]["code"] != 0


def test_a_daemon_comes_back_disarmed_on_its_rig_killed_reloaded_or_ended_in_good_order(lab):
    killed = lab.start("slave")
    killed.kill()
    killed.communicate()
    second = lab.restart()
    before = lab.settled()
    assert (before["pid"], before["state"]) == (second.pid, "DISARMED")

    result = lab.heard_while("reload")
    longer, shorter = b"WATCHDOG_USEC=300000000", b"WATCHDOG_USEC=400000"
    assert [one.partition(b"\n")[0] for one in result] == [longer, b"RELOADING=1", shorter, READY]
    after = lab.settled()
    assert (after["pid"], after["state"]) == (second.pid, "DISARMED")
    assert after["ring_folder"] != before["ring_folder"]
    assert os.sched_getscheduler(lab.helper("recorder")) == os.SCHED_OTHER

    second.terminate()
    second.communicate()
    third = lab.restart()
    status = lab.settled()
    assert (status["pid"], status["state"]) == (third.pid, "DISARMED")


def test_a_reloaded_config_that_the_devices_refuse_leaves_the_one_before_running(tmp_path):
    rig, trial = tmp_path / "rig.yaml", tmp_path / "trial.yaml"
    rig.write_text((RIGS / "simulated_canopen.yaml").read_text())
    trial.write_text(SILICONE.read_text().replace("../rigs/simulated_canopen.yaml", "rig.yaml"))
    with Lab(tmp_path, RATE, trial=trial) as lab:
        daemon = lab.start("slave")
        lab.settled()
        good = rig.read_text()
        rig.write_text(good.replace("node_id: 0x10", "node_id: 0x11"))
        result = lab.heard_while("reload")
        assert not any(one.startswith(b"STOPPING") for one in result)
        status = lab.settled()
        assert (status["pid"], status["state"]) == (daemon.pid, "DISARMED")
        assert status["alarms"][0].startswith("the reloaded config was refused: no answer from")
        assert "correct the file and reload again" in status["alarms"][0]

        rig.write_text(good)
        assert lab.call("reload")[0] == 0
        assert lab.call("status")[0] == 0  # answered whenever it is asked: before, between, after
        while lab.settled()["alarms"]:
            assert daemon.poll() is None
            time.sleep(POLL_S)


def test_output_that_nobody_reads_ends_quietly_with_the_exit_code_of_the_work(tmp_path):
    command = (
        f"{sys.executable} -m teleop_rt check {SILICONE} --json | true; echo ${{PIPESTATUS[0]}}"
    )
    done = subprocess.run(
        ["/bin/bash", "-c", command], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert (done.stdout, done.stderr) == ("0\n", "")


def test_the_live_page_of_a_daemon_shows_its_state_its_force_and_a_fault_of_a_device(tmp_path):
    pytest.importorskip("bokeh")

    def attempt(folder):
        folder.mkdir()
        with Lab(folder, RATE) as lab:
            lab.start("slave")
            with lab.page() as address, headless_chromium() as browser:
                browser.get(address)
                return watch_a_fault(lab, browser)

    assert undisturbed(tmp_path, RATE_HZ, attempt) == "emergency"


def watch_a_fault(lab, browser) -> str | None:
    """Look at an idle daemon, an armed one and one that a device has stopped.

    Return the fault that stopped it; None where the machine stopped it before the device did.
    """
    until(browser, lambda: now_in("DISARMED") in text(browser, "chain"))
    assert "silicone_cube" in text(browser, "about")
    assert "no fault" in text(browser, "fault")
    before = text(browser, "values")
    until(browser, lambda: text(browser, "values") != before)
    until(browser, lambda: points(browser, "slave", "force") > 100)

    if lab.call("arm")[0] == 0:
        until(browser, lambda: re.search(STOPPED_OR_ARMED, text(browser, "chain")))
    with UnixBus(lab.channel) as bus:
        bus.send(over_temperature_of_the_force_sensor())
        until(browser, lambda: "fault: " in text(browser, "fault"))
    fault = lab.polled()["fault"]["name"]
    assert f"fault: {fault}" in text(browser, "fault")
    assert 'class="lamp bad"' in text(browser, "fault")
    assert 'class="now stop"' in text(browser, "chain")
    assert console_errors(browser) == []
    return None if fault in HELD_UP else fault


def now_in(state: str) -> str:
    """Return the mark of the present state in the chain of the live page."""
    return f'aria-current="true">{state}<'


def over_temperature_of_the_force_sensor() -> can.Message:
    """Return an emergency message (CiA 301) of the node 0x20, as the device would send it."""
    return can.Message(
        arbitration_id=EMERGENCY + 0x20,
        is_extended_id=False,
        data=struct.pack("<HB5x", 0x4200, 0x08),
    )
