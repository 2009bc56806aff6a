"""The record that the kernels of estimation work on."""

from dataclasses import fields

import numpy as np

from teleop_rt.estimation.state import new_state


def test_kernels_that_are_not_compiled_find_each_field_of_the_record_as_its_views_do():
    storage, views = new_state()
    for one in fields(views):
        assert np.shares_memory(getattr(storage[0], one.name), getattr(views, one.name)), one.name
