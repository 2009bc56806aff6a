"""The table of a calibration: the rig itself, or the simulation of a trial in its place."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from teleop_rt.axis import Axis, Device, Sample
from teleop_rt.config.loader import load_trial
from teleop_rt.config.operator import DeviceOperator
from teleop_rt.config.rig import RigConfig
from teleop_rt.config.trial import TrialConfig
from teleop_rt.realtime.rig_locks import devices_held
from teleop_rt_drivers.calibration.weights import CalibrationError
from teleop_rt_drivers.opening import open_axis, open_lock_step
from teleop_rt_drivers.operator_device import open_device_of, simulated_device
from teleop_rt_drivers.pace import Pace, SimulatedPace, paced
from teleop_rt_drivers.registry import AXIS_SCHEMAS, PLANT_SCHEMAS, reached_by
from teleop_rt_drivers.simulated.config import SimulatedPlantConfig

NOBODY = "operator.hand.let_go_s=0.001"
"""Holds a simulated handle."""
RESTING_S = 0.5
"""For so long a simulated weight rests before it is read: a slow converter settles."""

Ask = Callable[[str], object]


@dataclass(frozen=True, slots=True)
class MeasuringClock:
    """The time of a measurement, and its pace by name and period [ns]."""

    now_ns: Callable[[], int]
    paced: Callable[[str, int], AbstractContextManager[Pace | SimulatedPace]]


REAL = MeasuringClock(time.monotonic_ns, paced)


def simulated_clock(pace: SimulatedPace) -> MeasuringClock:
    """Return the clock of simulated time."""

    @contextmanager
    def same(_name: str, _period_ns: int) -> Iterator[SimulatedPace]:
        yield pace

    return MeasuringClock(pace.now_ns, same)


def reserved(rig: RigConfig, trial: Path | None) -> AbstractContextManager[None]:
    """Hold the buses and ports of a rig; nothing where a trial's simulation takes its place.

    Raises BusyError while another process holds one of them.
    """
    return nullcontext() if trial is not None else devices_held(reached_by(rig))


def with_weights(
    file: Path, rig: RigConfig, trial: Path | None, ask: Ask
) -> tuple[Axis, MeasuringClock, Callable[[float, float], object]]:
    """Return axis, clock and `hang(mass [kg], force)` of a rig, or of a trial's simulated one.

    A person hangs the weights on a rig, at the words of `ask`. Raises CalibrationError.
    """
    if trial is None:

        def hung(mass: float, _force: float) -> object:
            return ask(f"hang {mass:g} kg, let it rest, press Enter")

        return open_axis(rig, time.monotonic_ns), REAL, hung
    one = _trial(trial, f"rig={file.resolve()}")
    if not isinstance(one.plant, SimulatedPlantConfig):
        raise CalibrationError(
            f"--simulated {trial.name}: this trial has no section plant"
            ": name one that simulates a body, such as silicone_cube"
        )
    pace = SimulatedPace(rig.period_ns)
    sample = Sample()
    axis, simulated = open_lock_step(rig, one.plant, pace.now_ns, one.seed)

    def hang(_mass: float, force: float) -> None:
        simulated.plant.hung = force
        for _ in range(round(RESTING_S * rig.rate_hz)):
            pace.wait()
            axis.read_into(sample)
            axis.write(sample.position)

    return axis, simulated_clock(pace), hang


def free_device(
    file: Path, rig: RigConfig, trial: Path | None, ask: Ask, words: str
) -> tuple[Device, MeasuringClock, Callable[[], object]]:
    """Return an operator's device, its clock and the action before it swings.

    Of a trial the one that it simulates, which nobody holds. Raises CalibrationError.
    """
    if trial is None:
        return open_device_of(rig, time.monotonic_ns), REAL, lambda: ask(words)
    _device_of(trial)  # before a rig is put in its place
    operator = _device_of(trial, f"operator.rig={file.resolve()}", NOBODY)
    pace = SimulatedPace(rig.period_ns)
    device, _, _ = simulated_device(operator, pace.now_ns, seed=1)
    return device, simulated_clock(pace), lambda: None


def _device_of(trial: Path, *overrides: str) -> DeviceOperator:
    operator = _trial(trial, *overrides).operator
    if not isinstance(operator, DeviceOperator) or operator.hand is None:
        raise CalibrationError(
            f"--simulated {trial.name}: this trial simulates no operator's device: name one "
            "that does, such as handle or serial_handle"
        )
    return operator


def _trial(file: Path, *overrides: str) -> TrialConfig:
    return load_trial(file, AXIS_SCHEMAS, PLANT_SCHEMAS, overrides)
