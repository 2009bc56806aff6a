"""The simulated rig: one plant, and the devices around it on whatever buses the rig has."""

from __future__ import annotations

import select
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from teleop_rt.signals import TRUTH
from teleop_rt_drivers.simulated.actuator_network import FRAME_FAULTS
from teleop_rt_drivers.simulated.byte_faults import BYTE_FAULTS
from teleop_rt_drivers.simulated.faults import DRIVE_FAULTS, LASTING, SINGLE
from teleop_rt_drivers.simulated.plant import Plant

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
    from teleop_rt_drivers.simulated.hidden_motion import Matrix

    DeviceName = Literal["encoder", "force sensor", "drive"]

IDLE_ADVANCE_NS = 5_000_000
"""Without SYNC the plant still runs on, in spans of this length."""
SERVE_WAIT_NS = 5_000_000
"""Longest wait before the rig looks whether it is to end."""
NEVER_NS = 2**62
"""A time that does not come [ns]."""
FAULTS = tuple(
    dict.fromkeys((*LASTING, *SINGLE, *BYTE_FAULTS, "unplug", *FRAME_FAULTS, *DRIVE_FAULTS))
)


class Network(Protocol):
    """Some of the rig's devices on a bus or on lines of their own."""

    lost_frames: int

    @property
    def drive(self) -> Any:
        """The drive, if it is here."""

    @property
    def devices(self) -> Mapping[str, Any]:
        """The devices by name."""

    def power_on(self) -> None:
        """Switch every device on."""

    def inject(self, fault: str, device: str) -> bool:
        """Inject a fault by name; false where this network knows no such fault."""

    def heal(self, device: str) -> None:
        """End the device's lasting fault."""

    def process(self) -> None:
        """Handle the waiting frames, as of now."""

    def serve_once(self, readable: Collection[int]) -> None:
        """Handle the waiting frames, as of their arrival where that is known.

        Of its descriptors these were readable just now.
        """

    def due_ns(self, now_ns: int) -> int:
        """Return when there is something to do next."""

    def descriptors(self) -> list[int]:
        """Return the descriptor that becomes readable when there is something to do."""

    def close(self) -> None:
        """Release the bus or the lines."""


class AnsweringNetwork(Network, Protocol):
    """Devices that answer cycle after cycle without a look at anything else."""

    @property
    def together(self) -> tuple[Network, ...]:
        """The networks whose frames it answers, if they do nothing else."""

    def answer_until(self, until_ns: int, descriptors: list[int]) -> tuple[Network, ...]:
        """Handle the frames that come until then, or until one of these descriptors is readable.

        They are others' than its own. Return the networks for which it did: none where there are
        frames other than those of every cycle.
        """


class SimulatedRig:
    """One plant, and networks of devices around it.

    `truth_row` holds the newest row of `teleop_rt.signals.TRUTH`, of the last measurement;
    `on_truth`, if set, is called with each, and `on_truths` with rows that come together. All
    stamps come from `now_ns`, all random numbers from `seed`. The network that is `answering`, if
    any, waits for the others, too.
    """

    def __init__(
        self, plant: SimulatedPlantConfig, rig: RigConfig, now_ns: Callable[[], int], seed: int
    ) -> None:
        self.plant = Plant(plant, now_ns(), seed)
        self.truth_row: list[float] = [0.0] * len(TRUTH)
        self.on_truth: Callable[[list[float]], None] | None = None
        self.on_truths: Callable[[Matrix], None] | None = None
        self.networks: list[Network] = []
        self.answering: AnsweringNetwork | None = None
        self._units = rig.units
        self._now_ns = now_ns
        self._noted_ns = -1.0
        self.note_truth()

    @property
    def devices(self) -> dict[str, Any]:
        """Return the devices by name."""
        return {name: dev for network in self.networks for name, dev in network.devices.items()}

    @property
    def drive(self) -> Any:
        """Return the drive."""
        return next(network.drive for network in self.networks if network.drive is not None)

    @property
    def lost_frames(self) -> int:
        """Return how many frames no bus would take."""
        return sum(network.lost_frames for network in self.networks)

    def power_on(self) -> None:
        """Switch every device on."""
        for network in self.networks:
            network.power_on()

    def inject(self, fault: str, device: DeviceName = "force sensor") -> None:
        """Inject a fault by name; a lasting one stays until `heal`."""
        if fault not in FAULTS:
            raise ValueError(f"unknown fault {fault!r}; one of: {', '.join(FAULTS)}")
        network = self._network_of(device)
        if not network.inject(fault, device):
            raise ValueError(f"the {device} has no fault {fault!r} on its bus")

    def heal(self, device: DeviceName) -> None:
        """End the device's lasting fault."""
        self._network_of(device).heal(device)
        for own in self.networks:
            if own.drive is not None:
                own.drive.refuses = False

    def process(self) -> None:
        """Handle the waiting frames, run the devices' timers, let the plant run on."""
        for network in self.networks:
            network.process()
        self._advance_idle()

    def serve(self, stop: Callable[[], bool]) -> None:
        """Answer until `stop()`: each network where frames wait for it, or something is due."""
        self.power_on()
        networks, due_ns = self.networks, [0] * len(self.networks)
        while not stop():
            descriptors = [one for network in networks for one in network.descriptors()]
            answered = self._answered(due_ns)
            wait_ns = 0 if answered else min(min(due_ns) - self._now_ns(), SERVE_WAIT_NS)
            try:
                found, _, _ = select.select(descriptors, (), (), max(0, wait_ns) * 1e-9)
            except (OSError, ValueError):  # a line that is being pulled is no descriptor any more
                found = descriptors
            readable = frozenset(found)
            now_ns = self._now_ns()
            for number, network in enumerate(networks):
                waits = not readable.isdisjoint(network.descriptors())
                if waits or (due_ns[number] <= now_ns and network not in answered):
                    network.serve_once(readable)
                elif network not in answered:
                    continue
                due_ns[number] = network.due_ns(now_ns)
            if now_ns - self._noted_ns > IDLE_ADVANCE_NS:
                self._advance_idle()

    def _answered(self, due_ns: list[int]) -> tuple[Network, ...]:
        """Let a kernel answer until another network has something to do; return for which."""
        if self.answering is None:
            return ()
        until_ns, together = NEVER_NS, self.answering.together
        descriptors: list[int] = []
        for network, next_ns in zip(self.networks, due_ns, strict=True):
            if network not in together:
                until_ns = min(until_ns, next_ns)
                descriptors += network.descriptors()
        return self.answering.answer_until(until_ns, descriptors)

    def close(self) -> None:
        """Release every bus and line."""
        for network in self.networks:
            network.close()

    def truth(self) -> dict[str, Any]:
        """Return the plant's truth, for truth.json; the rig's units are with it."""
        return {"units": self._units.model_dump(), **self.plant.truth()}

    def note_truth(self) -> None:
        """Note the plant's state as of its own time, once for each instant."""
        row = self.plant.motion_row()
        if row[0] != self._noted_ns:
            self._noted_ns, self.truth_row = row[0], row
            if self.on_truth is not None:
                self.on_truth(row)

    def note_rows(self, rows: Matrix) -> None:
        """Note rows (n, columns of `teleop_rt.signals.TRUTH`), once for each instant."""
        stamps = rows[:, 0]
        differ = np.empty(len(rows), np.bool_)
        differ[:1] = stamps[:1] != self._noted_ns
        np.not_equal(stamps[1:], stamps[:-1], out=differ[1:])
        new = rows if differ.all() else rows[differ]
        if len(new) > 0:
            self.truth_row = new[-1].tolist()
            self._noted_ns = self.truth_row[0]
            if self.on_truths is not None:
                self.on_truths(new)

    def _network_of(self, device: str) -> Network:
        for network in self.networks:
            if device in network.devices:
                return network
        raise ValueError(f"no {device!r}; one of: {', '.join(self.devices)}")

    def _advance_idle(self) -> None:
        now_ns = self._now_ns()
        if now_ns - self.plant.now_ns > IDLE_ADVANCE_NS:
            self.plant.advance(now_ns)
            self.note_truth()
