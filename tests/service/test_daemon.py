"""Commands as they reach the loop: server, mailbox, daemon, slave and simulated rig."""

import itertools
import json
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from daemon_world import SILICONE, DaemonWorld, StepClock
from hypothesis import example, given
from hypothesis import strategies as st

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ring_folder import Recorder
from teleop_rt.service import commands, server
from teleop_rt.service.commands import lines
from teleop_rt.service.connections import LONGEST_REQUEST
from teleop_rt.service.mailbox import Command, CommandBox
from teleop_rt.service.server import CommandServer
from teleop_rt.slave.faults import DRIVE_SILENT, SAMPLES_LOST, State
from teleop_rt.trial.alone import Alone
from teleop_rt.trial.sides import slave_outcome


class Checked:
    """A check of a config that has found nothing wrong, or that goes on for ever."""

    def __init__(self, runs_s: float) -> None:
        self.running = runs_s > 0
        self.ended = False

    def end(self) -> None:
        self.ended = True

    def problem(self) -> str:
        return ""


@pytest.fixture
def world(tmp_path):
    return DaemonWorld(tmp_path)


@pytest.fixture
def ready(world):
    world.until(State.DISARMED)
    return world


def test_nothing_moves_until_armed_and_nothing_follows_until_started(ready):
    assert ready.ticks(300) is State.DISARMED
    refused = ready.ask("start")
    assert (refused["ok"], refused["problem"]) == (
        False,
        "the axis is not armed: `teleop-rt arm` first",
    )
    assert ready.ask("arm")["status"]["state"] == "ARMED"
    assert ready.ticks(300) is State.ARMED
    assert ready.rig.drive.enabled
    assert ready.slave.limiter.position == pytest.approx(0.0, abs=1e-5)
    assert "armed already" in ready.ask("arm")["problem"]
    assert ready.ask("start")["ok"]
    assert ready.ticks(300) is State.RUN
    assert ready.slave.limiter.position > 0.001


def test_a_command_is_answered_once_a_tick_shows_what_it_did(ready, monkeypatch):
    clock = SimpleNamespace(monotonic=lambda: 0.0, sleep=lambda _: ready.ticks(1))
    monkeypatch.setattr("teleop_rt.service.server.time", clock)
    assert ready.server.answer(b'{"command": "arm"}')["status"]["state"] == "ARMED"
    assert ready.server.answer(b'{"command": "stop"}')["status"]["state"] == "DISARMED"


def test_a_loop_that_hung_does_not_move_at_what_was_reported_as_unanswered_but_stops(
    ready, monkeypatch
):
    def unanswered(command: str) -> None:
        waited = itertools.count(0.0, 6.0)
        hung = SimpleNamespace(monotonic=lambda: next(waited), sleep=lambda _: None)
        with monkeypatch.context() as patch:
            patch.setattr("teleop_rt.service.server.time", hung)
            answer = ready.server.answer(json.dumps({"command": command}).encode())
        assert "the loop does not answer" in answer["problem"]

    unanswered("arm")
    assert ready.ticks(300) is State.DISARMED
    assert ready.ask("arm")["ok"]
    assert ready.ticks(300) is State.ARMED
    unanswered("stop")
    assert ready.ticks(1) is State.DISARMED


def test_the_status_reports_how_the_link_goes_and_how_often_it_was_followed(ready):
    ready.ask("arm")
    ready.ask("start")
    ready.until(State.RUN)
    ready.ticks(100)
    link = ready.ask("status")["status"]["link"]
    assert (link["trouble"], link["packets_lost"], link["packets_rejected"]) == (None, 0, 0)
    assert link["packets_received"] > 50
    assert link["silence_ms"] < 5
    assert (link["followings"], link["holds"]) == (1, 0)
    ready.trial.master.cycle = lambda: None
    ready.until(State.HOLD)
    status = ready.ask("status")["status"]
    assert status["link"]["silence_ms"] >= 100  # ticks go on while the answer is on its way
    assert (status["link"]["followings"], status["link"]["holds"]) == (1, 1)
    result = {
        "pid": 1,
        "folder": "runs",
        "privileges": [],
        "units": {"position": "m", "force": "N"},
    }
    printed = list(lines(status | result))
    packets = next(line for line in printed if line.startswith("packets: "))
    assert packets.endswith(" lost, 0 refused")
    assert "axis: followed the master 1 times, held 1 times without fresh motion" in printed
    for silence_ms, shown in ((-0.00059, "0 ms"), (0.994718, "0.995 ms"), (None, "unknown")):
        status["link"]["silence_ms"] = silence_ms
        assert f"link: last packet {shown} ago" in list(lines(status | result))


def test_stop_takes_the_power_away_and_needs_arming_and_starting_again(ready):
    ready.ask("arm")
    ready.ask("start")
    assert ready.ticks(200) is State.RUN
    assert ready.ask("stop")["status"]["state"] == "DISARMED"
    assert ready.ticks(200) is State.DISARMED
    assert not ready.rig.drive.powered
    assert ready.ask("arm")["ok"]
    assert ready.ticks(200) is State.ARMED


def test_arming_before_a_first_sample_says_so(world):
    world.rig.inject("mute", "encoder")
    assert "no valid sample" in world.ask("arm")["problem"]


def test_a_fault_stays_until_it_is_reset_and_a_reset_restarts_nothing(ready):
    ready.ask("arm")
    ready.ask("start")
    ready.until(State.RUN)
    ready.rig.inject("emergency", "drive")
    ready.until(State.FAULT)
    status = ready.ask("status")["status"]
    assert (status["state"], status["fault"]["name"]) == ("FAULT", "emergency")
    for command in ("arm", "start"):
        problem = ready.ask(command)["problem"]
        assert "a fault is latched" in problem
        assert "emergency: a device sent an emergency" in problem
    assert ready.ask("reset")["status"]["state"] == "DISARMED"
    assert ready.ticks(500) is State.DISARMED
    assert not ready.rig.drive.powered
    assert ready.ask("reset")["problem"] == "there is no fault to reset"
    assert ready.ask("arm")["ok"]
    assert ready.ticks(300) is State.ARMED


def result_of(status):
    result = {
        "pid": 1,
        "folder": "runs",
        "privileges": [],
        "units": {"position": "m", "force": "N"},
    }
    return list(lines(status | result))


def test_a_device_that_complains_while_nothing_is_armed_is_reported_and_can_be_reset(ready):
    assert ready.ask("status")["status"]["last_fault"] is None
    ready.rig.inject("emergency", "drive")
    assert ready.ticks(5) is State.DISARMED
    status = ready.ask("status")["status"]
    assert (status["state"], status["fault"]["name"]) == ("DISARMED", "emergency")
    said = "drive: emergency 5000h, device hardware"
    assert status["last_fault"]["said"].startswith(said)
    fault, last = (line for line in result_of(status) if "fault: " in line)
    assert "a device sent an emergency" in fault
    assert "then reset and arm" in fault
    assert f"s ago; {said}" in last
    assert ready.ask("reset")["ok"]
    after = ready.ask("status")["status"]
    assert after["fault"]["code"] == 0
    assert after["last_fault"]["said"].startswith(said)
    assert ready.ask("arm")["ok"]


def test_a_device_that_complains_before_a_first_sample_can_be_reset(world):
    world.rig.inject("mute", "encoder")
    world.ticks(2)
    world.rig.inject("emergency", "drive")
    assert world.ticks(5) is State.SELFTEST
    assert world.ask("status")["status"]["fault"]["name"] == "emergency"
    assert world.ask("reset")["problem"] != "there is no fault to reset"


def test_a_complaint_is_not_reported_again_with_a_later_fault(ready):
    ready.rig.inject("emergency", "drive")
    ready.ticks(5)
    assert ready.ask("reset")["ok"]
    assert ready.ask("arm")["ok"]
    ready.rig.inject("mute_pdo", "encoder")  # its heartbeat goes on: one fault at any phase
    ready.until(State.FAULT)
    last = ready.ask("status")["status"]["last_fault"]
    assert (last["fault"], last["said"]) == ("samples_lost", "encoder: no new value")


def test_after_a_reset_the_wall_is_met_as_one_that_nobody_knew(ready):
    ready.ask("arm")
    ready.ask("start")
    ready.until(State.RUN)
    guard, slave = ready.slave.guard, ready.slave
    while not slave.contact.in_contact or guard.waiting_for:
        ready.ticks(1)
    ready.rig.inject("emergency", "drive")
    ready.until(State.FAULT)
    known = slave.contact.surface
    assert ready.ask("reset")["ok"]
    once_more = slave.contact.contact_id + 1
    guard.update(
        target=known, command=known, position=known, force=0.5, contact_id=once_more,
        acknowledged=once_more - 1, surface=known, depth_cap=0.01,
    )  # fmt: skip
    assert guard.waiting_for == once_more


def test_devices_that_do_not_answer_leave_the_fault_latched_and_are_named(ready):
    ready.ask("arm")
    ready.until(State.ARMED)
    ready.rig.inject("mute", "drive")
    ready.until(State.FAULT)
    answer = ready.ask("reset")
    assert not answer["ok"]
    assert "drive" in answer["problem"]
    assert ready.ticks(10) is State.FAULT


def test_a_device_that_was_lost_while_disarmed_is_named_and_back_after_a_reset(ready):
    ready.rig.inject("mute", "drive")
    ready.ticks(200)
    ready.rig.heal("drive")
    assert ready.ticks(200) is State.DISARMED
    problem = ready.ask("arm")["problem"]
    assert problem == (
        "cannot arm: device_lost: a device's heartbeat ended; "
        "check its power and wiring, then reset and arm"
    )
    assert ready.ask("reset")["ok"]
    assert ready.ticks(200) is State.DISARMED
    assert ready.ask("arm")["ok"]
    assert ready.ticks(200) is State.ARMED


def test_a_device_that_was_lost_while_disarmed_is_the_fault_of_the_end(ready):
    outcome = partial(slave_outcome, ready.slave, ready.trial.slave_endpoint, simulated=False)
    ended = lambda: outcome()["safety"]  # noqa: E731
    ready.rig.inject("mute", "drive")
    ready.ticks(200)
    ready.rig.heal("drive")
    assert ready.ticks(200) is State.DISARMED
    assert (ended()["state"], ended()["fault"]["name"]) == ("DISARMED", "device_lost")
    ready.ask("reset")
    assert ready.ticks(200) is State.DISARMED
    assert ended()["fault"]["code"] == 0


def test_a_device_that_was_lost_is_named_where_the_drive_was_missed_first(ready):
    """Of a rig that is gone at once, the drive's silence is noted before a heartbeat is due."""
    assert ready.ask("arm")["ok"]
    ready.until(State.ARMED)
    ready.rig.inject("mute", "force sensor")
    ready.slave.safety.stop(DRIVE_SILENT)
    ready.ticks(200)
    fault = slave_outcome(ready.slave, ready.trial.slave_endpoint, simulated=False)["safety"][
        "fault"
    ]
    assert fault["name"] == "drive_silent"
    assert fault["said"] == "force sensor (0x20): its heartbeat ended"
    assert "drive" not in fault["cause"] + fault["next_step"]


def test_lost_samples_are_stated_with_the_bound_in_force(ready):
    ready.slave.record.tick.stop_missing = 50
    assert ready.ask("arm")["ok"]
    ready.until(State.ARMED)
    ready.slave.safety.stop(SAMPLES_LOST)
    outcome = partial(slave_outcome, ready.slave, ready.trial.slave_endpoint, simulated=False)
    fault = outcome()["safety"]["fault"]
    assert fault["cause"] == "no usable sample of position and force for 50 ms"
    assert "simulated" not in fault["next_step"]
    on_simulated_rig = outcome(simulated=True)["safety"]["fault"]["next_step"]
    assert on_simulated_rig.startswith("leave the simulated rig, which lacked a processor, a core")


def test_a_config_is_reloaded_only_at_rest_and_an_invalid_one_changes_nothing(ready, monkeypatch):
    answer = ready.ask("reload")
    assert not answer["ok"]
    assert "the running config stays" in answer["problem"]
    assert "t.yaml: no such file" in answer["problem"]
    assert ready.ticks(10) is State.DISARMED
    monkeypatch.setattr(server, "ConfigCheck", lambda _: Checked(0.0))
    ready.ask("arm")
    assert ready.ask("reload")["problem"] == "the axis is armed: `teleop-rt stop` first"
    ready.ask("stop")
    assert ready.ask("reload")["ok"]
    assert ready.daemon.run(lambda: StepClock(ready), lambda: False)


@pytest.mark.parametrize(
    "request_line",
    [
        b"", b"stop", b"[]", b'{"command": 5}', b'{"command": "none"}', b"\xff\xfe",
        b'{"command": "status", "command": "arm"}', '{"command": "arm"}'.encode("utf-16"),
        b'{"x": {"y": 1, "y": 2}, "command": "arm"}',
    ],
)  # fmt: skip
def test_a_request_that_makes_no_sense_gets_a_sentence_and_changes_nothing(ready, request_line):
    answer = ready.server.answer(request_line)
    assert not answer["ok"]
    assert "command" in answer["problem"]
    assert ready.ticks(5) is State.DISARMED


WORDS = st.none() | st.booleans() | st.integers() | st.text(max_size=8)
REQUESTS = st.recursive(WORDS, lambda one: st.lists(one) | st.dictionaries(st.text(), one))


@given(
    st.binary(max_size=100)
    | REQUESTS.map(lambda request: json.dumps(request).encode())
    | REQUESTS.map(lambda command: json.dumps({"command": command}).encode())
)
@example(b"[" * LONGEST_REQUEST)
def test_any_request_is_refused_in_a_sentence_or_known(request_line):
    answer = CommandServer(Path("/no/rings")).answer(request_line)
    assert not answer["ok"]
    assert isinstance(answer["problem"], str)


@pytest.mark.parametrize(
    "request_line", [b'{"command": "status", "command": "arm"}', b'{"command": "arm\xff"}']
)
def test_a_request_that_could_mean_two_commands_or_is_no_text_is_none(tmp_path, request_line):
    """Of the first one the second command was carried out."""
    box = CommandBox(tmp_path, create=True)
    answer = CommandServer(tmp_path).answer(request_line)
    assert not answer["ok"]
    assert "again" not in answer, "a command that is known waits for a loop to be described"
    assert box.poll() == Command.NONE


def test_a_server_without_a_loop_says_that_the_daemon_is_starting(tmp_path):
    asked = CommandServer(tmp_path)
    for command in ("status", "arm", "reload"):
        answer = asked.answer(f'{{"command": "{command}"}}'.encode())
        assert "the daemon is starting" in answer["problem"]
        assert answer["again"]
    CommandBox(tmp_path, create=True)  # and of a loop that is not described yet
    assert asked.answer(b'{"command": "arm"}')["again"]


def test_status_reports_state_sample_and_times(ready):
    ready.ticks(2000)
    status = ready.ask("status")["status"]
    assert status["state"] == "DISARMED"
    assert status["tick"] >= 2000
    assert abs(status["force"]) < 0.5
    assert status["surface"] is None
    assert status["timing_us"]["wake_latency"]["p50"] == 21.0
    assert status["timing_us"]["work"]["p50"] > 0


def test_a_safeguard_that_the_rig_goes_without_is_the_red_line_of_the_status(
    ready, monkeypatch, capsys
):
    trial = load_trial_file(SILICONE, ["rig=../rigs/simulated_serial.yaml"])
    (missing,) = trial.rig.unsafe
    alone = Alone(
        "slave", trial.name, SILICONE, [], ready.ring_folder, ready.ring_folder, None, None
    )
    alone.describe(trial, [], "")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.delenv("NO_COLOR", raising=False)
    commands.print_answer(ready.ask("status"), as_json=False)
    coloured = [line for line in capsys.readouterr().out.splitlines() if "\x1b" in line]
    assert coloured == [f"\x1b[1;31munsafe: {missing}\x1b[0m"]


def test_alarms_of_the_disk_and_of_rows_that_were_dropped_reach_the_status(ready, monkeypatch):
    status = ready.ask("status")["status"]
    assert (status["alarms"], status["recorder"]["dropped"]) == ([], {})
    monkeypatch.setattr("teleop_rt.realtime.ring_folder.MOST_WAITING_BYTES", 1000)
    full = ready.ring_folder / "full.mcap"
    full.symlink_to("/dev/full")
    recorder = Recorder(ready.ring_folder, RecordingWriter(full, ready.trial.trial.rig.units))
    for _ in range(3):
        recorder.discover()
        recorder.drain()
        recorder.flush()
        recorder.publish_state()
        ready.ticks(100)
    status = ready.ask("status")["status"]
    lost = sum(status["recorder"]["dropped"].values())
    assert lost >= 100
    rows, disk = status["alarms"]
    assert rows == f"{lost} rows were not recorded: figures are of the rest"
    assert "the disk refuses the recording (No space left on device): make room" in disk
    later = status["recorder"]["stamp_ns"] + 9 * 10**9
    monkeypatch.setattr("time.monotonic_ns", lambda: later)
    silent = ready.ask("status")["status"]["alarms"][0]
    assert "the recorder has been silent for 9 s" in silent


def test_a_driver_that_raises_is_a_fault_that_can_be_reset(ready, monkeypatch):
    ready.ask("arm")
    ready.ask("start")
    ready.until(State.RUN)

    def broken(_sample):
        raise ZeroDivisionError("on purpose")

    with monkeypatch.context() as patched:
        patched.setattr(ready.trial.bench.axis, "read_into", broken)
        ready.until(State.FAULT)
        last = ready.ask("status")["status"]["last_fault"]
        assert (last["fault"], last["said"]) == ("driver", "ZeroDivisionError: on purpose")
        assert "in broken" in last["traceback"]
    assert not ready.rig.drive.enabled


def test_an_error_in_the_cycle_stops_the_axis_and_is_raised_again(ready, monkeypatch):
    ready.ask("arm")
    ready.ask("start")
    ready.until(State.RUN)

    def broken():
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr(ready.slave._endpoint, "poll", broken)
    with pytest.raises(ZeroDivisionError, match="on purpose"):
        ready.daemon.run(lambda: StepClock(ready), lambda: False)
    assert ready.slave.safety.fault.name == "internal"
    assert not ready.rig.drive.enabled
