"""The master's cycle with an operator's device, the link over real sockets, on simulated time.

The link's packets are taken in ahead of the cycle, and the wall of a model among them is made, as
in a real loop's clock. The device, its plant and the slave are in the same process; the time of all
these is left out.
"""

from __future__ import annotations

import json
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.config.trial import TrialConfig
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.keys import KEY_BYTES, shared_key
from teleop_rt.link.transport import UdpTransport
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt.trial.master_side import MasterSide
from teleop_rt.trial.sides import make_endpoint
from teleop_rt_dev.bench.measure import Row, quantiles, row, take_all_cores
from teleop_rt_dev.bench.rig_beside import LOOP_CPU
from teleop_rt_dev.paths import TRIALS
from teleop_rt_drivers.simulated.canopen_network import CanopenNetwork

TRIAL = TRIALS / "handle.yaml"
TICKS, WARM_UP = 4000, 1000
AIMS = {"p50": "<= 60", "p99": "<= 120"}
LINK = ("link.loss=0.0", "link.round_trip_ms=0.0", "link.jitter_ms=0.0")


def run(rounds: int) -> list[Row]:
    """Measure in a process of its own; a third of the rounds suffices."""
    take_all_cores()
    taken = [_measured() for _ in range(max(1, rounds // 5))]
    name = "master with a device on CANopen, work"
    return [
        row(f"{name} {key}", "us", [one[key] for one in taken], AIMS.get(key)) for key in taken[0]
    ]


def _measured() -> dict[str, float]:
    itself = [sys.executable, "-m", __name__]
    done = subprocess.run(itself, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def udp_link(trial: TrialConfig, now_ns: Callable[[], int]) -> tuple[Endpoint, Endpoint]:
    """Return the ends of slave and master on this machine's loopback."""
    host, port = "127.0.0.1", 20000 + secrets.randbelow(10000)
    keys = shared_key(bytes(KEY_BYTES))
    slave = UdpTransport(host, port, (host, port + 1))
    master = UdpTransport(host, port + 1, (host, port))
    return (
        make_endpoint("slave", trial, slave, keys, now_ns),
        make_endpoint("master", trial, master, keys, now_ns),
    )


class Devices:
    """How long the simulated devices took so far."""

    spent_ns = 0

    def timed(self, process: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the function that lets a network of devices answer, timed."""

        def answer(network: CanopenNetwork) -> None:
            started_ns = time.perf_counter_ns()
            process(network)
            self.spent_ns += time.perf_counter_ns() - started_ns

        return answer


def measure() -> dict[str, float]:
    """Return quantiles of the work of a tick [us], the slave being armed and the link standing."""
    devices, work, cycle = Devices(), [], MasterSide.cycle

    def timed(side: MasterSide) -> None:
        side.master.take_ahead()
        elsewhere_ns, started_ns = devices.spent_ns, time.perf_counter_ns()
        cycle(side)
        taken_ns = time.perf_counter_ns() - started_ns
        work.append((taken_ns - (devices.spent_ns - elsewhere_ns)) * 1e-3)

    answers = devices.timed(CanopenNetwork.process)
    with (
        tempfile.TemporaryDirectory() as ring_folder,
        patch.object(MasterSide, "cycle", timed),
        patch.object(CanopenNetwork, "process", answers),
    ):
        trial = load_trial_file(TRIAL, list(LINK))
        world = LockstepTrial(trial, TRIAL.parent, open_bench, Path(ring_folder), udp_link)
        world.slave.configure()
        prepare_process(60, LOOP_CPU)
        while len(work) < WARM_UP + TICKS:
            world.step()
        if not world.slave.safety.powered:
            raise RuntimeError(f"the slave has stopped: {world.slave.safety.fault.cause}")
    return quantiles(work[WARM_UP:])


if __name__ == "__main__":
    print(json.dumps(measure()))
