"""The command line, and the only place that wires the core and the drivers together."""

from __future__ import annotations

import json
import socket
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from teleop_rt.axis import Axis, AxisError
from teleop_rt.config import TrialConfig
from teleop_rt.config_loader import load_trial
from teleop_rt.config_rig import RigConfig
from teleop_rt.contact.effects.user import EffectError
from teleop_rt.contact.fitted import ExtendedModelError
from teleop_rt.errors import RecordingError
from teleop_rt.link.security import KeyFileError, default_key, generate_key, load_key
from teleop_rt.link.transport import LinkError
from teleop_rt.master.recorded import OperatorError
from teleop_rt.offline import commands
from teleop_rt.offline.closing_command import close_loop_command
from teleop_rt.realtime.loop import Interrupts, StopRequest
from teleop_rt.realtime.parent import Tell, end_with_parent, tell_parent
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.realtime.session import new_session, publish
from teleop_rt.service import commands as service_commands
from teleop_rt.service.client import DaemonError
from teleop_rt.service.place import BusyError, claimed
from teleop_rt.signals import TRUTH
from teleop_rt.study.chapter4_wiring import Wiring
from teleop_rt.study.commands import app as study_app
from teleop_rt.terminal import pipe_that_may_close
from teleop_rt.trial.alone import Alone, PlainTelling, alone
from teleop_rt.trial.estimators import trial_extension
from teleop_rt.trial.folder import (
    RECORDING,
    TRIAL,
    FolderError,
    new_folder,
    plain_json,
    write_json,
    write_trial,
)
from teleop_rt.trial.folder import TRUTH as TRUTH_FILE
from teleop_rt.trial.lockstep_run import Bench, run_lockstep
from teleop_rt.trial.process_main import (
    RIG_PRIORITY,
    master_main,
    recorder_main,
    slave_main,
)
from teleop_rt.trial.processes import ProcessFailedError
from teleop_rt.trial.rebuild import rebuilt_summary
from teleop_rt.trial.run_processes import run_processes
from teleop_rt.trial.summary import summarise
from teleop_rt.trial.table import print_summary
from teleop_rt.view.terminal import RunView
from teleop_rt.yaml_file import ConfigError
from teleop_rt_drivers import commands as device_commands
from teleop_rt_drivers import registry
from teleop_rt_drivers.simulated.reference import environment_force

DONE, FAULT, BAD_INPUT = 0, 1, 2
TRUTH_TOPIC = "/truth/plant"
_EXPECTED = (
    ConfigError,
    AxisError,
    LinkError,
    KeyFileError,
    FolderError,
    RecordingError,
    OperatorError,
    BusyError,
    DaemonError,
    EffectError,
    ExtendedModelError,
)

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Real-time controller for 1-DOF model-mediated teleoperation.",
)


for offline_command in (commands.replay, commands.diagnose, commands.recover, commands.export):
    app.command()(offline_command)
for service_command in service_commands.COMMANDS:
    app.command()(service_command)
for device_command in (device_commands.check, device_commands.doctor):
    app.command()(device_command)


class ClockName(StrEnum):
    """Which clock a run uses."""

    REAL = "real"
    SIMULATED = "simulated"


TrialFile = Annotated[Path, typer.Argument(help="the trial, a YAML file")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY.PATH=VALUE", help="override any key of the trial or rig"),
]
SessionFolder = Annotated[Path | None, typer.Option("--session", hidden=True)]
OutFolder = Annotated[Path | None, typer.Option("--out", help="folder to write; must be empty")]
OptionalKeyFile = Annotated[
    Path | None,
    typer.Option("--key", help="key file, as `keygen` makes it; a service has its credential"),
]
JsonLines = Annotated[bool, typer.Option("--json", help="tell events as lines of JSON")]
LivePort = Annotated[
    int, typer.Option("--port", min=0, max=65535, help="TCP port of the page; 0 for any")
]


def main() -> None:
    """Run the command line; every expected error becomes one message and an exit code."""
    try:
        with pipe_that_may_close():
            app()
    except _EXPECTED as error:
        print(error, file=sys.stderr)
        sys.exit(BAD_INPUT)
    except ProcessFailedError as error:
        print(error, file=sys.stderr)
        sys.exit(error.code)


@app.command()
def run(
    trial_file: TrialFile,
    clock: Annotated[ClockName, typer.Option(help="real or simulated time")] = ClockName.REAL,
    duration: Annotated[float | None, typer.Option(help="seconds, instead of the trial's")] = None,
    seed: Annotated[int | None, typer.Option(help="instead of the trial's")] = None,
    out: Annotated[Path | None, typer.Option(help="folder to write; must be empty")] = None,
    overrides: Overrides = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the summary as JSON")] = False,
    live_page: Annotated[
        bool, typer.Option("--live", help="show it in a browser as it goes (extra live)")
    ] = False,
    port: LivePort = 5006,
) -> None:
    """Run a whole trial: rig, slave, master and recorder, then the summary."""
    changes = list(overrides or [])
    changes += [f"duration_s={float(duration)!r}"] if duration is not None else []
    changes += [f"seed={seed}"] if seed is not None else []
    trial = load_trial_file(trial_file, changes)
    if clock == ClockName.REAL:
        changes += _free_ports(trial)
        trial = load_trial_file(trial_file, changes)
    try:
        with _live_beside(port) if live_page else nullcontext():
            folder, summary, failure = _run(trial, trial_file, changes, clock, out)
    except KeyboardInterrupt:
        print("interrupted before the trial began", file=sys.stderr)
        raise typer.Exit(FAULT) from None
    if as_json:
        print(json.dumps(plain_json(summary)))
    else:
        console = Console()
        print_summary(console, summary, trial.rig.units)
        console.print(f"files in {folder}", highlight=False)
    _finish(summary, failure)


def _run(
    trial: TrialConfig, trial_file: Path, changes: list[str], clock: ClockName, out: Path | None
) -> tuple[Path, dict[str, Any], ProcessFailedError | None]:
    """Run the trial into a new folder; return folder, summary, and the process that failed."""
    with Interrupts() as interrupts, new_folder(out, trial.name) as folder:
        write_trial(folder, trial)
        failure: ProcessFailedError | None = None
        with RunView(Console(stderr=True), trial.name, trial.duration_s) as progress:
            if clock == ClockName.SIMULATED:
                outcome = run_lockstep(
                    trial, trial_file, partial(open_bench, folder=folder), folder, progress
                )
            else:
                reached_by = registry.reached_by(trial.rig)
                outcome, failure = run_processes(
                    trial, trial_file, changes, folder, progress, reached_by
                )
        interrupts.ignore()
        reference = environment_force if trial.plant is not None else None
        summary = summarise(folder, trial, outcome, reference)
        try:
            write_json(folder / "summary.json", summary)
            _report(folder, summary)
        except OSError as error:
            message = f"{folder}: summary and report cannot be written: {error.strerror}"
            failure = failure or ProcessFailedError(message, FAULT)
    return folder, summary, failure


def _report(folder: Path, summary: dict[str, Any]) -> None:
    """Write report.html where the extra `report` is installed and a tick was recorded."""
    try:
        from teleop_rt.view.commands import report_of_run  # noqa: PLC0415 - an extra may be absent
    except ImportError:
        print("no report.html: pip install 'teleop-rt[report]' adds it", file=sys.stderr)
        return
    report_of_run(folder, plain_json(summary))


def _stop_on_fault(safety: dict[str, Any]) -> None:
    """Leave with the exit code of a fault, after saying what it is, if there was one."""
    fault = safety["fault"]
    if fault["code"] != 0:
        print(f"stopped: {fault['cause']}; {fault['next_step']}", file=sys.stderr)
        raise typer.Exit(FAULT)


def _finish(summary: dict[str, Any], failure: ProcessFailedError | None) -> None:
    """Leave with the exit code of the run, after saying what went wrong."""
    if failure is not None:
        print(failure, file=sys.stderr)
        raise typer.Exit(failure.code)
    _stop_on_fault(summary["safety"])


def _run_in(trial_file: Path, changes: list[str], clock: str, folder: Path) -> Mapping[str, Any]:
    """Run a trial of its own into a folder; return its summary, or leave on a fault."""
    trial = load_trial_file(trial_file, changes)
    if clock == ClockName.REAL:
        changes = [*changes, *_free_ports(trial)]
        trial = load_trial_file(trial_file, changes)
    _, summary, failure = _run(trial, trial_file, changes, ClockName(clock), folder)
    _finish(summary, failure)
    return summary


@app.command()
def report(
    folders: Annotated[list[Path], typer.Argument(help="run folder; two with --compare")],
    compare: Annotated[
        bool, typer.Option("--compare", help="set two runs side by side, on one page")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", help="the page of a comparison")] = None,
) -> None:
    """Write the report of a run from its folder, also of a run that ended badly."""
    try:
        from teleop_rt.view.commands import (  # noqa: PLC0415 - an extra may be absent
            compare_folders,
            report_of_folder,
        )
    except ImportError:
        raise RecordingError("no report: pip install 'teleop-rt[report]' adds it") from None
    if len(folders) != (2 if compare else 1):
        raise RecordingError("give one run folder, or two after --compare")
    if compare:
        print(compare_folders(folders, out, _rebuilt))
    else:
        print(report_of_folder(folders[0], _rebuilt))


def _rebuilt(folder: Path, slave: Mapping[str, Any]) -> dict[str, Any]:
    """Return the summary of a run that could not write its own."""
    trial = load_trial_file(folder / TRIAL, None)
    reference = environment_force if trial.plant is not None else None
    return rebuilt_summary(folder, trial, slave, reference)


@app.command()
def live(
    recording: Annotated[
        Path | None, typer.Argument(help="play back a recording or run folder, instead")
    ] = None,
    port: LivePort = 5006,
    host: Annotated[
        str, typer.Option(help="address to serve at; by default this machine alone may look")
    ] = "127.0.0.1",
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="serve Foxglove's WebSocket protocol, instead")
    ] = False,
    beside: Annotated[int | None, typer.Option("--beside", hidden=True)] = None,
) -> None:
    """Show what runs on this machine, or a recording, in a browser; it controls nothing."""
    if foxglove:
        with _extra("foxglove"):
            from teleop_rt.view.live.foxglove import bridge_to_foxglove  # noqa: PLC0415
        bridge_to_foxglove(recording, host, port)
        return
    with _extra("live"):
        from teleop_rt.view.live.commands import live as serve  # noqa: PLC0415 - an extra
    serve(recording, beside, host, port)


def _live_beside(port: int) -> AbstractContextManager[None]:
    """Return the live page of this process's run, served as long as it runs."""
    with _extra("live"):
        from teleop_rt.view.live.commands import live_beside  # noqa: PLC0415 - an extra
    return live_beside(port)


@contextmanager
def _extra(name: str) -> Iterator[None]:
    try:
        yield
    except ImportError:
        message = f"needs an extra: pip install 'teleop-rt[{name}]' adds it"
        raise RecordingError(message) from None


@app.command()
def slave(
    trial_file: TrialFile,
    key: OptionalKeyFile = None,
    overrides: Overrides = None,
    out: OutFolder = None,
    arm: Annotated[
        bool, typer.Option("--arm", help="arm and start at once, for the trial's duration only")
    ] = False,
    as_json: JsonLines = False,
    session: SessionFolder = None,
) -> None:
    """Run the slave daemon next to the rig; `start`, `stop`, `arm` and `status` talk to it."""
    should_stop = StopRequest()
    again, rounds = True, 0
    while again:
        rounds += 1
        folder = out if out is None or rounds == 1 else out.with_name(f"{out.name}-{rounds}")
        with _side("slave", trial_file, overrides, folder, session, as_json=as_json) as side:
            trial = side.trial

            def open_axis(now_ns: Callable[[], int], rig: RigConfig = trial.rig) -> Axis:
                return registry.open_axis(rig, now_ns)

            with registry.logged(trial.rig, side.folder), side.commanded():
                end = slave_main(
                    trial,
                    open_axis,
                    load_key(key or default_key()),
                    side.session,
                    should_stop,
                    side.tell,
                    arm=arm,
                    alone=side.alone,
                )
            side.finish(end.outcome)
        again = end.again
    if session is None:
        _stop_on_fault(end.outcome["safety"])


@app.command()
def master(
    trial_file: TrialFile,
    key: OptionalKeyFile = None,
    overrides: Overrides = None,
    out: OutFolder = None,
    as_json: JsonLines = False,
    session: SessionFolder = None,
) -> None:
    """Run the master next to the operator."""
    with _side("master", trial_file, overrides, out, session, as_json=as_json) as side:
        if side.trial.link.slave_port == 0:
            raise LinkError(
                "link.slave_port is 0: say at which port of link.host the slave listens"
            )
        outcome = master_main(
            side.trial,
            trial_file.parent,
            load_key(key or default_key()),
            side.session,
            StopRequest(),
            side.tell,
            partial(registry.open_device, now_ns=time.monotonic_ns, seed=side.trial.seed),
        )
        side.finish(outcome)


@app.command()
def sim(
    trial_file: TrialFile,
    overrides: Overrides = None,
    out: OutFolder = None,
    as_json: JsonLines = False,
    session: SessionFolder = None,
) -> None:
    """Run the simulated rig: a plant behind devices that speak real bytes."""
    with _side("sim", trial_file, overrides, out, session, as_json=as_json) as side:
        stop = StopRequest()
        trial = side.trial
        if trial.plant is None:
            raise AxisError(f"{trial_file}: has no section plant, so there is nothing to simulate")
        rig = registry.open_rig(trial.rig, trial.plant, time.monotonic_ns, trial.seed)
        ring = publish(side.session, TRUTH_TOPIC, TRUTH)
        rig.on_truth = lambda: ring.push(rig.truth_row)
        prepare_process(RIG_PRIORITY)
        side.tell("ready")
        rig.serve(stop)
        write_json(side.folder / TRUTH_FILE, rig.truth())
        ring.close()
        rig.close()
        side.finish({})


@app.command(hidden=True)
def recorder(
    trial_file: TrialFile,
    session: Annotated[Path, typer.Option()],
    out: Annotated[Path, typer.Option()],
    overrides: Overrides = None,
) -> None:
    """Record the rings of a session."""
    with _side("recorder", trial_file, overrides, out, session) as side:
        done = recorder_main(
            side.trial, side.session, side.folder / RECORDING, StopRequest(), side.tell
        )
        side.finish(done)


@app.command()
def make_safe(trial_file: TrialFile, overrides: Overrides = None) -> None:
    """Stop the axis of a rig that no daemon runs: what systemd calls after a daemon has ended."""
    rig = load_trial_file(trial_file, overrides).rig
    with new_session() as session, claimed(rig.name, registry.reached_by(rig), session):
        axis = registry.open_axis(rig, time.monotonic_ns)
        try:
            axis.configure()
            axis.stop()
        finally:
            axis.close()
    print(f"{rig.name}: stopped, and its devices taken out of operation")


@app.command()
def keygen(
    path: Annotated[Path, typer.Argument(help="file to make, readable by you alone")],
) -> None:
    """Make a key for the link; both sides need the same."""
    generate_key(path)


@dataclass(slots=True)
class _Side:
    """One process of a trial: its config, its session for rings, its folder, how it tells."""

    trial: TrialConfig
    session: Path
    folder: Path
    tell: Tell
    alone: Alone | None

    @contextmanager
    def commanded(self) -> Iterator[None]:
        """Hold the rig and take commands, where this process was started alone."""
        if self.alone is None:
            yield
        else:
            rig = self.trial.rig
            with self.alone.commanded(rig.name, registry.reached_by(rig)):
                yield

    def finish(self, outcome: dict[str, Any]) -> None:
        """Tell what came out; alone, also write it as a summary."""
        if self.alone is not None:
            self.alone.finish(outcome)
        self.tell("done", **outcome)


@contextmanager
def _side(
    name: str,
    trial_file: Path,
    overrides: list[str] | None,
    out: Path | None,
    session: Path | None,
    *,
    as_json: bool = False,
) -> Iterator[_Side]:
    """Give one process of a trial what it needs.

    Within a run session and folder are the run's, and the process ends with it. A process that is
    started alone makes its own, and records itself. What goes wrong is told as an event, too.
    """
    within_a_run = session is not None
    tell: Tell = tell_parent if within_a_run or as_json else PlainTelling(name)
    try:
        trial = load_trial_file(trial_file, overrides)
        if session is not None and out is not None:
            end_with_parent()
            yield _Side(trial, session, out, tell, None)
        else:
            with (
                new_folder(out, trial.name) as folder,
                alone(trial_file, overrides or [], folder) as around,
            ):
                write_trial(folder, trial)
                yield _Side(trial, around.session, folder, tell, around)
    except _EXPECTED as error:
        tell("problem", message=str(error))
        raise
    except Exception as error:
        tell("problem", message=f"{type(error).__name__}: {error}")
        raise


def load_trial_file(trial_file: Path, overrides: list[str] | None) -> TrialConfig:
    """Load a trial with the schemas of all drivers. Raises ConfigError."""
    trial = load_trial(trial_file, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, overrides or ())
    trial_extension(trial)
    return trial


def open_bench(trial: TrialConfig, now_ns: Callable[[], int], folder: Path | None = None) -> Bench:
    """Open the axis of a trial on simulated time, with its simulator where it has one.

    Buses that ask for it are logged into the folder.
    """
    device = partial(registry.open_device, now_ns=now_ns, seed=trial.seed)
    if trial.plant is None:
        return Bench(registry.open_axis(trial.rig, now_ns), open_device=device)
    axis, rig = registry.open_lock_step(trial.rig, trial.plant, now_ns, trial.seed, folder)

    def publish_truth(session: Path) -> None:
        ring = publish(session, TRUTH_TOPIC, TRUTH)
        rig.on_truth = lambda: ring.push(rig.truth_row)

    return Bench(axis, rig.truth, publish_truth, device)


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
    return changes + registry.own_run(trial.rig)


app.add_typer(
    study_app, name="study", context_settings={"obj": Wiring(load_trial_file, open_bench)}
)
app.command("close-loop")(close_loop_command(load_trial_file, _run_in))
