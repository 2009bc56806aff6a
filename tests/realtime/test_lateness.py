"""The rule of lateness at its edges, at rates from 100 Hz to 4 kHz."""

import subprocess
import sys

import numba
import pytest
from pydantic import ValidationError

from teleop_rt.config.realtime import LateConfig
from teleop_rt.realtime.lateness import ON_HARDWARE, Late, Lateness, late_ns

MS = 1_000_000
RATES_HZ = [100, 250, 1000, 4000]


def period(rate_hz: int) -> int:
    return round(1e9 / rate_hz)


def test_the_bounds_of_a_rig_that_says_nothing_are_5_ms_20_ms_and_a_fifth_of_a_second():
    assert (ON_HARDWARE.hold_ms, ON_HARDWARE.stop_ms, ON_HARDWARE.stop_share) == (5.0, 20.0, 0.2)


def test_bounds_out_of_order_are_refused_with_both_named():
    with pytest.raises(ValidationError, match="hold_ms 30 must not be above stop_ms 20"):
        LateConfig(hold_ms=30)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_bounds_are_times_at_every_rate_also_where_they_are_shorter_than_a_tick(rate_hz):
    def first(stall_ns: int) -> Late:
        return Lateness(ON_HARDWARE, period(rate_hz)).update(stall_ns)

    assert first(0) is Late.IN_TIME
    assert first(5 * MS - 1) is Late.IN_TIME
    assert first(5 * MS) is Late.HOLD
    assert first(20 * MS - 1) is Late.HOLD
    assert first(20 * MS) is Late.STOP


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("share", [0.07, 0.2, 0.5])
def test_a_share_of_the_ticks_of_a_second_stops_and_one_tick_less_does_not(rate_hz, share):
    """The late ticks come at once but for one, whose place decides: within the second, or not."""
    enough, wide = round(share * rate_hz), LateConfig(hold_ms=9e3, stop_ms=1e4, stop_share=share)
    for between, then in ((rate_hz - enough - 2, Late.STOP), (rate_hz - enough - 1, Late.IN_TIME)):
        late = Lateness(wide, period(rate_hz))
        assert late.update(period(rate_hz)) is Late.IN_TIME
        asked = {late.update(0) for _ in range(between)}
        assert asked <= {Late.IN_TIME}
        assert late.update((enough - 1) * period(rate_hz)) is then


def test_late_ticks_beyond_a_second_do_not_count_and_a_share_of_1_never_stops():
    late = Lateness(LateConfig(stop_share=0.2), MS)
    assert {late.update(MS) for _ in range(398)} == {Late.IN_TIME, Late.STOP}
    never = Lateness(LateConfig(hold_ms=5, stop_ms=50, stop_share=1), MS)
    assert {never.update(4 * MS) for _ in range(5000)} == {Late.IN_TIME}
    assert {never.update(49 * MS) for _ in range(5000)} == {Late.HOLD}


def test_a_second_that_is_forgotten_counts_no_more_but_its_longest_stall_is_kept():
    late = Lateness(ON_HARDWARE, MS)
    for _ in range(9):
        late.update(19 * MS)
    late.reset()
    assert late.update(19 * MS) is Late.HOLD
    assert (late.holds, late.late_ticks, late.longest_ns) == (10, 190, 19 * MS)


def test_a_stop_is_reported_with_its_time_and_the_first_bound_that_asked_for_it():
    late = Lateness(ON_HARDWARE, MS)
    for _ in range(99):
        late.update(0)
    late.update(23 * MS)
    late.update(40 * MS)
    late.update(7 * MS)
    result = late.outcome()
    assert result["stop"] == {"after_s": pytest.approx(0.123), "bound": "stop_ms", "stall_ms": 23.0}
    assert result["longest_stall_ms"] == 40.0
    often = Lateness(ON_HARDWARE, MS)
    while often.update(2 * MS) is not Late.STOP:
        pass
    expected = {"after_s": pytest.approx(0.3), "bound": "stop_share", "stall_ms": 2.0}
    assert often.outcome()["stop"] == expected


def test_a_process_that_was_stopped_for_an_hour_is_judged_at_once():
    late = Lateness(LateConfig(stop_ms=9e3, stop_share=1), period(4000))
    assert late.update(3600 * 10**9) is Late.STOP
    assert late.late_ticks == 3600 * 4000


@pytest.mark.parametrize(
    ("skipped", "latency_ns", "expected_ns"),
    [(0, 30_000, 30_000), (0, -5, 0), (3, 200_000, 3_200_000), (9, 9_400_000, 9_400_000)],
)
def test_how_late_a_tick_began_counts_whole_periods_once(skipped, latency_ns, expected_ns):
    assert late_ns(skipped, latency_ns, MS) == expected_ns


FIRST_TICK = """
from teleop_rt.realtime.lateness import ON_HARDWARE, Lateness, judge_lateness, load_kernels
load_kernels()
loaded = list(judge_lateness.signatures)
for late_ns in (0, 3_000_000, 2**40):
    Lateness(ON_HARDWARE, 500_000).update(late_ns)
print(len(loaded), judge_lateness.signatures == loaded)
"""


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_no_tick_of_a_master_waits_for_the_judgement_of_its_lateness_to_be_compiled():
    done = subprocess.run(
        [sys.executable, "-c", FIRST_TICK], capture_output=True, text=True, check=True
    )
    assert done.stdout == "1 True\n"
