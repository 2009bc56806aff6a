"""The same hand on the wall that was rendered at some swings, kept as one continuous wall.

Purpose. On the other ideal walls, which lie where the body is, a hand arrives at its own time:
the phases of its taps, its tremor and the wall's ringing differ from the run's. Here the hand
takes the whole way of the run, past every rendered wall, offset and brake, to one period before
the swings.

The wall. From there on the hand has one wall: the one rendered at that moment, or at the end of
the swings if they begin with a first touch. It does not change while the hand is in it, or would
be in its successor: a wall that moves where nobody feels it does no work. It stays, or moves as
the body does. There is no model, offset, message, sampling or latency. Only the leash's brake
goes on as in the run: dry friction gives no energy, whatever its limit does.

The judgement. Swings are the hand's own in two cases. First, if it makes a row of swings there at
that time, about as fast and as large, and so long that fewer than five swings are left: this finds
a hand that bounces in its own rhythm, whose motions drift apart after an earlier touch. Second,
if little and nothing sustained remains once its motion there is subtracted: this finds tremor, of
which five swings are chance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from scipy.signal import detrend

from teleop_rt.config.trial import TrialConfig
from teleop_rt.master.engagement import LinkState
from teleop_rt.master.leash import Leash
from teleop_rt.master.master import Master
from teleop_rt.master.wall_limiter import WallLimiter
from teleop_rt.master.walls import NO_WALL, Wall
from teleop_rt_dev.hands.ideal import STEPS, Array, IdealWall, ideal_motion
from teleop_rt_dev.hands.oscillation import IDEAL_SHARE, SUSTAINED, Swings
from teleop_rt_dev.hands.second_judge import SAME_PITCH, Shaken, shaken

Row = TypeVar("Row", Shaken, Swings)
AROUND_S = 0.5
"""Swings count as those that were seen where they end within so long of them."""
REMAINS = 0.7
"""Of a motion's deviation: more than half of its power is gone with the hand's own. Without it the
sum of two motions that have nothing to do with each other, which is irregular, would acquit.
"""


@dataclass(frozen=True)
class TickWalls:
    """The walls of a tick; the leash counts from `leads_from`."""

    old: Wall
    new: Wall
    weight: float
    offset: float
    leads_from: float


class Rendered:
    """The walls of a run, tick by tick, without the damping that makes up for a latency."""

    def __init__(self) -> None:
        self.ticks: list[TickWalls] = []
        self._limiter: WallLimiter | None = None
        self._waits_at = 0.0
        self._calmed = NO_WALL, NO_WALL

    @property
    def grip(self) -> tuple[float, float]:
        """Stiffness and damping of the leash's brake at the end of the run."""
        return (0.0, 0.0) if self._limiter is None else self._limiter.grip

    def note(self, master: Master) -> None:
        """Note a tick."""
        adoption, slave = master.adoption, master.slave
        offset = master.registration.offset
        if slave is None or master.engagement.state == LinkState.WAITING:
            leads_from = self._waits_at = min(self._waits_at, master.hand)
        else:
            leads_from = slave.position + offset
            self._waits_at = master.hand
        if adoption.newest is not NO_WALL:
            leads_from = float("inf")
        old, new = self._calm(adoption.old), self._calm(adoption.new)
        self.ticks.append(TickWalls(old, new, adoption.weight, offset, leads_from))
        self._limiter = master.limiter

    def _calm(self, wall: Wall) -> Wall:
        """Return a wall without calming: the same object again while it is the same wall.

        A linear wall is only given the damping that its own lacks of the latency's. So
        where it is given some, latency takes its own, too, and no hand feels any of it.
        """
        if wall.calming == 0.0:
            return wall
        if wall is not self._calmed[0]:
            b = wall.b if wall.damping_power else 0.0
            self._calmed = wall, replace(wall, b=b, calming=0.0)
        return self._calmed[1]


class StaysAsItWas:
    """The walls of a trial in continuous time; from `until_s` on it is that of `stays_s`.

    It stays while the hand is in it or in the one that was rendered then; out of both, it becomes
    that one, from `stays_s` on. Then, if they are to, they move `with_body`, as the plant's surface
    moves by itself.
    """

    def __init__(
        self,
        trial: TrialConfig,
        rendered: Rendered,
        until_s: float,
        stays_s: float,
        *,
        with_body: bool,
    ) -> None:
        master = trial.master
        self._ticks, self._period_s = rendered.ticks, 1.0 / master.rate_hz
        self._last = len(rendered.ticks) - 1
        self._until_s, self._stays_s, self._now = until_s, stays_s, -1
        self._stays = self._ticks[self._at(stays_s)]
        self._body = IdealWall(trial.plant) if with_body else None
        self._most = master.force_max
        self._leash = Leash(
            1e-3 * master.leash_mm, master.leash_force, rendered.grip, self._period_s / STEPS
        )

    def force(self, x: float, v: float, t_s: float) -> float:
        """Return the force of the walls and of the leash."""
        now = self._at(t_s)
        if t_s > self._until_s:
            if now != self._now and t_s > self._stays_s:
                self._now = now
                if not self._holds(self._ticks[now], x) and not self._holds(
                    self._stays, x - self._since(t_s)
                ):
                    self._stays_s, self._stays = t_s, self._ticks[now]
            tick = self._stays
            place = x - tick.offset - self._since(t_s)
        else:
            tick = self._ticks[now]
            place = x - tick.offset
        force = tick.weight * self._of(tick.new, place, v)
        if tick.weight < 1.0:
            force += (1 - tick.weight) * self._of(tick.old, place, v)
        return force + self._leash.update(x, x - self._ticks[now].leads_from, v)

    def _at(self, t_s: float) -> int:
        return min(int(t_s / self._period_s), self._last)

    def _since(self, t_s: float) -> float:
        """Return how far the wall that stays has moved with the body."""
        return (
            0.0 if self._body is None else self._body.moved(t_s) - self._body.moved(self._stays_s)
        )

    def _holds(self, tick: TickWalls, x: float) -> bool:
        place = x - tick.offset
        return tick.new.holds(place) or (tick.weight < 1.0 and tick.old.holds(place))

    def _of(self, wall: Wall, place: float, v: float) -> float:
        if place <= wall.surface and not wall.terms and not wall.bilateral:
            return 0.0  # most steps: the hand is in free air
        return max(-self._most, min(self._most, wall.force(place, v)))


def whole(rows: list[Row]) -> list[Row]:
    """Return rows without those that only are the beginning of the next."""
    begins = {i for i, (row, after) in enumerate(pairwise(rows)) if after.swings > row.swings}
    return [row for i, row in enumerate(rows) if i not in begins]


def second_judges_rows(position: Array, motor: Array, period_s: float) -> list[Swings]:
    """Return the rows that the second judge finds in a motion."""
    return [timed(row) for row in shaken(position, motor, period_s)]


def timed(row: Shaken) -> Swings:
    """Return a row of the second judge with its begin: a swing lasts half a period."""
    begins_s = max(0.0, row.at_s - 0.5 * (row.swings + 1) / row.hz)
    return Swings(row.swings, row.size_m, row.hz, begins_s, row.at_s)


def is_own(
    row: Swings,
    judge: Callable[[Array, Array, float], list[Swings]],
    trial: TrialConfig,
    rendered: Rendered,
    position: Array,
    motor: Array,
) -> bool:
    """Return whether the same hand makes a row of swings by itself, or it is all that remains.

    `judge` finds the rows of a motion; position and motor (n,) are the true ones of the device, at
    each period.
    """
    period_s = 1.0 / trial.master.rate_hz
    begins_s = max(0.0, row.begins_s)
    moves = IdealWall(trial.plant).fastest > 0.0
    way = np.column_stack((position, np.gradient(position, period_s)))
    way = way[: round(begins_s / period_s)]
    for stays_s in (begins_s, row.ends_s):
        for with_body in (False, True)[: 1 + moves]:
            wall = StaysAsItWas(trial, rendered, begins_s, stays_s, with_body=with_body)
            own, force = ideal_motion(trial, wall, way)
            rest = position[: own.size] - own
            left = judge(rest, motor[: own.size], period_s)
            during = slice(round(begins_s / period_s), round(row.ends_s / period_s) + 1)
            little = np.std(detrend(rest[during])) < REMAINS * np.std(detrend(position[during]))
            if little and not any(_at_once(one, row) for one in left):
                return True
            if any(_at_once(one, row) and _covers(one, row) for one in judge(own, force, period_s)):
                return True
    return False


def _at_once(one: Swings, row: Swings) -> bool:
    return one.swings >= SUSTAINED and abs(one.ends_s - row.ends_s) < AROUND_S


def _covers(own: Swings, row: Swings) -> bool:
    """Return whether a hand's own row is about as large and as fast as another, and leaves no row.

    Fewer than SUSTAINED swings of the other are then left that the hand does not make.
    """
    pitch = 1 / SAME_PITCH < own.hz / row.hz < SAME_PITCH
    left = row.swings - own.swings
    return left < SUSTAINED and own.size_m >= IDEAL_SHARE * row.size_m and pitch
