"""The newest message of each kind at one end of the link."""

from __future__ import annotations

from teleop_rt.link.bodies import NewestMotion
from teleop_rt.link.codec import read_motion, read_state
from teleop_rt.link.messages import (
    Kind,
    Message,
    ModelMessage,
    MotionMessage,
    StateMessage,
)


class Mailbox:
    """The newest motion, state and model, None before one has come or after a session has ended.

    The `fresh_...` flags say which came in this poll. `newest_motion` is `motion` for kernels.
    """

    def __init__(self) -> None:
        self.newest_motion = NewestMotion()
        self._motion: MotionMessage | bytes | None = None
        self._state: StateMessage | bytes | None = None
        self.model: ModelMessage | None = None
        self.fresh_motion = self.fresh_state = False

    @property
    def motion(self) -> MotionMessage | None:
        """The newest motion of the master; its bytes are read once somebody asks."""
        if isinstance(self._motion, bytes):
            self._motion = read_motion(self._motion)
        return self._motion

    @property
    def state(self) -> StateMessage | None:
        """The newest state of the slave; its bytes are read once somebody asks."""
        if isinstance(self._state, bytes):
            self._state = read_state(self._state)
        return self._state

    def store(self, kind: int, body: bytes, read: Message | None) -> None:
        """Keep a new message; `read` is the part of its body that was read already."""
        if kind == Kind.MOTION:
            self.newest_motion.take(body)
            self._motion, self.fresh_motion = body, True
        elif kind == Kind.STATE:
            self._state, self.fresh_state = body, True
        elif isinstance(read, ModelMessage):
            self.hold_model(read)

    def hold_model(self, model: ModelMessage) -> None:
        """Keep a model that is news."""
        self.model = model

    def forget(self) -> None:
        """Forget all of a session that has ended, also those of this very poll."""
        self.newest_motion.forget()
        self._motion = self.model = self._state = None
        self.fresh_motion = self.fresh_state = False
