"""Loading of a trial with the schemas of all drivers, and opening of its rig."""

from __future__ import annotations

import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.loader import load_trial
from teleop_rt.config.operator import RecordedOperator
from teleop_rt.config.trial import TrialConfig
from teleop_rt.link.transport import LinkError
from teleop_rt.master.recorded import locate
from teleop_rt.realtime.ring_folder import publish
from teleop_rt.signals import HANDLE_TRUTH, HANDLE_TRUTH_TOPIC, TRUTH, TRUTH_TOPIC
from teleop_rt.trial.bench import Bench
from teleop_rt.trial.estimators import trial_extension
from teleop_rt_drivers import opening, operator_device, registry
from teleop_rt_drivers.recording import RecordingAxisConfig, columns_of, recording_path

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.hand_plant import HandPlant
    from teleop_rt_drivers.simulated.rig import SimulatedRig


def load_trial_file(trial_file: Path, overrides: list[str] | None) -> TrialConfig:
    """Load a trial with the schemas of all drivers. Raises ConfigError."""
    trial = load_trial(trial_file, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, overrides or ())
    trial_extension(trial)
    return trial


def load_trial_for_run(trial_file: Path, changes: list[str]) -> TrialConfig:
    """Load a trial for a run on the machine's clock.

    Ports that the trial leaves open become the run's own, and so do the buses and lines of
    simulated devices; those of real devices stay where the rig says that they are.
    """
    trial = load_trial_file(trial_file, changes)
    own = [] if trial.plant is None else registry.own_run(trial.rig)
    return load_trial_file(trial_file, [*changes, *_free_ports(trial), *own])


def require_files(trial: TrialConfig, trial_file: Path) -> None:
    """Raise AxisError or OperatorError where a recording that the trial plays is not there."""
    if isinstance(trial.rig.axis, RecordingAxisConfig):
        recording_path(trial.rig.axis.file, columns_of(trial.rig.axis))
    if isinstance(trial.operator, RecordedOperator):
        locate(trial.operator.file, trial_file.parent)


def _free_ports(trial: TrialConfig) -> list[str]:
    """Choose ports for a run of its own on this machine, where the trial leaves them open."""
    changes = []
    for name in ("slave_port", "master_port"):
        if getattr(trial.link, name) == 0:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                try:
                    probe.bind((trial.link.bind_host, 0))
                except OSError as error:
                    message = f"link.bind_host: {trial.link.bind_host}: {error.strerror}"
                    raise LinkError(f"{message}; give an address of this machine") from None
                changes.append(f"link.{name}={probe.getsockname()[1]}")
    return changes


def open_bench(trial: TrialConfig, now_ns: Callable[[], int], folder: Path | None = None) -> Bench:
    """Open the axis of a trial on simulated time, with its simulator where it has one.

    Buses that ask for it are logged into the folder.
    """
    handles: list[HandPlant] = []
    rows: list[NDArray[np.float64]] = []

    def made(plant: HandPlant) -> None:
        handles.append(plant)
        rows.append(plant.truth_row)

    device = partial(operator_device.open_device, now_ns=now_ns, seed=trial.seed, made=made)
    if trial.plant is None:
        return Bench(opening.open_axis(trial.rig, now_ns), open_device=device)
    axis, rig = opening.open_lock_step(trial.rig, trial.plant, now_ns, trial.seed, folder)

    def truth() -> dict[str, Any]:
        return rig.truth() | ({"handle": handles[0].truth()} if handles else {})

    def publish(ring_folder: Path) -> None:
        publish_truth(rig, ring_folder)
        for handle in handles:
            publish_handle(handle, ring_folder)

    return Bench(axis, truth, publish, device, rows)


def publish_handle(plant: HandPlant, ring_folder: Path) -> None:
    """Make the ring of the true motion of an operator's device."""
    ring = publish(ring_folder, HANDLE_TRUTH_TOPIC, HANDLE_TRUTH)
    plant.on_truth = lambda: ring.push(plant.truth_row)


def publish_truth(rig: SimulatedRig, ring_folder: Path) -> Callable[[], None]:
    """Make the ring of a simulated rig's true motion; return the function that closes it."""
    ring = publish(ring_folder, TRUTH_TOPIC, TRUTH)
    rig.on_truth, rig.on_truths = ring.push, ring.push_rows
    return ring.close
