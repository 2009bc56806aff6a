from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from master_world import CONFIG, PERIOD_NS, World
from test_closed_loop import PROFILE

from teleop_rt.link.impairment import Impairment
from teleop_rt.master.operators import Profile

BAD = Impairment(100 * PERIOD_NS, 25 * PERIOD_NS, loss=0.3, duplicate=0.05, reorder=0.1, burst=3.0)
QUICK = PROFILE.model_copy(update={"approach_speed": 0.08, "frequency_hz": 4.0})


@pytest.mark.parametrize("seeds", cases(range(13), range(13, 40)))
def test_force_slew_stays_within_its_limit_at_every_tick_of_many_bad_networks(
    seeds: range,
) -> None:
    """The force changes that the hand's own motion causes on unchanged walls are not slew."""
    adopted = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        world = World(Profile(QUICK), there=BAD, back=BAD, seed=seed, model_after=seed % 3 * 10)
        for tick in range(1700):
            if tick % 100 == 0:
                world.slave.k = 3600 * rng.uniform(0.3, 2.0)
                world.slave.ticks_in_contact = 0
            laws = world.master.adoption
            old, new, weight = laws.old, laws.new, laws.weight
            offset = world.master.registration.offset
            world.step()
            x, v = world.master.hand - offset, world.master.velocity
            before, after = (min(100.0, law.force(x, v)) for law in (old, new))
            unblended = (1 - weight) * before + weight * after
            assert abs(world.master.force - unblended) <= CONFIG.force_step + 1e-9
            adopted += new is not laws.new
        assert world.master.adoption.largest_step <= CONFIG.force_step + 1e-9
    assert adopted > 5 * len(seeds)
