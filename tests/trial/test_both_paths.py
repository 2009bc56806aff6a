"""The same trial over in-process objects and over real sockets gives the same frames."""

import can
import numpy as np

from teleop_rt.link.keys import shared_key
from teleop_rt.link.transport import UdpTransport
from teleop_rt.realtime.ring import RingReader
from teleop_rt.trial.bench import Bench
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt.trial.sides import make_endpoint
from teleop_rt_dev.trial.files import SILICONE, silicone
from teleop_rt_drivers import opening
from teleop_rt_drivers.bus import MulticastBus
from teleop_rt_drivers.simulated.synchronous_bus import synchronous_pair

TICKS = 2500
PORT = 41977


class Tap(can.BusABC):
    """A bus that notes every frame that passes, and lets the other end answer."""

    def __init__(self, inner, notes, answer=None):
        self.inner, self.notes, self.answer = inner, notes, answer
        self._is_shutdown = True

    def send(self, msg, timeout=None):
        self.notes.append(("to rig", msg.arbitration_id, bytes(msg.data)))
        self.inner.send(msg)
        if self.answer:
            self.answer()

    def recv(self, timeout=None):
        message = self.inner.recv(timeout)
        if message is not None:
            self.notes.append(("to daemon", message.arbitration_id, bytes(message.data)))
        return message

    def shutdown(self):
        self.inner.shutdown()


def run(trial, open_bench, ring_folder, link=None):
    """Step a trial by hand; returns the rows of both sides."""
    ring_folder.mkdir()
    stepped = LockstepTrial(trial, SILICONE.parent, open_bench, ring_folder, link)
    readers = {name: RingReader(ring_folder / f"{name}.ring") for name in ("slave", "master")}
    stepped.slave.configure()
    for _ in range(TICKS):
        stepped.step()
    stepped.bench.axis.close()
    stepped.slave_endpoint.close()
    stepped.master_endpoint.close()
    return {name: reader.read() for name, reader in readers.items()}


def test_lock_step_and_sockets_agree_frame_by_frame(tmp_path):
    trial = silicone("link.round_trip_ms=0", "link.jitter_ms=0", "link.loss=0")
    frames = {"lock-step": [], "sockets": []}

    def lock_step(trial, now_ns):
        daemon, devices = synchronous_pair()
        rig = opening.open_rig(trial.rig, trial.plant, now_ns, trial.seed, bus=devices)
        devices.on_arrival = rig.process
        rig.power_on()
        bus = Tap(daemon, frames["lock-step"])
        return Bench(opening.open_axis(trial.rig, now_ns, bus=bus))

    def sockets(trial, now_ns):
        daemon, devices = (MulticastBus("239.74.163.2", PORT) for _ in range(2))
        rig = opening.open_rig(trial.rig, trial.plant, now_ns, trial.seed, bus=devices)
        rigs.append(rig)
        bus = Tap(daemon, frames["sockets"], answer=rig.process)
        rig.power_on()
        return Bench(opening.open_axis(trial.rig, now_ns, bus=bus))

    def udp(trial, now_ns):
        slave = UdpTransport()
        master = UdpTransport(peer=("127.0.0.1", slave.port))
        return tuple(
            make_endpoint(role, trial, transport, shared_key(bytes(32)), now_ns)
            for role, transport in (("slave", slave), ("master", master))
        )

    rigs = []
    one = run(trial, lock_step, tmp_path / "a")
    other = run(trial, sockets, tmp_path / "b", udp)
    rigs[0].close()
    assert len(frames["lock-step"]) > 5 * TICKS
    assert frames["lock-step"] == frames["sockets"]
    for name, rows in one.items():
        assert rows.shape == other[name].shape == (TICKS, rows.shape[1])
        assert np.array_equal(rows, other[name], equal_nan=True)
