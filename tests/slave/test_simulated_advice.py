"""No next step on a simulated rig asks for a hand, a cable or patience with a sensor."""

import re

import pytest

from teleop_rt.slave.faults import FAULTS, FIRST_OF_AXIS
from teleop_rt.slave.simulated_advice import next_step_of


@pytest.mark.parametrize("fault", [one for one in FAULTS.values() if one.code < FIRST_OF_AXIS])
def test_a_step_of_start_and_limits_needs_no_hand_on_a_simulated_rig(fault):
    step = next_step_of(fault, simulated=True)
    assert re.search(r"\bhands?\b|warm up|wiring|shielding", step) is None
    assert next_step_of(fault, simulated=False) == fault.next_step
