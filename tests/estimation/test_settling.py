"""After which time an estimate has settled: it then stays within 2 % of its last value."""

import numpy as np
import pytest

from teleop_rt.estimation.parameters import leading
from teleop_rt.estimation.rows import RowSpec
from teleop_rt.estimation.settling import settling_times
from teleop_rt.estimation.trace import Trace

PERIOD_S = 1e-3


def settled_s(values, touching=None, estimated=None, model="kelvin-voigt"):
    """Return the settling time of a row whose leading parameter had these values."""
    n = len(values)
    signals = np.zeros((n, 8))
    signals[:, 0] = 1.0 if touching is None else touching
    status = np.ones((n, 1)) if estimated is None else np.asarray(estimated)[:, None]
    row = RowSpec(model, "direct", "rls")
    kept = ({leading(row): np.asarray(values, float)},)
    return settling_times(Trace(signals, kept, status.astype(np.uint8), PERIOD_S, (row,)))[0]


def test_a_drift_of_some_per_mille_is_no_new_beginning_whatever_the_first_values_were():
    values = np.repeat([3700.0, 3671.0, 3608.5, 3600.4], [150, 34, 4000, 3000])
    assert settled_s(values) == pytest.approx(0.150)


def test_a_value_that_leaves_and_comes_back_has_settled_since_it_came_back():
    assert settled_s(np.repeat([400.0, 440.0, 400.0], [500, 3, 200])) == pytest.approx(0.503)


@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_earliest_time_from_which_all_values_lie_in_the_band(seed):
    rng = np.random.default_rng(seed)
    values = 1000.0 + np.cumsum(rng.normal(0.0, 1.0, 3000)) + 300.0 * np.exp(-np.arange(3000) / 200)
    place = round(settled_s(values) / PERIOD_S)
    off = np.abs(values / values[-1] - 1.0)
    assert off[place:].max() <= 0.02 < off[place - 1]


def test_only_time_in_contact_counts_and_of_a_free_body_all_time():
    values = np.repeat([100.0, 400.0], [300, 300])
    touching = np.arange(600) % 3 == 0
    assert settled_s(values, touching) == pytest.approx(0.100)
    assert settled_s(values, touching, model="mass") == pytest.approx(0.300)


def test_what_was_not_estimated_yet_had_not_settled_and_what_is_not_has_no_time():
    values = np.full(600, 400.0)
    assert settled_s(values, estimated=np.arange(600) >= 250) == pytest.approx(0.250)
    assert settled_s(values, estimated=np.arange(600) < 250) is None
