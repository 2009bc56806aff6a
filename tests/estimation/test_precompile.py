"""The kernels of a tick, compiled before anything moves."""

import numpy as np
import pytest

from teleop_rt.estimation import cycle
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.precompile import types_of_ticks
from teleop_rt.estimation.rows import rows_for, whole_for

from .cube_rig import SETTINGS

LEAN, WHOLE = (rows_for(["kelvin-voigt"], [kind], ["rls"]) for kind in ("direct", "algebraic"))


@pytest.mark.parametrize("rows", [LEAN, WHOLE], ids=["lean", "whole"])
def test_a_tick_and_a_recording_take_the_one_form_that_is_compiled_before(rows):
    pipeline = Pipeline(rows, SETTINGS)
    pipeline.update(0.01, 0.0, valid=True)
    pipeline.run(np.full(3, 0.01), np.zeros(3), np.ones(3, dtype=np.bool_))
    assert types_of_ticks(whole_for(rows)) in set(cycle.run_ticks.overloads)
    assert set(cycle.run_ticks.overloads) <= {types_of_ticks(whole_for(r)) for r in (LEAN, WHOLE)}
