"""Decide when the master needs a new model: when it would feel the difference, or to keep alive."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np

from teleop_rt.config import ModelId
from teleop_rt.config_link import LinkConfig
from teleop_rt.contact.fitted import FittedEffect, code_of, slopes
from teleop_rt.estimation import rows, walls
from teleop_rt.estimation.pipeline import Contact, Pipeline
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.messages import SHAPES, ModelEffect, ModelMessage
from teleop_rt.slave import felt
from teleop_rt.slave.depth import HUNT_CROSSLEY, LINEAR
from teleop_rt.slave.record import Run, TickRecord

_WINDOW = 32
_EVERY_TICKS = 10
_NOISE_FACTOR = 2.0
_DEPTH = Run("model", "model_added")
_NAMES = cast("dict[float, ModelId]", {code: model for model, code in rows.MODEL_CODES.items()})


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
        self._record = record
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
        self._effects = [
            ModelEffect(code_of(one.effect), one.amplitude, _shape(one))
            for one in self._streaming.effects
        ]
        self._sent: tuple[list[float], tuple[float, float, float]] | None = None
        self._surface_velocity = 0.0
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
        if self._surface_velocity != 0.0:
            moved_s = (now_ns - self._surface_moved_ns) * 1e-9
            self._last_wall[walls.SURFACE] += self._surface_velocity * moved_s
        self._surface_moved_ns = now_ns

    def _send(self, contact: Contact) -> None:
        """Send the wall that was just written, with what the master needs beside it."""
        streaming = self._streaming
        code, surface, k, b, n, offset, m, count, *amplitudes = numbers = self._new_wall.tolist()
        news = (streaming.force_std, streaming.time_s, streaming.surface_velocity)
        if (numbers, news) != self._sent:
            self.sequence += 1
        self._sent, self._surface_velocity = (numbers, news), news[-1]
        effects = self._with_amplitudes(int(count), amplitudes)
        self._last_wall[:] = self._new_wall
        self._note_depth(int(code), k, b, n, effects)
        self._sent_ns = self._now_ns()
        self.models_sent += 1
        known = contact.surface_known
        message = (_NAMES[code], self.sequence, contact.contact_id, surface, known, k, b, n, m)
        self._endpoint.send(ModelMessage(*message, offset, news[0], effects, *news[1:]))

    def _with_amplitudes(self, count: int, amplitudes: list[float]) -> tuple[ModelEffect, ...]:
        """Return as many effects as the model has now and a message has room for."""
        return tuple(
            one._replace(amplitude=amplitude)
            for one, amplitude in zip(self._effects[:count], amplitudes, strict=False)
        )

    def _note_depth(
        self, code: int, k: float, b: float, n: float, effects: tuple[ModelEffect, ...]
    ) -> None:
        """Write what the depth of the model in use takes into the record of a tick."""
        kind = HUNT_CROSSLEY if code == rows.HUNT_CROSSLEY else LINEAR
        added = self._stiffness_of_effects(k, effects) if effects and kind == LINEAR else 0.0
        _DEPTH.write(self._record, kind, k, b, n, added)

    def _stiffness_of_effects(self, k: float, effects: tuple[ModelEffect, ...]) -> float:
        """Return the largest stiffness that effects of the environment add, up to the force cap."""
        deepest = self._force_cap / max(k, 1e-9)
        return sum(
            abs(sent.amplitude) * slopes(one.effect, one.eta, deepest, 1e-3)[0]
            for sent, one in zip(effects, self._streaming.effects, strict=False)
            if one.effect.acts == "adds_force"
        )

    def _would_be_felt(self) -> bool:
        return felt.is_felt(
            self._walls, self._seen, _NOISE_FACTOR * self._force_noise, self._noticeable_share
        )


def _shape(one: FittedEffect) -> tuple[float, float, float]:
    """Return the shape parameters as the link carries them."""
    first, second, third = (*one.eta.tolist(), 0.0, 0.0, 0.0)[:SHAPES]
    return first, second, third
