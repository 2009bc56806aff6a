"""Decide when the master needs a new model: when it would feel the difference, or to keep alive."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np

from teleop_rt.config import ModelId
from teleop_rt.config_link import LinkConfig
from teleop_rt.contact.fitted import FittedEffect, code_of, slopes
from teleop_rt.estimation import walls
from teleop_rt.estimation.pipeline import Contact, Pipeline, StreamedModel
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.messages import MOST_EFFECTS, SHAPES, ModelEffect, ModelMessage
from teleop_rt.slave import felt
from teleop_rt.slave.depth import HUNT_CROSSLEY, LINEAR
from teleop_rt.slave.record import TickRecord

_WINDOW = 32
_EVERY_TICKS = 10
_NOISE_FACTOR = 2.0


class ModelSender:
    """Sends the selected model over the link.

    A model goes out when, over the positions and velocities of the last window, its force would
    differ from that of the model last sent by more than max(2 sigma_f, 2 % of the force range),
    and in any case at the keep-alive rate, always the latest. With the just-noticeable deadband
    the bar is, at each of these positions, max(2 sigma_f, that share of the force) (Hinterseer et
    al. 2008); with none a model goes out every tick.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        endpoint: Endpoint,
        force_noise: float,
        force_cap: float,
        link: LinkConfig,
        now_ns: Callable[[], int],
        record: TickRecord,
    ) -> None:
        self._pipeline = pipeline
        self._tick = record.tick
        self._streaming = pipeline.streaming
        self._endpoint = endpoint
        self._force_noise = force_noise
        self._force_cap = force_cap
        self._keep_alive_ns = round(link.keep_alive_ms * 1e6)
        self._every_tick = link.model_deadband == "none"
        by_hand = link.model_deadband == "just-noticeable"
        self._noticeable_share = link.just_noticeable_share if by_hand else 0.0
        self._now_ns = now_ns
        self._seen = np.zeros((felt.N_SEEN, _WINDOW))
        self._seen[felt.POSITION] = math.nan
        self._terms = self._seen[felt.TERMS :]
        self._walls = np.zeros((2, felt.N_WALL))
        self._walls[felt.SENT, walls.MODEL] = felt.NO_MODEL
        self._new_wall, self._last_wall = self._walls
        self._would_be_felt()  # compiled now, not when the first contact comes
        self._ticks = 0
        self._sent: StreamedModel | None = None
        self._sent_ns = now_ns()
        self._surface_moved_ns = self._sent_ns
        self.sequence = 0
        self.models_sent = 0

    def update(self, position: float) -> None:
        """Take in one tick at an axis position, and send where it is time."""
        self._ticks += 1
        if self._ticks % _EVERY_TICKS and not self._every_tick:
            return
        contact = self._pipeline.contact
        slot = self._ticks // _EVERY_TICKS % _WINDOW
        self._seen[felt.POSITION, slot] = position if contact.in_contact else math.nan
        self._seen[felt.VELOCITY, slot] = contact.velocity
        self._streaming.write_effects(self._terms, slot)
        self._let_sent_surface_move()
        if not (self._streaming.write_wall(self._new_wall) and self._endpoint.connected):
            return
        due = self._now_ns() - self._sent_ns >= self._keep_alive_ns
        if due or self._every_tick or self._would_be_felt():
            self._send(contact)

    def _let_sent_surface_move(self) -> None:
        """Move the surface of the wall last sent as the master does, to compare it."""
        now_ns = self._now_ns()
        if self._sent is not None and self._sent.surface_velocity != 0.0:
            moved_s = (now_ns - self._surface_moved_ns) * 1e-9
            self._last_wall[walls.SURFACE] += self._sent.surface_velocity * moved_s
        self._surface_moved_ns = now_ns

    def _send(self, contact: Contact) -> None:
        model = self._streaming.model()
        if model is None:
            return
        if model != self._sent:
            self.sequence += 1
        self._sent = model
        self._last_wall[:] = self._new_wall
        self._note_depth(model)
        self._sent_ns = self._now_ns()
        self.models_sent += 1
        parameters = model.parameters
        self._endpoint.send(
            ModelMessage(
                model=cast(ModelId, model.model),
                model_sequence=self.sequence,
                contact_id=contact.contact_id,
                surface=model.surface,
                surface_known=contact.surface_known,
                k=parameters.get("k", 0.0),
                b=parameters.get("b", 0.0),
                n=parameters.get("n", 1.0),
                m=parameters.get("m", 0.0),
                offset=parameters.get("offset", 0.0),
                force_std=model.force_std,
                effects=tuple(
                    ModelEffect(code_of(one.effect), one.amplitude, _shape(one))
                    for one in model.effects[:MOST_EFFECTS]
                ),
                time_s=model.time_s,
                surface_velocity=model.surface_velocity,
            )
        )

    def _note_depth(self, model: StreamedModel) -> None:
        """Write what the depth of the model in use takes into the record of a tick."""
        tick, wall = self._tick, self._new_wall
        tick.model = HUNT_CROSSLEY if model.model == "hunt-crossley" else LINEAR
        tick.model_k, tick.model_b, tick.model_n = wall[walls.K], wall[walls.B], wall[walls.N]
        tick.model_added = self._stiffness_of_effects(model)

    def _stiffness_of_effects(self, model: StreamedModel) -> float:
        """Return the largest stiffness that effects of the environment add, up to the force cap."""
        deepest = self._force_cap / max(model.parameters.get("k", 0.0), 1e-9)
        return sum(
            abs(one.amplitude) * slopes(one.effect, one.eta, deepest, 1e-3)[0]
            for one in model.effects
            if one.effect.acts == "adds_force" and model.model != "hunt-crossley"
        )

    def _would_be_felt(self) -> bool:
        return felt.is_felt(
            self._walls, self._seen, _NOISE_FACTOR * self._force_noise, self._noticeable_share
        )


def _shape(one: FittedEffect) -> tuple[float, float, float]:
    """Return the shape parameters as the link carries them."""
    first, second, third = (*one.eta.tolist(), 0.0, 0.0, 0.0)[:SHAPES]
    return first, second, third
