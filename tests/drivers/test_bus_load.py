"""The load of a bus at worst, by frames as long as stuffing makes them."""

from __future__ import annotations

import pytest
from framed_bench import edited, load

from teleop_rt_drivers.bus_load import frame_bits
from teleop_rt_drivers.check import check_rig


def load_of(findings):
    (found,) = (f for f in findings if f.where.endswith(".bus"))
    return found


@pytest.mark.parametrize(("size", "bits"), [(0, 55), (1, 65), (5, 105), (8, 135)])
def test_a_frame_is_as_long_as_stuffing_can_make_it(size, bits):
    assert frame_bits(size) == bits


def longest(size: int) -> int:
    """The longest frame, found by stuffing the worst pattern bit by bit (CRC counted as worst)."""
    body = [0] * 5 + [1, 1, 1, 1, 0, 0, 0, 0] * 20
    body = body[: 34 + 8 * size]
    stuffed, run, last = [], 0, None
    for bit in body:
        stuffed.append(bit)
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            last = 1 - bit
            stuffed.append(last)
            run = 1
    return len(stuffed) + 13


@pytest.mark.parametrize("size", [0, 1, 5, 8])
def test_no_pattern_of_bits_is_longer_than_the_formula(size):
    assert longest(size) <= frame_bits(size)
    assert longest(size) >= frame_bits(size) - 1


def test_the_canopen_rig_uses_58_percent_of_1_mbit_at_1_khz():
    found = load_of(check_rig(load("canopen")))
    assert found.severity == "ok"
    assert found.what.startswith("58 % of 1000000 bit/s is used at 1000 Hz")


def test_a_bit_rate_that_no_loop_fits_is_refused_without_a_rate(tmp_path):
    rig = edited("canopen", tmp_path, ("bitrate: 1000000", "bitrate: 10000"))
    found = load_of(check_rig(rig))
    assert (found.severity, found.next_step) == ("error", "raise the bit rate")


def test_half_the_bit_rate_is_refused_with_the_rate_that_fits(tmp_path):
    rig = edited("canopen", tmp_path, ("bitrate: 1000000", "bitrate: 500000"))
    found = load_of(check_rig(rig))
    assert found.severity == "error"
    assert found.what.startswith("116 % of 500000 bit/s")
    assert "set rate_hz to at most 679" in found.next_step
    slower = edited(
        "canopen",
        tmp_path,
        ("bitrate: 1000000", "bitrate: 500000"),
        ("rate_hz: 1000", "rate_hz: 500"),
    )
    assert load_of(check_rig(slower)).severity == "ok"
