"""A slave in this process on the machine's clock, its simulated rig and its master beside it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from teleop_rt.axis import Axis
from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.link.keys import generate_key, load_keys
from teleop_rt.link.transport import UdpTransport
from teleop_rt.realtime.clock import RealClock
from teleop_rt.realtime.scheduling import keep_off
from teleop_rt.slave.slave import Slave
from teleop_rt.trial.process_main import loop_clock
from teleop_rt.trial.sides import make_endpoint, make_slave
from teleop_rt_dev.paths import SILICONE
from teleop_rt_drivers import opening, registry

LOOP_CPU = (os.cpu_count() or 1) - 1
"""The core that the slave of a bench has for itself, as `realtime.cpu` gives it one."""
WHOLE_BANK = (
    'estimation.regressions=[direct, algebraic]',
    'estimation.solvers=[rls, sprls, ni-sprls, gn-vff-rls, iec]',
    'estimation.models=[kelvin-voigt, mass-spring-damper, hunt-crossley]',
)  # fmt: skip


def _start(name: str, *words: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-m", "teleop_rt", name, str(SILICONE), *words, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    keep_off(process.pid, LOOP_CPU)
    assert process.stdout is not None
    for line in process.stdout:
        if json.loads(line)["event"] == "ready":
            return process
    raise RuntimeError(f"{name} did not start")


@contextmanager
def rig_alone(rig: str) -> Iterator[tuple[Axis, int]]:
    """Give a configured axis on a simulated rig of this kind, and the number of its process."""
    sets = [f"rig=../rigs/simulated_{rig}.yaml"]
    sets += registry.own_run(load_trial_file(SILICONE, sets).rig)
    trial = load_trial_file(SILICONE, sets)
    words = [word for one in sets for word in ("--set", one)]
    with tempfile.TemporaryDirectory() as name:
        side = _start("sim", *words, "--out", name)
        axis = opening.open_axis(trial.rig, time.monotonic_ns)
        try:
            axis.configure()
            yield axis, side.pid
        finally:
            axis.close()
            side.terminate()
            side.communicate()


@contextmanager
def slave_on(
    rig: str, rate_hz: int, *changes: str, master: bool = True
) -> Iterator[tuple[Slave, Callable[[], RealClock]]]:
    """Give a configured slave on a simulated rig of this kind, not armed yet, and its clocks.

    A clock begins when it is made; as a daemon's it notes arrivals where stamps are paired.
    """
    sets = [f"rig=../rigs/simulated_{rig}.yaml", f"rig.rate_hz={rate_hz}", *changes]
    sets += ["link.slave_port=38211", "link.master_port=38212"]
    # The bad network is simulated where it is sent: no part of a real slave's tick.
    sets += ["link.loss=0.0", "link.round_trip_ms=0.0", "link.jitter_ms=0.0"]
    trial = load_trial_file(SILICONE, sets)
    sets += registry.own_run(trial.rig)
    trial = load_trial_file(SILICONE, sets)
    words = [word for one in sets for word in ("--set", one)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        generate_key(folder / "key")
        ring_folder = folder / "rings"
        ring_folder.mkdir()
        sides = [_start("sim", *words, "--out", str(folder / "sim"))]
        if master:
            key = ["--key", str(folder / "key"), "--out", str(folder / "master")]
            sides.append(_start("master", *words, *key))
        link = trial.link
        transport = UdpTransport("127.0.0.1", link.slave_port, ("127.0.0.1", link.master_port))
        axis = opening.open_axis(trial.rig, time.monotonic_ns)
        try:
            endpoint = make_endpoint(
                "slave", trial, transport, load_keys(folder / "key"), time.monotonic_ns,
            )  # fmt: skip
            slave = make_slave(
                trial, axis, endpoint, time.monotonic_ns, ring_folder, measure_work=True
            )
            slave.configure()
            yield slave, partial(loop_clock, trial.rig, axis, endpoint)
        finally:
            axis.stop()
            axis.close()
            transport.close()
            for process in reversed(sides):
                process.terminate()
                process.communicate()
