"""A dead master's genuine packets, withheld and let go one by one, are no news."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import pytest

from teleop_rt.cli.wiring import open_bench
from teleop_rt.slave.faults import State
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_dev.trial.files import SILICONE, silicone

HOLD_AFTER_MS = 100
LONGEST_TICKS = 20_000


class Withholding:
    """A transport whose attacker keeps packets back and lets them go when it likes."""

    def __init__(self, inner) -> None:
        self.inner = inner
        self.withholds = False
        self.kept: deque[bytes] = deque()
        self.let_go: deque[bytes] = deque()

    @property
    def sender(self):
        return self.inner.sender

    def send(self, packet, to=None) -> None:
        self.inner.send(packet, to)

    def receive(self):
        while (packet := self.inner.receive()) is not None:
            if not self.withholds:
                return packet
            self.kept.append(packet)
        return self.let_go.popleft() if self.let_go else None

    def confirm_sender(self) -> None:
        self.inner.confirm_sender()

    def close(self) -> None:
        self.inner.close()


def following(folder: Path, *changes: str) -> tuple[LockstepTrial, Withholding]:
    """A trial whose master is followed, and the attacker in front of its slave."""
    trial = LockstepTrial(silicone(*changes), SILICONE.parent, open_bench, folder)
    attacker = Withholding(trial.slave_endpoint.transport)
    trial.slave_endpoint.transport = attacker
    trial.slave.configure()
    while trial.slave.safety.state != State.RUN:
        trial.step()
        assert trial.slave.tick < LONGEST_TICKS
    states(trial, 500)
    return trial, attacker


def states(trial: LockstepTrial, ticks: int, each=lambda _: None) -> list[State]:
    """The slave's states over so many ticks of its own."""
    found = []
    while len(found) < ticks:
        tick = trial.slave.tick
        trial.step()
        if trial.slave.tick != tick:
            each(len(found))
            found.append(trial.slave.safety.state)
    return found


@pytest.mark.parametrize("newest_first", [False, True])
def test_withheld_motion_let_go_after_the_masters_death_is_not_followed(
    tmp_path: Path, newest_first: bool
) -> None:
    trial, attacker = following(tmp_path)
    attacker.withholds = True
    before = states(trial, 200)
    assert len(attacker.kept) > 150
    trial.lockstep.members[-1].cycle = lambda: None
    held = list(attacker.kept)
    attacker.kept.clear()

    def let_one_go(tick: int) -> None:
        if tick % 80 == 0 and held:
            attacker.let_go.append(held.pop(-1 if newest_first else 0))

    after = states(trial, 1500, let_one_go)
    assert State.RUN not in after[HOLD_AFTER_MS + 5 :], "a dead master is followed"
    assert State.RUN in before[: HOLD_AFTER_MS + 5]
    assert State.RUN not in before[HOLD_AFTER_MS + 5 :]
    rejected = trial.slave_endpoint.statistics.rejected
    assert rejected["late" if newest_first else "stale"] > 5


@pytest.mark.parametrize("round_trip_ms", [150, 4000])
def test_a_slow_link_is_followed_as_a_quick_one_is(tmp_path: Path, round_trip_ms: int) -> None:
    trial, _ = following(tmp_path, f"link.round_trip_ms={round_trip_ms}", "link.jitter_ms=20")
    assert set(states(trial, 1000)) == {State.RUN}
    assert trial.slave_endpoint.statistics.rejected.get("stale", 0) == 0
