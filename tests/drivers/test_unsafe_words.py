"""A rig cannot be configured unsafe by mistake: each safeguard is lifted by its word alone."""

from __future__ import annotations

import sys

import pytest
from framed_bench import edited

from teleop_rt.axis import AxisError
from teleop_rt.config.rig import AxisConfig
from teleop_rt.config.yaml_file import ConfigError
from teleop_rt_dev.trial.files import SILICONE, silicone
from teleop_rt_drivers import opening
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.examination import check_config

CASES = [
    ("canopen", ('"0x6007": 3', '"0x6007": 0'), "connection_loss"),
    ("canopen", ('"0x6007": 3', '"0x6086": 0'), "connection_loss"),
    ("canopen", ('"0x6007": 3', '"0x6007": 3\n      "0x6007:0": 0'), "connection_loss"),
    ("canopen", ("daemon_timeout_ms: 60", "daemon_timeout_ms: 60000"), "watchdog"),
    ("canopen", ("heartbeat_timeout_ms: 60", "heartbeat_timeout_ms: 1000"), "device_timeout"),
    ("canopen", ("rated_force_N: 200.0", "offset_m: 0.0"), "force_comparison"),
    ("mixed", ("daemon_timeout_ms: 60", "daemon_timeout_ms: 201"), "watchdog"),
    ("raw_can", ("unsafe_i_know: [force_comparison]", ""), "force_comparison"),
    ("serial", ("unsafe_i_know: [force_comparison]", ""), "force_comparison"),
    ("odrive", ("unsafe_i_know: [position_comparison]", ""), "position_comparison"),
    ("moteus", ("unsafe_i_know: [position_comparison]", ""), "position_comparison"),
    ("odrive_handle", ("unsafe_i_know: [position_comparison]", ""), "position_comparison"),
    ("damiao_handle", ("unsafe_i_know: [position_comparison]", ""), "position_comparison"),
    ("serial_handle", ("unsafe_i_know: [position_comparison]", ""), "position_comparison"),
    ("handle", ("daemon_timeout_ms: 60", "daemon_timeout_ms: 300"), "watchdog"),
]
TWO_WORDS = [
    ("odrive", ("watchdog_ms: 50 ", "watchdog_ms: 300 "), "watchdog"),
    ("damiao", ("watchdog_ms: 50 ", "watchdog_ms: null "), "watchdog"),
    ("odrive_handle", ("watchdog_ms: 50 ", "watchdog_ms: null "), "watchdog"),
    ("serial_handle", ("watchdog_ms: 60 ", "watchdog_ms: null "), "watchdog"),
    ("serial", ("source: counter\n    field: count", "source: drive\n    field: actual"),
     "position_comparison"),
]  # fmt: skip
"""Rigs that go without a safeguard as they are shipped, and then without another."""


@pytest.mark.parametrize(("rig", "change", "word"), CASES)
def test_a_safeguard_is_missed_only_where_its_word_is_written(tmp_path, rig, change, word):
    with pytest.raises(ConfigError, match=rf"write unsafe_i_know: \[{word}\]"):
        edited(rig, tmp_path, change)
    known = ("rate_hz: 1000", f"rate_hz: 1000\nunsafe_i_know: [{word}]")
    lifted = edited(rig, tmp_path, change, known)
    assert len(lifted.unsafe) == 1
    result = [finding for finding in check_rig(lifted) if finding.where == "unsafe_i_know"]
    assert [finding.severity for finding in result] == ["danger"]


@pytest.mark.parametrize(("rig", "change", "word"), TWO_WORDS)
def test_each_safeguard_needs_a_word_of_its_own(tmp_path, rig, change, word):
    with pytest.raises(ConfigError, match=rf"write unsafe_i_know: \[{word}\]"):
        edited(rig, tmp_path, change)
    lifted = edited(rig, tmp_path, change, ("unsafe_i_know: [", f"unsafe_i_know: [{word}, "))
    assert len(lifted.unsafe) == 2


def test_a_driver_that_says_nothing_of_its_safeguards_has_none():
    assert {"watchdog", "force_comparison", "position_comparison"} == set(
        AxisConfig(driver="foreign").unsafe()
    )


def test_a_missing_safeguard_is_the_red_line_of_check_also_of_a_handle(monkeypatch, capsys):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.delenv("NO_COLOR", raising=False)
    serial = ["rig=../rigs/simulated_serial.yaml"]
    check_config(SILICONE.parent / "serial_handle.yaml", serial, as_json=False)
    said = capsys.readouterr().out.splitlines()
    coloured = [line for line in said if line.startswith("\x1b[1;31m")]
    assert len(coloured) == len([line for line in said if "\x1b" in line]) == 2
    assert "compared with the force sensor" in coloured[0]
    assert "compared with the encoder" in coloured[1]


@pytest.mark.parametrize("rig", ["raw_can", "serial"])
def test_another_word_lifts_nothing(tmp_path, rig):
    change = ("[force_comparison]", "[watchdog]")
    with pytest.raises(ConfigError, match=r"unsafe_i_know: \[force_comparison\]"):
        edited(rig, tmp_path, change)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("scale_N_per_count: 1.0e-3", "scale_N_per_count: 1.0e-320"), "scale is 1e-320|between"),
        (
            ("force_max_N: 120.0", "force_max_N: 1.0e308"),
            "force_max_N: must be less than or equal to 1000000",
        ),
    ],
)
def test_numbers_that_no_machine_has_are_refused(tmp_path, change, said):
    with pytest.raises(ConfigError, match=said):
        edited("canopen", tmp_path, change)


@pytest.mark.parametrize("entry", ["0x1016:1", "0x6040", "0x6060:0", "0x6071", "0x607A"])
def test_a_setup_writes_nothing_that_lets_the_drive_move(tmp_path, entry):
    with pytest.raises(ConfigError, match=rf"setup: {entry} is written by this program alone"):
        edited("canopen", tmp_path, ('"0x6007": 3', f'"0x6007": 3\n      "{entry}": 15'))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("scale_N_per_count: 1.0e-3", "scale_N_per_count: 1.0e-5"), "3 decimal digits"),
        (("scale_N_per_count: 1.0e-3", "scale_N_per_count: 1.0e-1"), "3 decimal digits"),
        (("rated_force_N: 200.0", "rated_force_N: 2.0"), "rated torque"),
        (("scale_m_per_count: 5.0e-6", "scale_m_per_count: 5.0e-5"), "measuring step"),
    ],
)
def test_a_scale_is_compared_with_what_the_device_says(tmp_path, change, said):
    rig = edited("canopen", tmp_path, change)
    axis, _ = opening.open_lock_step(rig, silicone().plant, lambda: 10**9, 1)
    with pytest.raises(AxisError, match=said):
        axis.configure()
    axis.close()
