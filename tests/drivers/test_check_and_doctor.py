from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import can
import pytest
import yaml
from framed_bench import MS, RIGS, FramedBench, edited, load

from teleop_rt.cli import main
from teleop_rt.config.link import LinkConfig
from teleop_rt.config.loader import load_rig, load_trial
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt.realtime.rig_locks import devices_held
from teleop_rt_drivers import link_check, registry
from teleop_rt_drivers.check import check_link, check_rig
from teleop_rt_drivers.doctor import examine_axis, frame_names
from teleop_rt_drivers.examination import between_processes, simulation_first
from teleop_rt_drivers.findings import Finding, worst
from teleop_rt_drivers.observed_bus import ObservedBus
from teleop_rt_drivers.rig_text import rig_text
from teleop_rt_drivers.simulated.synchronous_bus import as_sent

EVERY_KIND = ("canopen", "serial", "raw_can", "mixed", "unreferenced")


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_every_shipped_rig_passes(kind):
    rig = load(kind)
    findings = check_rig(rig)
    dangers = [finding for finding in findings if finding.severity == "danger"]
    assert len(dangers) == len(rig.unsafe_i_know)
    assert worst([one for one in findings if one not in dangers]) in ("ok", "warning")
    assert any("is used at 1000 Hz" in finding.what for finding in findings)


@pytest.mark.parametrize(
    ("kind", "change", "said"),
    [
        ("canopen", ("eds: drive_cia402.eds", "eds: none.eds"), "EDS file 'none.eds'"),
        (
            "canopen",
            (
                'objects: ["0x6004", "0x6030:1", "0x6503"]',
                'objects: ["0x6004", "0x6004", "0x6503"]',
            ),
            "10 bytes are mapped, a frame holds 8",
        ),
        ("canopen", ("rate_hz: 1000", "rate_hz: 3001"), "cannot be set in the drive"),
        ("serial", ("baud: 460800", "baud: 115200"), "321 % of 115200 bit/s"),
        ("raw_can", ("bitrate: 1000000", "bitrate: 250000"), "216 % of 250000 bit/s"),
        ("serial", ("field: count", "field: edges"), "no field 'edges'"),
        ("canopen", ("scale_m_per_count: 1.0e-6", "scale_m_per_count: 1.0e-11"), "32 bits"),
        ("unreferenced", ("zero: unknown", "zero: encoder"), "axis.drive.zero: write unknown"),
        ("unreferenced", ("bit: 2 ", "entry: '0x6041'\n      bit: 2 "), "not carry 0x6041"),
    ],
)
def test_what_cannot_work_is_an_error_with_place_and_next_step(kind, change, said, tmp_path):
    errors = [f for f in check_rig(edited(kind, tmp_path, change)) if f.severity == "error"]
    assert any(said in error.what for error in errors)
    assert all(error.where and error.next_step for error in errors)


def test_the_links_key_is_checked(tmp_path):
    assert worst(check_link(LinkConfig())) == "ok"
    missing = check_link(LinkConfig(key_file=str(tmp_path / "none")))
    assert worst(missing) == "error"
    assert str(missing[0]).count("keygen") == 1
    assert worst(check_link(LinkConfig(bind_host="192.0.2.1"))) == "warning"


def examined(kind: str, fault: str | None = None, device: str = "force sensor", *, late=True):
    """Doctor's findings in lock-step, with a fault from before or during the examination."""
    bench = FramedBench(load(kind))
    cycles = 0

    def wait():
        nonlocal cycles
        bench.now += MS
        cycles += 1
        if fault is not None and late and cycles == 150:
            bench.simulated.inject(fault, device)

    if fault is not None and not late:
        bench.simulated.inject(fault, device)
    return examine_axis(bench.axis, wait, 400), bench


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_a_sound_rig_has_no_findings_but_good_ones(kind):
    findings, bench = examined(kind)
    assert [str(f) for f in findings if f.severity != "ok"] == []
    assert any("a sample every 1000.0 us" in finding.what for finding in findings)
    assert not bench.simulated.drive.powered


CANOPEN_FAULTS = (
    "mute", "freeze", "wrong_length", "corrupt", "duplicate", "delay", "reset", "emergency",
    "bus_off", "no_acknowledge", "unplug",
)  # fmt: skip
SERIAL_FAULTS = (
    "mute", "freeze", "wrong_length", "corrupt", "duplicate", "delay", "garbage", "unplug",
    "reset",
)  # fmt: skip
RAW_CAN_FAULTS = (
    "mute", "freeze", "wrong_length", "corrupt", "duplicate", "delay", "garbage", "bus_off",
    "no_acknowledge", "unplug", "reset",
)  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "fault"),
    [("canopen", fault) for fault in CANOPEN_FAULTS]
    + [("serial", fault) for fault in SERIAL_FAULTS]
    + [("raw_can", fault) for fault in RAW_CAN_FAULTS],
)
def test_doctor_finds_each_injected_fault(kind, fault):
    findings, _ = examined(kind, fault, "force sensor" if fault == "freeze" else "encoder")
    bad = [finding for finding in findings if finding.severity != "ok"]
    assert bad
    assert all(finding.next_step for finding in bad)


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_doctor_moves_nothing(kind):
    """For the whole examination the drive is without power, and the tool where it was."""
    bench = FramedBench(load(kind))
    plant, powered, places = bench.simulated.plant, [], []

    def wait():
        bench.now += MS
        powered.append(bench.simulated.drive.powered)
        places.append(plant.position)

    findings = examine_axis(bench.axis, wait, 400)
    assert worst(findings) != "error"
    assert len(powered) > 400
    assert not any(powered)
    assert max(places) == min(places)


def test_doctor_names_the_device_that_does_not_answer():
    findings, _ = examined("canopen", "mute", "drive", late=False)
    assert [finding.severity for finding in findings] == ["error"]
    assert "node 0x30 (drive)" in findings[0].what


def test_doctor_reports_an_emergency_in_words():
    findings, _ = examined("canopen", "emergency", "encoder")
    said = "encoder: emergency 5000h, device hardware; error register: generic, communication"
    assert any(said in finding.what for finding in findings)


def test_a_sync_with_counter_is_configured_and_counts(tmp_path):
    rig = edited(
        "canopen",
        tmp_path,
        ("    node_id: 127\n", "    node_id: 127\n    sync_counter: 3\n"),
    )
    bench = FramedBench(rig)
    heard = []
    device_end = bench.ends.bus_pair("")[1]
    deliver = device_end.deliver

    def tap(message) -> None:
        can_id, data = as_sent(message)
        if can_id == 0x80:
            heard.append(data)
        deliver(message)

    device_end.deliver = tap
    bench.armed()
    assert heard[:5] == [b"\1", b"\2", b"\3", b"\1", b"\2"]
    assert bench.simulated.devices["drive"].value(0x1019) == 3
    assert bench.cycles(5).valid


@pytest.fixture
def call(monkeypatch, capsys):
    def calling(*arguments):
        monkeypatch.setattr(sys, "argv", ["teleop-rt", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return end.value.code or 0, captured.out

    return calling


TRIAL = Path(RIGS).parent / "trials" / "silicone_cube.yaml"


@pytest.mark.parametrize(
    ("given", "answer"),
    [("odrve", "did you mean 'odrive'?"), ("steam_engine", "one of: canopen, canopen_device, ser")],
)
def test_an_unknown_driver_of_a_part_is_answered_with_those_there_are(given, answer, tmp_path):
    rig = tmp_path / "rig.yaml"
    text = (RIGS / "simulated_odrive.yaml").read_text()
    rig.write_text(text.replace("      driver: odrive\n", f"      driver: {given}\n"))
    with pytest.raises(ConfigError, match=rf"driver: there is no '{given}'; {re.escape(answer)}"):
        load_rig(rig, registry.AXIS_SCHEMAS)


def test_check_prints_one_json_object_and_fails_on_an_error(call):
    code, out = call("check", TRIAL, "--json")
    answer = json.loads(out)
    assert code == 0
    assert answer["worst"] == "ok", "a finding without action is no warning"
    assert {"severity", "what", "where", "next_step"} == set(answer["findings"][0])
    code, out = call("check", TRIAL, "--set", "rig.axis.bus.bitrate=500000", "--json")
    assert code == 2
    assert json.loads(out)["worst"] == "error"
    code, out = call("check", RIGS / "simulated_serial.yaml")
    assert code == 0
    assert "% of 460800 bit/s is used at 1000 Hz" in out


OPENED = """
import sys
from teleop_rt.cli import main
opened = []
def note(event, arguments):
    if event == "open" and str(arguments[0]).startswith("/dev/ttyUSB"):
        opened.append(arguments[0])
sys.addaudithook(note)
try:
    main()
except SystemExit:
    print(len(opened), file=sys.stderr)
"""


@pytest.mark.parametrize(("command", "opens"), [("check", False), ("doctor", True)])
def test_check_opens_no_port_of_a_rig_and_doctor_does(tmp_path, command, opens):
    (tmp_path / "rig.yaml").write_text(rig_text("dynamixel", "serial", "wrench", None))
    done = subprocess.run(
        [sys.executable, "-c", OPENED, command, "rig.yaml"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert (int(done.stderr.split()[-1]) > 0) is opens


def on_hardware(tmp_path, **link):
    """The default trial without `plant`, on an adapter, with these keys of `link`."""
    trial = yaml.safe_load(TRIAL.read_text())
    del trial["plant"]
    network = {"round_trip_ms", "jitter_ms", "loss"}
    trial["link"] = {k: v for k, v in trial["link"].items() if k not in network} | link
    rig = (RIGS / "simulated_canopen.yaml").read_text()
    rig = re.sub(r"interface: \w+", "interface: socketcan", rig)
    (tmp_path / "rig.yaml").write_text(re.sub(r"channel: \S+", "channel: can0", rig))
    (tmp_path / "trial.yaml").write_text(yaml.safe_dump(trial | {"rig": "rig.yaml"}))
    return tmp_path / "trial.yaml"


@pytest.mark.parametrize(
    ("change", "key", "said"),
    [
        ("link.jitter_ms=151", "link.jitter_ms", "wider than link.round_trip_ms 150"),
        ("link.blackouts_s=[[1, 2], [20, 21]]", "link.blackouts_s", "from 20 s begins after"),
        (
            "operator.approach_speed_m_per_s=5",
            "operator.approach_speed_m_per_s",
            "with 5 m/s, and limits.velocity_max lets it move with 1.5 m/s: ",
        ),
        ("operator.frequency_hz=40", "operator.frequency_hz", "with 2.01 m/s"),
    ],
)
def test_values_that_a_run_would_not_carry_out_as_written_are_reported(call, change, key, said):
    findings = json.loads(call("check", TRIAL, "--json", "--set", change)[1])["findings"]
    assert [one for one in findings if one["where"] == key and said in one["what"]]


def test_a_simulated_network_is_reported_where_no_plant_is_simulated(call, tmp_path):
    def said(trial):
        findings = json.loads(call("check", trial, "--json")[1])["findings"]
        return [one for one in findings if "poor network" in one["what"]]

    assert said(TRIAL) == [], "the plant is simulated as well"
    assert said(on_hardware(tmp_path)) == []
    (found,) = said(on_hardware(tmp_path, round_trip_ms=150, loss=0.01))
    assert found["severity"] == "warning"
    assert found["what"].endswith(": round_trip_ms, loss")
    assert found["where"] == "link.round_trip_ms"


def test_timing_is_reported_for_each_frame_with_its_delay_after_sync():
    rig = load("canopen")
    bench = FramedBench(rig)
    clock = [0.0]
    bus = ObservedBus(bench.ends.bus_pair("")[0], 0x80, lambda: clock[0])
    sync = can.Message(arbitration_id=0x80, is_extended_id=False)
    bus.send(sync)
    while bus.recv(0) is not None:
        pass
    bus.forget()
    for k in range(100):
        clock[0] = k * 1e-3
        bus.send(sync)
        for can_id, delay in ((0x290, 200e-6), (0x1A0, 900e-6 if k % 2 else 100e-6)):
            clock[0] = k * 1e-3 + delay
            bench.ends.bus_pair("")[0].deliver(can.Message(arbitration_id=can_id))
            bus.recv(0)
    names = frame_names(rig.axis)
    assert names == {
        0x290: "TPDO2 of the encoder",
        0x1A0: "TPDO1 of the force sensor",
        0x1B0: "TPDO1 of the drive",
    }
    good, late, absent = bus.timing(names, 1e-3)
    assert good.severity == "ok"
    assert "every 1000.0 us, within 0.0 us (p99), 200 us (p50), 200 us (p99)" in good.what
    assert late.severity == "warning"
    assert absent.severity == "error"
    assert "was received 0 times" in absent.what


def test_the_share_of_bad_frames_is_reported_for_each_part():
    findings, _ = examined("serial")
    assert any("0 % of" in f.what and f.where == "frames" for f in findings)
    findings, _ = examined("serial", "corrupt", "force sensor")
    (found,) = (f for f in findings if f.where == "frames")
    assert found.severity == "warning"


def trial_with(**link):
    from_file = load_trial(TRIAL, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS)
    return from_file.model_copy(update={"link": from_file.link.model_copy(update=link)})


def test_round_trip_and_loss_of_the_link_are_measured(monkeypatch):
    now = [10**12]
    monkeypatch.setattr(link_check.time, "monotonic_ns", lambda: now[0])

    def wait():
        now[0] += MS

    trial = trial_with(round_trip_ms=20.0, jitter_ms=0.0, loss=0.3)
    (found,) = link_check.examine_link(trial, wait, 2.0)
    assert found.severity == "warning"
    trip, share = re.match(r"round trip ([\d.]+) ms.*; ([\d.]+) % of", found.what).groups()
    assert 20 <= float(trip) <= 24
    assert 25 <= float(share) <= 35
    trial = trial_with(slave_port=9, round_trip_ms=0.0, jitter_ms=0.0, loss=0.0)
    (found,) = link_check.examine_link(trial, wait, 3.0)
    assert found.severity == "error"
    assert "127.0.0.1:9" in found.where


def test_a_simulated_rig_that_does_not_answer_is_named_as_the_first_cause():
    absent = Finding("error", "no answer from the drive", "devices", "follow this message")
    late = Finding("error", "no answer came back", "link to 127.0.0.1")
    first, *rest = simulation_first([late, absent], "teleop-rt sim cube.yaml")
    assert "start it first: teleop-rt sim cube.yaml" in str(first)
    assert rest == [late, absent]
    assert simulation_first([late], "") == [late], "the link alone has other causes"


def test_no_finding_on_a_shipped_trial_gives_a_key_a_number_without_a_unit(call):
    """Keys that end in a unit of time, and shares, carry their own."""
    for config in ("silicone_cube", "serial_handle", "simulated_load_cell"):
        for one in json.loads(call("check", config, "--json")[1])["findings"]:
            said = f"{one['what']}; {one['next_step']}"
            bare = re.findall(
                r"(?:force_cap|force_max|velocity_max|hold|lag) [\d.]+(?! ?[a-zA-Z\d.])", said
            )
            assert not bare, said
            assert "below velocity_max" not in said


def test_nodes_that_do_not_answer_are_one_error_and_the_axis_refers_to_it(call):
    code, out = call("doctor", TRIAL, "--cycles", 20, "--json")
    findings = json.loads(out)["findings"]
    assert code == 1
    wrong = [one for one in findings if one["severity"] == "error"]
    assert [one["where"] for one in wrong] == ["bus", "devices"]
    assert wrong[0]["what"] == (
        "node 0x10 (encoder), node 0x20 (force sensor) and node 0x30 (drive) do not answer"
    )
    assert [one["next_step"].count("termination") for one in wrong] == [1, 0]


def test_a_rig_on_a_bus_between_processes_is_a_simulated_one(tmp_path):
    assert between_processes(load("odrive"))
    assert not between_processes(
        edited("odrive", tmp_path, ("interface: unix", "interface: socketcan"))
    )


def bus_work(tmp_path):
    """Each command that uses the buses of a rig by itself, on files of its own."""
    rig = tmp_path / "rig.yaml"
    rig.write_text((RIGS / "simulated_canopen.yaml").read_text())
    for eds in RIGS.glob("*.eds"):
        (tmp_path / eds.name).write_bytes(eds.read_bytes())
    handle = tmp_path / "handle.yaml"
    handle.write_text((RIGS / "simulated_handle.yaml").read_text())
    odrive = tmp_path / "odrive.yaml"
    odrive.write_text(rig_text("odrive", "socketcan", "drive", None))
    drive = ["--drive", "odrive", "--adapter", "socketcan", "--sensor", "drive"]
    return {
        "doctor": (rig, ["doctor", rig]),
        "scan": (odrive, ["new-rig", tmp_path / "new.yaml", *drive, "--scan"]),
        "force": (rig, ["calibrate", "force", rig, "--weights", "0,1"]),
        "device": (handle, ["calibrate", "device", handle, "--force", "1", "--reach", "0.002"]),
    }


@pytest.mark.parametrize("work", ["doctor", "scan", "force", "device"])
def test_work_on_the_devices_of_a_rig_that_runs_is_refused_before_a_frame_is_sent(
    tmp_path, monkeypatch, capsys, work
):
    """A second master on the buses of a running axis would stop it."""
    monkeypatch.setenv("TELEOP_RT_RUN_DIR", str(tmp_path / "run"))
    monkeypatch.setattr("can.BusABC.__init__", lambda *_, **__: pytest.fail("a bus was opened"))
    file, words = bus_work(tmp_path)[work]
    held = devices_held(registry.reached_by(load_rig(file, registry.AXIS_SCHEMAS)))
    monkeypatch.setattr(sys, "argv", ["teleop-rt", *map(str, words)])
    with held, pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "in use by process" in capsys.readouterr().err
