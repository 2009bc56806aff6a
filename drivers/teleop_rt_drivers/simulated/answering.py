"""When the devices of a CANopen network answer by one kernel, and their state in Python after."""

from __future__ import annotations

import time
from operator import attrgetter
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from teleop_rt.kernels.jit import bound
from teleop_rt.signals import TRUTH
from teleop_rt_drivers.can_door import UNUSUAL, poll_words
from teleop_rt_drivers.can_frames import FRAME, unpacked_plainly
from teleop_rt_drivers.simulated import answer as kernels
from teleop_rt_drivers.simulated.answer import BEAT, CYCLE, MEASURED, Answer, head_of
from teleop_rt_drivers.simulated.answer_wait import answer_until
from teleop_rt_drivers.simulated.line_answer import NEVER_NS
from teleop_rt_drivers.simulated.senses import DRAWS, MOST_ROWS, TrueRows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from teleop_rt_drivers.can_frames import CanFrame
    from teleop_rt_drivers.simulated.answer import CycleFields
    from teleop_rt_drivers.simulated.device import Node
    from teleop_rt_drivers.simulated.dictionary import Pdo
    from teleop_rt_drivers.simulated.drive import ServoDrive
    from teleop_rt_drivers.simulated.faults import FaultyWire
    from teleop_rt_drivers.simulated.hidden_motion import Matrix
    from teleop_rt_drivers.simulated.line_answer import Lines
    from teleop_rt_drivers.simulated.plant import Plant

MOST_FRAMES = 7  # of a packet
_HEARTBEAT = 0x700  # COB-ID without the node's id (CiA 301)
_changed = attrgetter("changed")


class Answering:
    """Answers the frames of every cycle at a bus's door, while its devices do nothing else.

    Python acts on the devices only after `hand_back`.
    """

    def __init__(
        self,
        bus: Any,
        plant: Plant,
        wire: FaultyWire,
        nodes: Sequence[Node],
        drive: ServoDrive | None,
        now_ns: Callable[[], int],
        note: Callable[[Matrix], None],
        *,
        sync_id: int,
        heartbeat_id: int,
    ) -> None:
        self._bus, self._plant, self._wire, self._note = bus, plant, wire, note
        self._nodes, self._drive = nodes, drive
        self._pdos: list[Pdo] = []
        self._stands = False
        cycle = np.zeros(1, CYCLE)
        self._cycle = cast("CycleFields", cycle[0])
        self._cycle.sync_id, self._cycle.heartbeat_id = sync_id, heartbeat_id
        self._clock = np.zeros(2, np.int64)
        self._cycle.clock = self._clock.ctypes.data
        self._records = cycle
        self._packet = np.zeros((0, 3), np.int64)
        self._beat = np.zeros(3, np.int64)
        self._cycle.beating = self._beat.ctypes.data
        self._beats = np.zeros(len(nodes), BEAT)
        self._heard, self._unsent = cycle["heard_ns"], cycle["unsent"]
        self._samples = 0
        self._true = TrueRows(np.zeros((MOST_ROWS, len(TRUTH))), np.zeros(1, np.int64))
        self._lines: Lines | None = None
        self._timers: tuple[int, ...] = ()
        self._watched: list[int] | None = None
        self._polls = np.zeros(0, np.int64)
        self._heartbeat_of = heartbeat_id & 0x7F
        door = getattr(bus, "door", None)
        answers = door is not None and door.door.frame_bytes == FRAME.size and plant.answers
        # Frames are stamped in the machine's own time.
        self._can = answers and now_ns is time.monotonic_ns
        if self._can:
            self._bind([])  # compiled now, so that the first SYNC is answered in time

    def watch(self, descriptors: list[int]) -> None:
        """Wait for all these from now on; one that is readable ends it, but for the bus's own."""
        if descriptors == self._watched:
            return
        self._watched, own, door = descriptors, self._bus.fileno(), self._bus.door
        others = [one for one in descriptors if one != own]
        # Not the bus's own descriptor, which waits for several: a wait for it takes longer.
        self._polls = poll_words([door.door.descriptor, *self._timers, door.comers, *others])
        self._bind_waiting()

    def send_meanwhile(self, lines: Lines, timer: int) -> None:
        """Send the frames of sensors on these lines while it waits, from now on.

        The timer is the descriptor that is readable when one is due.
        """
        self._lines, self._timers, self._watched = lines, (timer,), None
        if self._can:
            self._bind_waiting()

    def left(self, until_ns: int = 0) -> Sequence[CanFrame] | None:
        """Answer the frames that wait, or that come until then, for it `is_ready`.

        It ends before its time where Python has something to do. Return the frames that are left,
        None where none was received.
        """
        if self._samples:
            self._plant.draw(DRAWS)
        happened = self._take(self._place, until_ns)
        while True:
            self._pass_on()
            if happened == UNUSUAL:
                self._bus.keep()
                return None
            if happened & kernels.STRANGE:
                frames, size = self._cycle.frames, FRAME.size
                self.hand_back()
                return unpacked_plainly(self._bus.door.slots.data.cast("B")[: frames * size])
            if happened & kernels.UNSENT:
                self._bus.lost += len(self._packet)
            if not happened & kernels.MORE:
                return ()
            if happened & kernels.DRY:
                self._plant.draw(self._samples)
            happened = self._go_on()

    @property
    def heartbeat_due_ns(self) -> int:
        """When the next heartbeat is due that the kernel is to send [ns]."""
        return int(self._beats["due_ns"].min(initial=NEVER_NS)) if self._stands else NEVER_NS

    def _pass_on(self) -> None:
        """Pass the true motion and the last heartbeat on that kernels have noted."""
        true = self._true
        if (noted := true.new.item(0)) > 0:
            self._note(true.rows[:noted])
            true.new[0] = 0
        if (heard_ns := self._heard.item(0)) > 0:
            for node in self._nodes:
                node.receive_heartbeat(self._heartbeat_of, heard_ns)
            self._heard[0] = 0
        if unsent := self._unsent.item(0):
            self._bus.lost += unsent
            self._unsent[0] = 0

    def hand_back(self) -> None:
        """Pass the events since the last call on to the devices."""
        if not self._stands:
            return
        self._stands = False
        cycle = self._cycle
        if cycle.syncs:
            for row, pdo in zip(self._packet, self._pdos, strict=True):
                self._wire.note(pdo.cob_id, row[1].tobytes()[: pdo.struct.size])
        for node, due_ns in zip(self._nodes, self._beats["due_ns"].tolist(), strict=True):
            node.skip(cycle.syncs)
            node.take_heartbeat(0 if due_ns == NEVER_NS else due_ns)
        if self._drive is not None:
            self._drive.resume(
                _bytes(cycle.obeyed) if cycle.commands else None,
                _bytes(cycle.last) if cycle.pending else None,
            )

    def is_ready(self) -> bool:
        """Return whether the kernel may take the waiting frames."""
        if not self._stands or any(map(_changed, self._nodes)):
            self.hand_back()
            self._stands = self._plan()
        if self._stands and not self._bus.is_plain():
            self.hand_back()  # so that the devices send their heartbeats
        return self._stands

    def _plan(self) -> bool:
        """Take over how the devices stand; return whether nothing else happens to them now."""
        for node in self._nodes:
            node.changed = False
        if not (self._can and self._wire.plain) or not all(node.is_usual for node in self._nodes):
            return False
        self._pdos = [pdo for node in self._nodes for pdo in node.tpdos]
        rows = [row for node in self._nodes for row in node.objects()]
        if not 0 < len(self._pdos) <= MOST_FRAMES or not self._take_command():
            return False
        self._take_heartbeats()
        self._bind(rows)
        return True

    def _take_heartbeats(self) -> None:
        """Take the heartbeats of all nodes over."""
        for beat, node in zip(self._beats, self._nodes, strict=True):
            due_ns, period_ns, state = node.lend_heartbeat()
            beat["head"], beat["state"] = head_of(_HEARTBEAT + node.node_id, 1), state
            beat["due_ns"] = due_ns if period_ns else NEVER_NS
            beat["period_ns"] = period_ns

    def _take_command(self) -> bool:
        """Take over how the drive stands, if there is one; return whether that can be."""
        cycle = self._cycle
        cycle.command_id, cycle.follows, cycle.pending, cycle.last = -1, 0, 0, 0
        cycle.syncs = cycle.commands = 0
        if self._drive is None:
            return True
        standing = self._drive.standing()
        if standing is None:
            return False
        for name, value in standing.items():
            setattr(cycle, name, value)
        self._drive.received.clear()
        return True

    def _bind(self, rows: list[Any]) -> None:
        """Bind the kernels to the answers of these devices."""
        measured = np.zeros(sum(len(found) for _, _, found in rows), MEASURED)
        door, place = self._bus.door, 0
        for frame, (_, _, found) in enumerate(rows):
            for at, mask, kind in found:
                measured[place] = frame, at, mask, *kind
                place += 1
        self._samples = int(np.count_nonzero(measured["kind"] == kernels.FORCES))
        self._cycle.samples = self._samples
        self._packet = np.array(
            [(head_of(pdo.cob_id, pdo.struct.size), 0, 0) for pdo, _, _ in rows], np.int64
        ).reshape(-1, 3)
        constant = np.array([number for _, number, _ in rows], np.int64)
        answer = Answer(
            cycle=self._records,
            measured=measured,
            packet=self._packet,
            constant=constant,
            beats=self._beats,
            beat=self._beat,
            clock=self._clock,
            true=self._true,
        )
        self._cycle.sending = self._packet.ctypes.data
        self._arrays = answer, self._plant.moving, self._plant.beside
        self._go_on = bound(kernels.go_on, (*self._arrays, door.slots))
        self._bind_waiting()

    def _bind_waiting(self) -> None:
        """Bind the kernel that waits to the descriptors on which it does."""
        arrays = *self._arrays, *self._bus.door.arrays, self._polls, self._lines
        self._place = self._polls.ctypes.data
        self._take = bound(answer_until, arrays, 0, 0)


def _bytes(number: int) -> bytes:
    """Return the bytes of a frame that a kernel keeps as a number."""
    return int(number).to_bytes(8, "little", signed=True)
