"""The K-width: its own simulation rests at the bound, and does not far above it."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt_dev.campaign import kwidth

LATE_STEPS = 22
"""0.44 ms."""


@pytest.mark.parametrize("hand", kwidth.HANDS)
@pytest.mark.parametrize(("late", "bound"), [(0, 16_000.0), (LATE_STEPS, 7980.0)])
def test_every_hand_comes_to_rest_at_the_bound(hand, late, bound):
    moved = kwidth.unrest(0.99 * bound, 8.0, *hand, kwidth.PLAIN, np.zeros(late + 1))
    assert moved < kwidth.QUIET_M


def test_a_loose_hand_is_shaken_by_a_spring_far_above_the_bound():
    moved = kwidth.unrest(30_000.0, 8.0, *kwidth.HANDS[1], kwidth.PLAIN, np.zeros(LATE_STEPS + 1))
    assert moved > 4 * kwidth.QUIET_M


@pytest.mark.parametrize(
    ("latency_s", "stiffest"), [(0.0, 10_000.0), (0.5e-3, 4721.0), (1e-3, 3333.3)]
)
def test_the_optimum_is_the_known_bound_where_that_is_exact(latency_s, stiffest):
    """b = 5 N s/m at 1 kHz: Colgate and Schenkel (1997) for whole periods."""
    found = kwidth.best_wall.stiffest(5.0, 1e-3, latency_s, 0.0)
    assert found == pytest.approx(stiffest, rel=1e-3)


@pytest.mark.parametrize(
    ("handle", "changes"),
    [(name, ()) for name in kwidth.HANDLES] + [(name, kwidth.ANSWERED) for name in kwidth.ASKED],
)
def test_a_shipped_handle_renders_nine_tenths_of_the_optimum_and_no_more(handle, changes):
    found = kwidth.shipped(handle, changes)
    assert 0.9 * found["optimum_K"] <= found["rendered_K"] <= found["optimum_K"]
    assert 0.9 * found["optimum_B"] <= found["rendered_B"] <= found["optimum_B"]
