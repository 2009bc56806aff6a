"""Since when an estimate has settled: it has moved by no more than a band since then."""

import numpy as np
import pytest

from teleop_rt.estimation import selection as sel

DT = 1e-3


def settled_at(values, share=0.02):
    """Return the number of values before the one since which the last has settled."""
    record = np.zeros(sel.N_RECORD)
    for value in values:
        sel.settle(record, value, share * abs(value), DT)
    return round(record[sel.SETTLED_TIME] / DT) - 1


def test_a_drift_of_some_per_mille_is_no_new_beginning_whatever_the_first_value_was():
    values = [3682.0] * 100 + [3608.5] * 3000 + [3600.4] * 3000
    assert settled_at(values) == 100


def test_a_value_that_leaves_and_comes_back_has_settled_since_it_came_back():
    assert settled_at([400.0] * 500 + [440.0] * 3 + [400.0] * 200) == 503


@pytest.mark.parametrize("seed", range(20))
def test_no_two_values_since_it_settled_lie_further_apart_than_the_band(seed):
    rng = np.random.default_rng(seed)
    values = 1000.0 + np.cumsum(rng.normal(0.0, 1.0, 3000)) + 300.0 * np.exp(-np.arange(3000) / 200)
    since = values[settled_at(values) :]
    assert since.max() - since.min() <= 0.02 * since.max()
    assert since.size < values.size


def test_what_is_no_number_has_not_settled():
    assert settled_at([100.0] * 10 + [np.nan] * 5 + [100.0] * 10) == 15
