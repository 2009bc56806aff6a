from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.study.delay import simulated_s
from teleop_rt.study.delay_hand import TONES
from teleop_rt.study.delay_measures import CALM_S
from teleop_rt.study.delay_world import Cell, run_cell


def test_the_hands_time_begins_with_engagement_and_it_is_judged_at_rest() -> None:
    """Three round trips pass before the slave is followed; the hand's plan waits for that."""
    cell = Cell("model-mediated", "silicone", 700.0, 0.0, 1)
    traces = run_cell(cell)
    lead = traces.signals["position"].size - len(traces.intention)
    assert lead > 2 * cell.round_trip_ms
    assert np.ptp(traces.intention[-round(CALM_S * 1e3) :]) == 0.0
    assert traces.still_tick is not None
    assert traces.intention[traces.still_tick - lead - 100] != traces.intention[-1], "moves before"
    seconds = traces.signals["position"].size * 1e-3
    assert simulated_s(cell) == pytest.approx(seconds, rel=0.25), "the cost's forecast"


def test_the_motion_in_contact_determines_its_lag_up_to_the_longest_round_trip() -> None:
    t = np.arange(0.0, 4.3, 1e-3)
    power = np.array([amplitude**2 for _, amplitude in TONES])
    turns = np.cos(2 * np.pi * np.outer([hertz for hertz, _ in TONES], t))
    likeness = power @ turns / power.sum()
    assert likeness[t > 0.3].max() < 0.8
