"""Decide when the master needs a new model: when it would feel the difference, or to keep alive."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np

from teleop_rt.config.link import LinkConfig
from teleop_rt.contact.effect import MOST_SHAPES
from teleop_rt.contact.fitted import code_of, slopes
from teleop_rt.estimation import walls
from teleop_rt.estimation.streamed import Matrix, Streaming
from teleop_rt.kernels.jit import bound
from teleop_rt.link.bodies import new_model
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.messages import MOST_EFFECTS, Kind
from teleop_rt.slave import felt, sending
from teleop_rt.slave.depth import LINEAR
from teleop_rt.slave.record import TickRecord, place

_EVERY_TICKS = 10
"""Ticks between two looks at the model, where a deadband decides on sending."""
_NOISE_FACTOR = 2.0
"""Deviations of noise that a difference of two walls must exceed to be felt."""
_MODEL, _MODEL_K, _ADDED = place("model"), place("model_k"), place("model_added")
_SLOT, _MODELS_SENT = sending.place("slot"), sending.place("models_sent")
_KIND = Kind.MODEL


class ModelSender:
    """Sends the selected model over the link.

    A model goes out when, over the positions and velocities of the last window, its force would
    differ from that of the model last sent by more than max(2 sigma_f, 2 % of the force range),
    and in any case at the keep-alive rate, always the latest. With the just-noticeable deadband
    the bar is, at each of these positions, max(2 sigma_f, that share of the force) (Hinterseer et
    al. 2008); with none a model goes out every tick. `stored` is its record (1,) for kernels.
    """

    def __init__(
        self,
        streaming: Streaming,
        endpoint: Endpoint,
        force_noise: float,
        force_cap: float,
        link: LinkConfig,
        now_ns: Callable[[], int],
        record: TickRecord,
    ) -> None:
        """Send the model of `streaming`, from the contact that is in the record of a tick."""
        self._record = record
        self._streaming = streaming
        self._endpoint = endpoint
        self._force_cap = force_cap
        self._now_ns = now_ns
        self._every_tick = link.model_deadband == "none"
        by_hand = link.model_deadband == "just-noticeable"
        self.stored = stored = sending.new_sending(now_ns())
        one = cast("sending.Sending", stored[0])
        one.keep_alive_ns = round(link.keep_alive_ms * 1e6)
        one.every_tick = self._every_tick
        one.noise = _NOISE_FACTOR * force_noise
        one.noticeable_share = link.just_noticeable_share if by_hand else 0.0
        self._seen = np.zeros((felt.N_SEEN, sending.WINDOW))
        self._seen[felt.POSITION] = math.nan
        self._terms = self._seen[felt.TERMS :]
        self._walls = sending.new_walls(felt.N_WALL)
        new_wall = self._walls[felt.NEW]
        self._write_wall, self._new_wall = streaming.wall_writer(new_wall), new_wall.data
        self._counts = stored.view(np.int64).data
        body = new_model()
        self._body = body.view(np.uint8).data
        arrays = record.stored, stored, self._walls
        self._look = bound(sending.look, (*arrays, self._seen), 0.0, 0, False)  # noqa: FBT003
        self._write = bound(sending.write_message, (*arrays, self._effects(), body), 0)
        self._ticks = 0

    def _effects(self) -> Matrix:
        """Return codes and shapes of the effects, as many as a message has room for."""
        effects = np.zeros((MOST_EFFECTS, 1 + MOST_SHAPES))
        for row, one in zip(effects, self._streaming.effects, strict=False):
            shape = one.eta[:MOST_SHAPES]
            row[0], row[1 : 1 + len(shape)] = code_of(one.effect), shape
        return effects

    @property
    def models_sent(self) -> int:
        """How many messages carried a model."""
        return self._counts[_MODELS_SENT]

    def update(self, position: float) -> None:
        """Take in one tick at an axis position, and send where it is time."""
        self._ticks += 1
        if self._ticks % _EVERY_TICKS and not self._every_tick:
            return
        streaming = self._streaming
        slot = self._ticks // _EVERY_TICKS % sending.WINDOW
        self._counts[_SLOT] = slot
        streaming.write_effects(self._terms, slot)
        there = self._write_wall() and self._endpoint.connected
        now_ns = self._now_ns()
        if self._look(position, now_ns, there):
            self._write(now_ns)
            self._note_effects()
            self._endpoint.send_body(_KIND, self._body)

    def _note_effects(self) -> None:
        """Write the depth that a linear model's effects add into the record of a tick.

        That is the largest stiffness that those of the environment add, up to the force cap.
        """
        record = self._record
        count = int(self._new_wall[walls.COUNT])
        if count == 0 or record.counts[_MODEL] != LINEAR:
            return
        deepest = self._force_cap / max(record.floats[_MODEL_K], 1e-9)
        amplitudes = self._new_wall[walls.AMPLITUDES :]
        effects = self._streaming.effects[:count]
        record.floats[_ADDED] = sum(
            abs(amplitude) * slopes(one.effect, one.eta, deepest, 1e-3)[0]
            for amplitude, one in zip(amplitudes, effects, strict=False)
            if one.effect.acts == "adds_force"
        )
