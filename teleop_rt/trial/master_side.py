"""Build the master of a trial from its config, for either clock; a slave does not load it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.config.operator import DeviceOperator
from teleop_rt.config.trial import TrialConfig
from teleop_rt.contact.effects.user import library
from teleop_rt.link.channel import Endpoint
from teleop_rt.master.build import OpenDevice, cutoff_of, make_operator, make_port
from teleop_rt.master.coupling import make_coupling
from teleop_rt.master.device import HeldDevice
from teleop_rt.master.master import Master
from teleop_rt.master.operators import Operator
from teleop_rt.master.outcome import outcome
from teleop_rt.master.passivity import Port
from teleop_rt.realtime import lateness
from teleop_rt.realtime.lateness import (
    IN_TIME,
    LATE_STOP,
    ON_HARDWARE,
    Late,
    Lateness,
    late_ns,
)
from teleop_rt.realtime.ring_folder import publish
from teleop_rt.realtime.ring_kernel import row_writer
from teleop_rt.signals import MASTER, MASTER_TOPIC
from teleop_rt.trial.late import both
from teleop_rt.trial.sides import link_outcome

_OPERATOR_STREAM = 3
"""Of the trial's seed; the ends of the link have streams of their own."""


def operator_of(
    trial: TrialConfig, folder: Path, open_device: OpenDevice | None = None
) -> Operator:
    """Return the trial's operator; `folder` is the trial file's.

    `open_device` opens a real one. Raises OperatorError, or AxisError for a device.
    """
    real = isinstance(trial.operator, DeviceOperator)
    return make_operator(
        trial.operator,
        folder=folder,
        period_s=1.0 / trial.master.rate_hz,
        rng=np.random.default_rng([trial.seed, _OPERATOR_STREAM]),
        open_device=open_device,
        device_cutoff_hz=cutoff_of(trial.master, real=real),
    )


def port_of(trial: TrialConfig, operator: Operator) -> Port:
    """Return how the operator's device senses and is driven: a real one's driver says it."""
    period_s, config = 1.0 / trial.master.rate_hz, trial.operator
    if isinstance(config, DeviceOperator) and isinstance(operator, HeldDevice):
        return make_port(trial.master, period_s, config, operator.timing)
    return make_port(trial.master, period_s)


class MasterSide:
    """The master with its ring: one `cycle()` runs and records a tick."""

    def __init__(
        self,
        trial: TrialConfig,
        operator: Operator,
        endpoint: Endpoint,
        now_ns: Callable[[], int],
        ring_folder: Path,
    ) -> None:
        self.period_ns = round(1e9 / trial.master.rate_hz)
        self.endpoint = endpoint
        self.operator = operator
        device = trial.operator if isinstance(trial.operator, DeviceOperator) else None
        rig = trial.rig if device is None else device.rig
        lateness.load_kernels()
        self.late = Lateness(rig.realtime.late, self.period_ns)
        self.on_hardware = Lateness(ON_HARDWARE, self.period_ns)
        self.ring = publish(ring_folder, MASTER_TOPIC, MASTER)
        self.missed_ticks = 0
        self.master = Master(
            trial.master,
            trial.rig.limits,
            self.period_ns,
            operator,
            endpoint,
            now_ns,
            make_coupling(trial.mode, trial.coupling),
            library(Path(trial.effects_file) if trial.effects_file else None),
            port_of(trial, operator),
        )
        self._record_row = row_writer(self.ring, np.asarray(self.master.row))

    def cycle(self, skipped: int = 0, wake_latency_ns: int = 0) -> None:
        """Run one tick and record it."""
        self.missed_ticks += skipped
        late = self._judge(late_ns(skipped, wake_latency_ns, self.period_ns))
        self.master.cycle(skipped, stalled=late is not IN_TIME)
        self._record_row()

    def _judge(self, late_ns: int) -> Late:
        """Judge how late a tick began, while a device pushes back; one that must stop is let go."""
        operator = self.operator
        device = operator if isinstance(operator, HeldDevice) else None
        felt = self.master.engagement.coupled if device is None else device.powered
        if not felt:
            return IN_TIME
        if not self.on_hardware.stopped:
            self.on_hardware.update(late_ns)
        late = self.late.update(late_ns)
        if late is LATE_STOP and device is not None:
            device.give_up()
        return late

    def outcome(self) -> dict[str, Any]:
        """Return the counts of the master's side, for the summary."""
        return {
            "link": link_outcome(self.endpoint),
            "missed_ticks": self.missed_ticks,
            "late": both(self.late, self.on_hardware),
            "rendering": outcome(self.master),
        }

    def let_go(self) -> None:
        """Stop and release the operator's device, if there is a real one."""
        if isinstance(self.operator, HeldDevice):
            self.operator.close()

    def close(self) -> None:
        """Release the device, close the ring for its readers, and close the link."""
        self.let_go()
        self.ring.close()
        self.endpoint.close()
