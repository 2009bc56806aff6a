"""`check` compares the stall that stops the axis with the drive's own watchdog."""

import contextlib
import json
import re
import sys
from pathlib import Path

import pytest
from framed_bench import RIGS, edited, load

from teleop_rt.cli import main
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.simulated.servo import WATCHDOG_NS

SHIPPED = sorted(
    path for path in Path(RIGS).glob("simulated_*.yaml") if path.stem != "simulated_feetech"
)
"""All but one, whose servo watches nobody and whose rig says so."""
STALL = re.compile(r"a stall stops the axis after (\d+) ms, before the drive's (\d+) ms")
WIDE = "late: {hold_ms: 5, stop_ms: 50, stop_share: 1}"


def of_stalls(findings):
    (found,) = (f for f in findings if "stop_ms" in f.what or "stall" in f.what)
    return found


@pytest.mark.parametrize("kind", [path.stem.removeprefix("simulated_") for path in SHIPPED])
def test_the_shipped_rigs_stop_before_their_drives_do(kind):
    found = of_stalls(check_rig(load(kind)))
    assert found.severity == "ok"
    stop_ms, watchdog_ms = STALL.fullmatch(found.what).groups()
    assert int(stop_ms) < int(watchdog_ms) <= 60


@pytest.mark.parametrize(
    ("kind", "key"),
    [
        ("canopen", "axis.drive.daemon_timeout_ms"),
        ("handle", "axis.drive.daemon_timeout_ms"),
        ("mixed", "axis.parts.bus.drive.daemon_timeout_ms"),
        ("serial", "axis.drive.watchdog_ms"),
        ("raw_can", "axis.drive.watchdog_ms"),
        ("serial_handle", "axis.drive.watchdog_ms"),
    ],
)
def test_a_bound_above_the_drives_watchdog_is_refused_with_both_named(kind, key, tmp_path):
    rig = edited(kind, tmp_path, (WIDE, "late: {stop_ms: 61}"))
    found = of_stalls(check_rig(rig))
    assert (found.severity, found.where) == ("error", key)
    assert "realtime.late.stop_ms 61" in found.what
    assert f"{key.rpartition('.')[2]} 60" in found.what
    at_it = edited(kind, tmp_path, (WIDE, "late: {stop_ms: 60}"))
    assert of_stalls(check_rig(at_it)).severity != "error"


def test_a_heartbeat_that_may_have_been_due_counts_as_silence(tmp_path):
    rig = edited("canopen", tmp_path, ("heartbeat_ms: 10 ", "heartbeat_ms: 11 "))
    found = of_stalls(check_rig(rig))
    assert found.severity == "warning"
    assert "11 ms between two heartbeats" in found.what


def known(word: str) -> tuple[str, str]:
    """Changes to a rig that removes a protection."""
    return "rate_hz: 1000", f"rate_hz: 1000\nunsafe_i_know: [{word}]"


def test_a_drive_that_ignores_silence_is_refused(tmp_path):
    rig = edited("canopen", tmp_path, ('"0x6007": 3', '"0x6007": 0'), known("connection_loss"))
    found = of_stalls(check_rig(rig))
    assert (found.severity, found.where) == ("error", "axis.drive.setup")


def test_a_drive_whose_setup_says_nothing_is_taken_by_its_eds(tmp_path):
    rig = edited("canopen", tmp_path, ('"0x6007": 3', '"0x6086": 0'), known("connection_loss"))
    assert of_stalls(check_rig(rig)).severity == "ok"  # there 6007h is 1, a fault


def test_a_watchdog_that_is_not_known_is_reported(tmp_path):
    words = ("unsafe_i_know: [force_comparison]", "unsafe_i_know: [force_comparison, watchdog]")
    rig = edited("serial", tmp_path, ("watchdog_ms: 60", "timeout_ms: 60"), words)
    found = of_stalls(check_rig(rig))
    assert (found.severity, found.where) == ("warning", "axis.drive.watchdog_ms")


@pytest.mark.parametrize("kind", ["serial", "raw_can", "serial_handle"])
def test_a_simulated_drive_without_a_profile_watches_for_as_long_as_its_rig_says(kind):
    assert load(kind).axis.drive.watchdog_ms * 1_000_000 == WATCHDOG_NS


@pytest.fixture
def checked(monkeypatch, capsys):
    """Run `teleop-rt check` on the default trial; returns its findings."""

    def run(*words):
        trial = Path(RIGS).parent / "trials" / "silicone_cube.yaml"
        monkeypatch.setattr(sys, "argv", ["teleop-rt", "check", str(trial), *words, "--json"])
        with contextlib.suppress(SystemExit):
            main()
        return json.loads(capsys.readouterr().out)["findings"]

    return run


def test_bounds_for_a_simulated_rig_are_reported_on_a_real_one(checked):
    result = [f for f in checked("--set", "plant=null") if "its bound for hardware" in f["what"]]
    assert [(f["severity"], f["where"]) for f in result] == [("warning", "realtime.late")]
    narrow = ("--set", "rig.realtime.late={hold_ms: 5, stop_ms: 20, stop_share: 0.2}")
    for words in ((), ("--set", "plant=null", *narrow)):
        assert not [f for f in checked(*words) if "its bound for hardware" in f["what"]]
