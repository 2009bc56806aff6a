"""Parameters in the rig's units: those of no body are not-a-number, and overflow nothing."""

import numpy as np
import pytest

from teleop_rt.estimation.parameters import physical_over_time
from teleop_rt.estimation.rows import rows_for

LENGTH, TIME = 5e-3, 0.1
SINGULAR = (1616.9, -9307.9, -5.5)
"""Of integral error on a stiffening spring, in the one tick in which its matrix was singular."""


@pytest.mark.parametrize("singular", [SINGULAR, (-1616.9, 9307.9, 5.5), (0.0, 1e300, 1.0)])
def test_a_singular_solution_is_unknown_and_its_neighbours_are_not(singular):
    (row,) = rows_for(["hunt-crossley"], ["direct"], ["rls"])
    theta = np.array([(2.0, 0.1, 1.5), singular, (2.5, -0.1, 1.3)])
    with np.errstate(all="raise"):
        found = physical_over_time(row, theta, LENGTH, TIME)
    assert np.all(np.isnan(found[1, :2]))
    assert np.all(np.isfinite(found[::2]))
    for tick in (0, 2):
        k = np.exp(theta[tick, 0]) / LENGTH ** theta[tick, 2]
        assert found[tick] == pytest.approx([k, theta[tick, 1] * TIME / LENGTH * k, theta[tick, 2]])
