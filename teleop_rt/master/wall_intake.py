"""Walls that the slave's news bring: of a model, of a touch seen by a state alone, of a phantom."""

from __future__ import annotations

import math
from dataclasses import replace

from teleop_rt.link.messages import ModelMessage, StateMessage
from teleop_rt.master.adoption import Adoption
from teleop_rt.master.provisional import Provisional
from teleop_rt.master.registration import PhantomWatch, Registration
from teleop_rt.master.rendered_effects import RenderedEffects
from teleop_rt.master.rhythm import Rhythm
from teleop_rt.master.screening import Screening
from teleop_rt.master.wall_limiter import WallLimiter
from teleop_rt.master.walls import NO_WALL, Wall, wall_of

WITHDRAWN_S = 0.2
"""How long a wall takes to be withdrawn where nothing is, whatever its force: the tool meets the
body behind it meanwhile, and a hand that it is taken from faster rings.
"""
REFLECTED_S, STILL_REFLECTED_S = 0.010, 0.015
"""Round trips up to which the force of an unknown wall is reflected: to begin with, and to go on.

At 5 ms the first half second is felt three times as accurately; from 20 ms on less than without.
"""
SLAVE_LATE_S = 0.005
"""From a target of the slave's to the force that answers it: a cycle each way and a drive's lag."""


class WallIntake:
    """Offers each wall that the news ask for to `adoption`, as far as the device can render it.

    `model` is the newest model taken, None before the first; `acknowledged` the newest contact of
    the slave whose wall is known; `provisional` whether the newest wall is known from states alone,
    `reflecting` whether it follows the force of each; `withdrawn` and `refused` count walls. With
    `refuses` a wall that the device cannot render whole is not rendered at all. Positions are the
    slave's, of `hand` before `registration`'s offset.
    """

    def __init__(
        self,
        adoption: Adoption,
        registration: Registration,
        limiter: WallLimiter,
        screening: Screening,
        effects: RenderedEffects,
        touch: Provisional,
        phantom: PhantomWatch,
        *,
        refuses: bool,
    ) -> None:
        self._adoption, self._registration = adoption, registration
        self._limiter, self._screening, self._effects = limiter, screening, effects
        self._touch, self._phantom = touch, phantom
        self._refuses = refuses
        self.rhythm = Rhythm()
        self.reset()

    def reset(self) -> None:
        """Go back to the state before the first news."""
        self.withdrawn = self.refused = 0
        self.forget()

    def forget(self) -> None:
        """Forget the agreement with the slave."""
        self._phantom.reset()
        self.model: ModelMessage | None = None
        self._prepared: tuple[ModelMessage | None, Wall | None] = None, None
        self.acknowledged = 0
        self.provisional = self.reflecting = False
        self._met, self._free_to = 0, -math.inf
        self.rhythm.reset()
        self._pressed = False
        self._moves_since = math.inf

    def prepare(self, model: ModelMessage | None) -> None:
        """Screen a new model ahead of the tick that will take it, and make its wall.

        Effects wait for that tick: their memories follow the hand from then on.
        """
        known = model is None or model is self.model or model is self._prepared[0]
        if model is not None and not known and not model.effects:
            self._prepared = model, self._wall_of(model)

    def take(
        self,
        model: ModelMessage | None,
        state: StateMessage | None,
        hand: float,
        one_way_s: float,
        now_s: float,
    ) -> None:
        """Take in the newest model and, where one has come in this tick, a state.

        `one_way_s` says how old news are when they arrive.
        """
        if model is not None and model is not self.model:
            self._take_model(model, hand, one_way_s, now_s)
        if state is not None:
            self._pressed = state.in_contact
            self._take_state(state, hand, one_way_s)
        if self._adoption.starved and not self._adoption.newest.bilateral:
            self._offer_placed(self._adoption.newest, hand)

    def render_anew(self, hand: float, one_way_s: float) -> None:
        """Take the newest model over again, as far as the device is trusted now."""
        if self.model is not None:
            self._take_model(self.model, hand, one_way_s)

    def _take_model(
        self, model: ModelMessage, hand: float, one_way_s: float, now_s: float | None = None
    ) -> None:
        self.model = model
        prepared, wall = self._prepared
        self._prepared = None, None
        if prepared is not model:
            wall = self._wall_of(model)
        if wall is None:
            return
        seen_s = self._seen_moving_s(wall, model.time_s)
        wall = self._as_it_is(wall, one_way_s, seen_s, now_s)
        if wall.surface < self._free_to and wall.surface_velocity == 0.0:
            wall = replace(wall, surface=self._free_to)
        if self._adopt(wall, hand):
            self.acknowledged = max(self.acknowledged, model.contact_id)

    def _wall_of(self, model: ModelMessage) -> Wall | None:
        """Return the wall of a model; None where it is refused, or nothing is to be rendered."""
        checked = self._screening.check(model)
        terms = self._effects.terms(model.effects, model.time_s)
        if terms is None:
            self._screening.refuse("unknown effect")
        return None if checked is None or terms is None else wall_of(checked, terms)

    def _as_it_is(self, wall: Wall, one_way_s: float, seen_s: float, now_s: float | None) -> Wall:
        """Return a wall whose surface has moved on since it was seen: in its rhythm or straight.

        A straight motion is continued for the `seen_s` that it has been seen, at most: a tracker
        that takes a stiffening for a fast surface, for some hundredths of a second, would otherwise
        put the wall centimetres away on a long link.
        """
        line = wall.moved(min(one_way_s, seen_s))
        if now_s is None:
            return line
        felt = self._pressed and wall.surface_velocity != 0.0
        if self._pressed and not felt:
            return line
        now = self.rhythm.follow(now_s, wall.surface, one_way_s, line.surface, felt=felt)
        if now is None:
            return line
        return replace(line, surface=now.surface, surface_velocity=now.velocity)

    def _seen_moving_s(self, wall: Wall, time_s: float) -> float:
        """Return for how long the slave has reported by `time_s`, its own, that the wall moves."""
        still = wall.surface_velocity == 0.0
        self._moves_since = math.inf if still else min(self._moves_since, time_s)
        return max(0.0, time_s - self._moves_since)

    def _take_state(self, state: StateMessage, hand: float, one_way_s: float) -> None:
        adoption = self._adoption
        if state.in_contact and state.contact_id > self._met:
            self._met, self._free_to = state.contact_id, min(self._free_to, state.position)
        if state.contact_id > self.acknowledged:
            if adoption.newest is NO_WALL:
                wall = self._touch.begin(_met_at(state), state)
                short = 2 * one_way_s <= REFLECTED_S and wall.k <= self._limiter.stiffness_max
                self.reflecting = short and state.in_contact
                known = self.reflecting or self._adopt(wall, hand)
                self.provisional = known
            else:
                known = adoption.holds(self._x(hand))
            self.acknowledged = state.contact_id if known else self.acknowledged
        elif self.reflecting:
            self._touch.update(state)
        elif self.provisional and (felt := self._touch.update(state)) is not None:
            self.provisional = self._adopt(felt, hand, gives_way=self._touch.gives_way)
        if self.reflecting:
            self._reflect(state, hand, 2 * one_way_s)
        depth = self._phantom.update(state, adoption.newest.moved(-one_way_s))
        if depth is not None:
            self.withdrawn += 1
            self._free_to = depth
            withdrawn = replace(adoption.newest, surface=depth)
            self._adopt(withdrawn, hand, lasts_s=WITHDRAWN_S, passive=True)

    def _reflect(self, state: StateMessage, hand: float, round_trip_s: float) -> None:
        """Render the slave's force by a spring that moves with it, or the touch's wall from now on.

        A force that comes over the link is late by a round trip and the slave's own lag, and takes
        more of the device's damping than a spring that is rendered here. So it is reflected only
        until the touch has a slope for which that damping is not there, or a model comes. Between
        two states the spring is one like any, so that a link that falls silent feeds nothing.
        """
        most = self._limiter.stiffness_max_later(round_trip_s + SLAVE_LATE_S)
        short = round_trip_s <= STILL_REFLECTED_S and self._touch.slope <= most
        if short and state.in_contact:
            wall = self._limiter.apply(self._touch.wall)
            self._adoption.reflect(wall, self._x(hand), max(0.0, state.force))
        else:
            self.reflecting = False
            self.provisional = self._adopt(self._touch.wall, hand)

    def _adopt(
        self,
        wall: Wall,
        hand: float,
        *,
        gives_way: bool = False,
        lasts_s: float | None = None,
        passive: bool = False,
    ) -> bool:
        """Offer a wall as far as the device can render it, at the hand if it is not felt yet.

        One that `gives_way` is blended in, and the tool stays. One that is `passive` is rendered as
        it is: the limiter has returned it before. Returns false where it is refused.
        """
        adoption, before = self._adoption, self._x(hand)
        rendered = wall if passive else self._limiter.apply(wall)
        if self._refuses and self._limiter.rendered_bound.reduced:
            self.refused += 1
            return False
        self.reflecting = False
        if rendered != adoption.newest:
            felt = adoption.holds(before)
            if (
                felt
                and not (rendered.bilateral or gives_way)
                and (self.provisional or not adoption.affords(rendered, before))
            ):
                self._offer_placed(rendered, hand)
            else:
                if not felt:
                    self._registration.adopt_at_hand(hand, rendered)
                adoption.offer(rendered, lasts_s)
            self.provisional = False
        return True

    def _offer_placed(self, wall: Wall, hand: float) -> None:
        """Offer a wall where its spring gives the felt force, or less where that cannot be paid."""
        adoption, before = self._adoption, self._x(hand)
        self._registration.place(hand, adoption.place_of(wall, before))
        adoption.shift(self._x(hand) - before)
        adoption.offer(wall, 0.0)

    def _x(self, hand: float) -> float:
        """Return the hand's position in the slave's coordinates."""
        return hand - self._registration.offset


def _met_at(state: StateMessage) -> float:
    """Return where a contact was met that is known from a state alone.

    A touch may be over before one of its states has arrived, and the slave waits there for the
    wall all the same: the wall then lies where the free space ends.
    """
    return state.position if state.in_contact else max(state.position, state.verified_free)
