"""The mains of slave, master and simulated rig, each started alone or forked by a run."""

from __future__ import annotations

import gc
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from teleop_rt.axis import Axis, AxisError
from teleop_rt.cli.leaving import leave_on_fault
from teleop_rt.cli.wiring import load_trial_file, publish_handle, publish_truth
from teleop_rt.config.trial import TrialConfig
from teleop_rt.errors import FAULT, ExpectedError
from teleop_rt.interrupts import StopRequest
from teleop_rt.link.keys import default_key, load_keys, load_own_key
from teleop_rt.link.transport import LinkError
from teleop_rt.realtime.parent import Emit, emit_to_parent, emitting_problems, end_with_parent
from teleop_rt.realtime.rig_locks import simulation_held
from teleop_rt.realtime.ring_folder import new_ring_folder
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.service.place import Claim, claimed
from teleop_rt.trial.alone import PlainEvents, alone
from teleop_rt.trial.estimators import make_pipeline
from teleop_rt.trial.folder import TRUTH, new_folder, write_json, write_trial
from teleop_rt.trial.process_main import RIG_PRIORITY, SlaveEnd, master_main, slave_main
from teleop_rt.trial.side import Configs, Side
from teleop_rt_drivers import opening, operator_device, registry

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.hand_plant import HandPlant

_UNHEARD = (
    "no master was heard, so the axis held its position: start the master, then the slave again"
)
_KEYS_OF: dict[str, Callable[[Path], object]] = {"slave": load_keys, "master": load_own_key}


def run_slave(
    trial_file: Path,
    key: Path | None,
    overrides: list[str] | None,
    out: Path | None,
    *,
    arm: bool,
    as_json: bool,
) -> None:
    """Run the slave daemon; `arm` at once, for the trial's duration only."""
    if "RUNTIME_DIRECTORY" in os.environ:  # a service's group may read its recordings
        os.umask(0o027)
    gc.freeze()  # a collection before the loop would look through all modules, for 0.1 s
    with Claim() as claim:
        end, armed = _rounds(claim, trial_file, key, overrides, out, arm=arm, as_json=as_json)
    leave_on_fault(end.outcome["safety"], "start the slave again")
    if armed and end.outcome["link"]["received"] == 0:
        print(_UNHEARD, file=sys.stderr)
        raise typer.Exit(FAULT)


def _rounds(
    claim: Claim,
    trial_file: Path,
    key: Path | None,
    overrides: list[str] | None,
    out: Path | None,
    *,
    arm: bool,
    as_json: bool,
) -> tuple[SlaveEnd, bool]:
    """Run the slave, again after each reload; the rig stays held in between.

    Return its end, and whether this run was armed at once: after a reload none is.
    """
    should_stop, configs, rounds = StopRequest(), Configs(), 0
    while True:
        rounds += 1
        folder = out if out is None or rounds == 1 else out.with_name(f"{out.name}-{rounds}")
        try:
            with _side(
                "slave", trial_file, overrides, folder, key, as_json=as_json, trial=configs.running
            ) as side:
                configs.running = side.trial
                armed = arm and rounds == 1
                end = _serve(side, configs, claim, key, should_stop, arm=armed)
        except ExpectedError as error:
            if configs.before is None:
                raise
            configs.refused(str(error))
            refused = f"the reloaded config was refused, the one before runs: {error}"
            print(f"{refused}: correct the file and reload again", file=sys.stderr)
            continue
        if not end.again:
            return end, armed
        configs.reload()


def _serve(
    side: Side,
    configs: Configs,
    claim: Claim,
    key: Path | None,
    should_stop: StopRequest,
    *,
    arm: bool,
) -> SlaveEnd:
    """Run the slave with one config until it ends or is to begin again with another."""
    trial = side.trial

    def open_axis(now_ns: Callable[[], int]) -> Axis:
        return opening.open_axis(trial.rig, now_ns)

    with registry.logged(trial.rig, side.folder), _commanded(side, claim):
        keys = load_keys(key or default_key())
        end = slave_main(side, configs, open_axis, keys, should_stop, arm=arm)
    side.finish(end.outcome)
    return end


def run_master(
    trial_file: Path,
    key: Path | None,
    overrides: list[str] | None,
    out: Path | None,
    *,
    as_json: bool,
) -> None:
    """Run the master next to the operator until it is stopped."""
    gc.freeze()  # as above
    with _side("master", trial_file, overrides, out, key, as_json=as_json) as side:
        _operate(side, trial_file, key)


def _operate(side: Side, trial_file: Path, key: Path | None) -> None:
    """Run the master until a stop request; the true motion of a simulated handle is recorded."""
    handles: list[HandPlant] = []

    def made(plant: HandPlant) -> None:
        handles.append(plant)
        publish_handle(plant, side.ring_folder)

    outcome = master_main(
        side,
        trial_file.parent,
        load_own_key(key or default_key()),
        StopRequest(),
        partial(
            operator_device.open_device, now_ns=time.monotonic_ns, seed=side.trial.seed, made=made
        ),
    )
    for handle in handles:
        side.emit("truth", handle=handle.truth())
    side.finish(outcome)


def run_sim(
    trial_file: Path, overrides: list[str] | None, out: Path | None, *, as_json: bool
) -> None:
    """Run the simulated rig: a plant, and devices that exchange real bytes."""
    with (
        _side("sim", trial_file, overrides, out, as_json=as_json) as side,
        simulation_held(registry.reached_by(side.trial.rig)),
    ):
        _simulate(side, trial_file)


def _simulate(side: Side, trial_file: Path) -> None:
    """Run the simulated rig until it is asked to stop."""
    stop = StopRequest()
    trial = side.trial
    if trial.plant is None:
        raise AxisError(
            f"{trial_file}: has no section plant, so there is nothing to simulate"
            ": name a trial that has one"
        )
    rig = opening.open_rig(trial.rig, trial.plant, time.monotonic_ns, trial.seed)
    close_truth = publish_truth(rig, side.ring_folder)
    prepare_process(RIG_PRIORITY)
    side.emit("ready")
    rig.serve(stop)
    write_json(side.folder / TRUTH, rig.truth())
    close_truth()
    rig.close()
    side.finish({})


def run_side(
    trial: TrialConfig,
    trial_file: Path,
    name: str,
    *,
    folder: Path,
    ring_folder: Path,
    key: Path,
    others: Callable[[], None],
) -> None:
    """Run one side of a run, in a process of its own that ends with the one that started it.

    Both folders are the run's, and its recorder records; the slave is armed at once. Its
    modules are loaded while the others start; `others` waits for them, then it opens its axis.
    """
    end_with_parent()
    with emitting_problems(emit_to_parent):
        side = Side(trial, ring_folder, folder, emit_to_parent, None)
        if name == "slave":
            make_pipeline(trial)
            others()
            _serve(side, Configs(), Claim(), key, StopRequest(), arm=True)
        elif name == "master":
            _operate(side, trial_file, key)
        else:
            _simulate(side, trial_file)


def make_rig_safe(trial_file: Path, overrides: list[str] | None) -> None:
    """Stop the axis of a rig that no daemon runs, and take its devices out of operation."""
    rig = load_trial_file(trial_file, overrides).rig
    with new_ring_folder() as ring_folder, claimed(rig.name, registry.reached_by(rig), ring_folder):
        axis = opening.open_axis(rig, time.monotonic_ns)
        try:
            axis.configure()
            axis.stop()
        finally:
            axis.close()
    print(f"{rig.name}: stopped, and its devices taken out of operation")


@contextmanager
def _commanded(side: Side, claim: Claim) -> Iterator[None]:
    """Hold the rig and take commands, where this process was started alone."""
    if side.alone is None:
        yield
    else:
        rig = side.trial.rig
        with side.alone.commanded(claim, rig.name, registry.reached_by(rig)):
            yield


@contextmanager
def _side(
    name: str,
    trial_file: Path,
    overrides: list[str] | None,
    out: Path | None,
    key: Path | None = None,
    *,
    as_json: bool = False,
    trial: TrialConfig | None = None,
) -> Iterator[Side]:
    """Yield a side that is started alone; the trial is loaded, unless it is given.

    It makes its ring folder and run folder, and records itself. Problems are also reported as
    events.
    """
    emit: Emit = emit_to_parent if as_json else PlainEvents(name)
    with emitting_problems(emit):
        trial = trial or load_trial_file(trial_file, overrides)
        if name != "sim":
            _KEYS_OF[name](key or default_key())  # before the port, which only the trial knows
            _can_meet(trial, trial_file)
        with (
            new_folder(out, trial.name) as folder,
            alone(name, trial, trial_file, overrides or [], folder) as around,
        ):
            write_trial(folder, trial)
            yield Side(trial, around.ring_folder, folder, emit, around)
        if not as_json:
            print(f"files in {folder}", flush=True)


def _can_meet(trial: TrialConfig, trial_file: Path) -> None:
    """Raise LinkError where slave and master, started apart, could not find each other."""
    if trial.link.slave_port == 0:
        raise LinkError(
            f"{trial_file}: link.slave_port is 0, which only a run chooses by itself: give both "
            "sides the port at which the slave listens, such as --set link.slave_port=38211"
        )
