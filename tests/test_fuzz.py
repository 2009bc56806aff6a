"""A slice of `scripts/campaign fuzz`, and that it notices planted faults."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest

from teleop_rt.errors import ExpectedError
from teleop_rt_dev.campaign import fuzz as campaign_fuzz
from teleop_rt_dev.campaign.frames import ON_CAN, ON_LINES, Victim, attack
from teleop_rt_dev.fuzz_damage import Target
from teleop_rt_dev.fuzz_targets import TARGETS
from teleop_rt_drivers.actuators.feetech import FeetechCodec

CASES = 40
REFUSALS = (
    "wrong_length", "bad_checksum", "unexpected_id", "impossible_jump", "out_of_range",
    "not_a_number", "bad_status",
)  # fmt: skip


def seeded(name: str) -> random.Random:
    return random.Random(name)  # noqa: S311 - reproducible damage


@pytest.mark.parametrize("name", list(TARGETS))
def test_damaged_input_is_read_or_refused(name: str, tmp_path: Path) -> None:
    target = TARGETS[name](tmp_path)
    for case in range(CASES):
        target.run(seeded(f"{name} test {case}"))


def test_a_traceback_is_found_and_a_refusal_is_none(monkeypatch, tmp_path, capsys) -> None:
    def refuses(_: bytes) -> None:
        raise ExpectedError("no")

    def fails(data: bytes) -> None:
        if len(data) > 10:
            raise ValueError("found")

    assert campaign_fuzz.run_case(Target(refuses, [b"seed"]), seeded("1")) == ""
    monkeypatch.chdir(tmp_path)
    found = campaign_fuzz.fuzz("some", lambda _: Target(fails, [b"a longer seed"]), 5.0, 1)
    assert "ValueError: found" in found["problem"]
    assert len(list(tmp_path.glob("fuzz-some-1-*"))) == 1


def test_a_hang_is_found(monkeypatch) -> None:
    monkeypatch.setattr(campaign_fuzz, "HANG_S", 1)
    before = signal.signal(signal.SIGPROF, campaign_fuzz.on_alarm)

    def hangs(_: bytes) -> None:
        while True:
            pass

    try:
        assert "hung" in campaign_fuzz.run_case(Target(hangs, [b"seed"]), seeded("1"))
    finally:
        signal.signal(signal.SIGPROF, before)


def test_growth_is_found(monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    held: list[bytes] = []
    grows = Target(lambda _: held.append(b"x" * (64 << 20)), [b"seed"])
    assert "grew" in campaign_fuzz.fuzz("some", lambda _: grows, 60.0, 1)["problem"]


@pytest.mark.parametrize("drive", [*ON_CAN, *ON_LINES])
def test_damaged_answers_of_a_drive_are_refused_or_possible(drive: str) -> None:
    found = attack(drive, 1500, 3)
    assert found.frames == 1500
    assert found.values > 500
    assert sum(found.counted.get(name, 0) for name in REFUSALS) > 400
    assert found.impossible == 0
    assert found.accepted_detectable == 0


def test_a_value_without_limits_is_found(monkeypatch) -> None:
    made = Victim.__init__

    def boundless(victim: Victim, drive: str) -> None:
        made(victim, drive)
        value = victim.signal._state
        value.lower, value.upper, value.slack = -1e9, 1e9, 1e9

    monkeypatch.setattr(Victim, "__init__", boundless)
    assert attack("damiao", 300, 3).impossible > 0


def test_a_checksum_that_is_not_computed_is_found(monkeypatch) -> None:
    monkeypatch.setattr(FeetechCodec, "sound", lambda *_: True)
    assert attack("feetech", 300, 3).accepted_detectable > 0
