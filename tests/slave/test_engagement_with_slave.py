"""Scaling, clutch and coming back with the real slave, estimators and link, on an ideal axis."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.config.trial import TrialConfig
from teleop_rt.master.engagement import LinkState
from teleop_rt.master.handle_faults import END_OF_TRAVEL, NO_FAULT, HandleFault
from teleop_rt.master.master import Master
from teleop_rt.signals import MASTER, columns
from teleop_rt.slave.faults import State
from teleop_rt.study.delay_world import SURFACE_M, Cell, World, trial_of

CELL = Cell("model-mediated", "silicone", 150.0, 0.0, 1)
COLUMN = columns(MASTER)
DT_S = 1e-3


class Scripted:
    """A hand that follows straight lines between (time, position), whatever it feels."""

    def __init__(self, *corners: tuple[float, float]) -> None:
        self._times, self._places = zip(*corners, strict=True)

    def reset(self) -> None:
        pass

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        now, later = np.interp([t_s, t_s + DT_S], self._times, self._places)
        return float(now), float(later - now) / DT_S


def changed(**sections: dict[str, object]) -> TrialConfig:
    trial = trial_of(CELL)
    update = {name: getattr(trial, name).model_copy(update=s) for name, s in sections.items()}
    return trial.model_copy(update=update)


def run(trial: TrialConfig, hand: Scripted, ticks: int) -> tuple[np.ndarray, np.ndarray, list]:
    """Return the master's rows, (commanded, true force) of the slave, and its states."""
    world = World(CELL, trial=trial, operator=hand)
    rows, slave, states = [], [], []
    try:
        for _ in range(ticks):
            world.step()
            rows.append(list(world.master.row))
            force = world.axis.material.force(world.axis.position - SURFACE_M, world.axis.velocity)
            slave.append((world.axis.reference, world.axis.position, float(force)))
            states.append(world.slave.safety.state)
    finally:
        world.close()
    return np.array(rows), np.array(slave), states


def test_the_slave_moves_and_the_hand_feels_by_the_stated_scales() -> None:
    trial = changed(master={"position_scale": 0.5, "force_scale": 0.5})
    presses = Scripted((0, 0), (2, 0.03), (4, 0.03), (6, 0.04), (12, 0.04))
    rows, slave, _ = run(trial, presses, 9000)
    hand = rows[:, COLUMN["position"]]
    free = slave[:, 1] < SURFACE_M - 1e-3
    moving = free & (hand > 0.004)
    assert moving.sum() > 100
    lag = (np.interp(0.5 * hand[moving], slave[:, 1], np.arange(len(slave)))
           - np.flatnonzero(moving))  # fmt: skip
    assert np.median(lag) == pytest.approx(75, abs=30), "half of the round trip, in ticks"
    felt, pressed = rows[-1, COLUMN["rendered_force"]], slave[-1, 2]
    assert pressed > 5.0
    assert felt == pytest.approx(0.5 * pressed, rel=0.02)


def test_a_slave_that_hears_a_master_which_leads_no_more_retreats() -> None:
    """The outage is shorter than the silence before a retreat, but the master declutches."""
    trial = changed(
        link={"blackouts_s": ((4.0, 4.45),)},
        master={"freeze_after_ms": 100.0, "declutch_after_ms": 300.0},
        slave={"retreat_after_ms": 1000.0},
    )
    stays = Scripted((0, 0), (1.5, 0.02), (9, 0.02))
    rows, slave, states = run(trial, stays, 6500)
    assert slave[3900, 2] > 5.0, "in contact when the link was lost"
    assert LinkState.DECLUTCHED in rows[4000:4600, COLUMN["state"]]
    assert set(states[4800:5000]) == {State.HOLD}
    assert slave[4900, 2] > 5.0, "held at first"
    assert slave[6400, 0] == pytest.approx(SURFACE_M, abs=2e-4), "retreated to the surface"


def test_the_tool_of_a_master_whose_device_was_let_go_retreats_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It pressed on for `retreat_after_ms`, with an operator who felt nothing."""
    faulted_ms, one_way_ms = 4000, 75

    def fault(master: Master) -> HandleFault:
        return END_OF_TRAVEL if master.tick >= faulted_ms else NO_FAULT

    monkeypatch.setattr(Master, "fault", property(fault))
    stays = Scripted((0, 0), (1.5, 0.02), (9, 0.02))
    trial = changed(slave={"retreat_after_ms": 1000.0})
    _, slave, states = run(trial, stays, 4400)
    assert slave[faulted_ms - 1, 2] > 5.0, "in contact when the device was let go"
    heard = states.index(State.HOLD, faulted_ms - 1)
    assert heard - faulted_ms == pytest.approx(one_way_ms, abs=30)
    steps = np.diff(slave[heard : heard + 10, 0])
    np.testing.assert_allclose(steps, -trial.slave.retreat_speed * DT_S, rtol=0.2)
    assert slave[-1, 0] == pytest.approx(SURFACE_M, abs=2e-4), "retreated to the surface"


def test_after_a_blackout_the_slave_retreats_and_follows_again_only_out_of_contact() -> None:
    trial = changed(link={"blackouts_s": ((4.0, 8.0),)})
    comes_back = Scripted(
        (0, 0), (1.5, 0.02), (9, 0.02), (10, -0.01), (11.5, -0.01), (13, 0.02), (16, 0.02)
    )
    rows, slave, states = run(trial, comes_back, 15_500)
    state, reference = rows[:, COLUMN["state"]], slave[:, 0]
    assert slave[3900, 2] > 5.0, "in contact when the link was lost"
    assert State.HOLD in states[4000:8000]
    assert reference[7900] == pytest.approx(SURFACE_M, abs=2e-4), "retreated to the surface"
    assert LinkState.DECLUTCHED in state[4000:8000]
    assert rows[7900, COLUMN["rendered_force"]] == 0.0
    follows = np.array([one == State.RUN for one in states])
    back = int(np.flatnonzero(follows & (np.arange(len(follows)) > 8000))[0])
    assert slave[back, 2] < 1.0, "out of contact, or at most touching"
    assert state[-1] == LinkState.ENGAGED
    assert slave[-1, 2] > 5.0, "and presses again"
    steps = np.abs(np.diff(reference[4000:]))
    fastest = np.abs(np.diff(rows[4000:, COLUMN["position"]])).max()
    allowed = fastest + (trial.master.offset_speed + trial.slave.retreat_speed) * DT_S
    assert steps.max() <= allowed, "no jump, neither at the retreat nor at the return"
    jumps = np.abs(np.diff(rows[8000:, COLUMN["rendered_force"]]))
    assert jumps.max() <= trial.master.force_step + 3600 * fastest + 1e-9
