"""Findings of `check` on an operator's device before it moves."""

import json

import pytest

from teleop_rt_dev.paths import TRIALS


@pytest.fixture
def check(call):
    """Check the shipped handle with changes; returns the exit code and findings by key."""

    def checking(*changes, trial="handle.yaml"):
        sets = [word for change in changes for word in ("--set", change)]
        code, out, _ = call("check", str(TRIALS / trial), "--json", *sets)
        return code, json.loads(out)["findings"]

    return checking


def said(findings, key):
    return [(found["severity"], found["what"]) for found in findings if found["where"] == key]


DAMPING = "operator.rig.device.damping"


@pytest.mark.parametrize("trial", ["handle.yaml", "serial_handle.yaml"])
def test_the_shipped_handles_render_their_wall_whole(check, trial):
    code, findings = check(trial=trial)
    assert code == 0
    limits = said(findings, DAMPING)
    assert any("K_max is" in what for _, what in limits)
    assert [severity for severity, what in limits if "the trial's wall" in what] == ["ok"]


def test_the_latency_is_what_bus_and_order_of_the_cycle_make_of_it(check):
    """A period for the answer, and one until the next SYNC takes the force over."""
    slow = ("operator.rig.axis.answer_within_ms=null",
            "operator.rig.axis.drive.rpdo.transmission_type=1")  # fmt: skip
    for changes, latency_ms in ((slow, 2.21), ((), 0.64)):
        _, findings = check(*changes)
        (latency,) = [w for _, w in said(findings, "operator.rig.axis") if "later:" in w]
        assert f"{latency_ms} ms later" in latency
    _, findings = check(*slow)
    assert said(findings, DAMPING)[-1][0] == "warning"


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        ("operator.rig.device.damping_N_s_per_m=0", DAMPING, "no damping at all"),
        ("master.device_delay_ms=0.2", "master.device_delay_ms", "0.2 ms is below the 0.64 ms"),
        (
            "operator.rig.axis.answer_within_ms=0.1",
            "operator.rig.axis.answer_within_ms",
            "0.1 ms is less than the 0.270 ms",
        ),
    ],
)
def test_a_device_that_cannot_be_is_refused_with_both_figures(check, change, key, words):
    code, findings = check(change)
    assert code == 2
    assert any(severity == "error" and words in what for severity, what in said(findings, key))
