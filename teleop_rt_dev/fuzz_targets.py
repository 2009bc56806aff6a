"""Targets of `scripts/campaign fuzz`: each damaged input must give an answer or a refusal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np

from teleop_rt.config.loader import load_trial
from teleop_rt.config.section import Units
from teleop_rt.link.channel import Endpoint, Role
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import MotionMessage, StateMessage
from teleop_rt.link.transport import Address, MemoryTransport
from teleop_rt.offline.load import load_any
from teleop_rt.offline.table import Table
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.service.server import CommandServer
from teleop_rt.signals import SLAVE, SLAVE_TOPIC
from teleop_rt_dev.fuzz_damage import Target
from teleop_rt_dev.fuzz_devices import actuators, bus, lines
from teleop_rt_dev.paths import CONFIG
from teleop_rt_drivers import registry
from teleop_rt_drivers.canopen import eds
from teleop_rt_drivers.framed.dbc import load_dbc

PACKAGE = Path(registry.__file__).parent


def _noting(send: Callable[..., None], sent: list[bytes]) -> Callable[..., None]:
    """Return the function that sends and notes each packet."""

    def noted(packet: bytes, to: Address | None = None) -> None:
        sent.append(packet)
        send(packet, to)

    return noted


def link(_folder: Path) -> Target:
    """Both ends, in a session, given packets of either."""
    near, far = MemoryTransport.pair()
    now = [10**12]
    ends = [
        Endpoint(role, wire, shared_key(bytes(range(32))), lambda: now[0], rate_hz=1000)
        for role, wire in zip(get_args(Role), (near, far), strict=True)
    ]
    sent: list[bytes] = []
    for wire in (near, far):
        setattr(wire, "send", _noting(wire.send, sent))

    def talk() -> None:
        now[0] += 1_000_000
        ends[0].send(MotionMessage(0.1, 0.0, 0, engaged=True))
        ends[1].send(StateMessage(0.1, 0.0, 0, in_contact=False))
        for end in ends:
            end.poll()

    for _ in range(20):
        talk()
    seeds = list(sent)

    def one(packet: bytes) -> None:
        near._incoming.append(packet)
        far._incoming.append(packet)
        talk()
        del sent[:]
        assert ends[1].motion == MotionMessage(0.1, 0.0, 0, engaged=True)

    return Target(one, seeds)


def control(folder: Path) -> Target:
    """Requests at the control socket of a ring folder without a loop."""
    server = CommandServer(folder)
    seeds = [b'{"command": "%s"}' % name for name in (b"stop", b"arm", b"status", b"reload")]

    def one(request: bytes) -> None:
        for _ in server.handle(request.partition(b"\n")[0]):
            return

    return Target(one, seeds)


def yaml(folder: Path) -> Target:
    """Trials and rigs."""
    names = ("silicone_cube", "stiffening_foam")
    rigs = ("simulated_canopen", "simulated_serial", "simulated_raw_can")
    seeds = [(CONFIG / "trials" / f"{name}.yaml").read_bytes() for name in names]
    (folder / "rigs").mkdir()
    (folder / "trials").mkdir()
    whole = {name: (CONFIG / "rigs" / f"{name}.yaml").read_bytes() for name in rigs}
    for name, text in whole.items():
        (folder / "rigs" / f"{name}.yaml").write_bytes(text)
    trial = folder / "trials" / "trial.yaml"

    def one(data: bytes) -> None:
        is_rig = b"\naxis:" in data
        trial.write_bytes(seeds[0] if is_rig else data)
        if is_rig:
            (folder / "rigs" / "simulated_canopen.yaml").write_bytes(data)
        load_trial(trial, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS)

    return Target(one, [*seeds, *whole.values()])


def recording(folder: Path) -> Target:
    """Tables and recordings of our own."""
    time_s = np.arange(400) * 1e-3
    position = 0.01 * np.sin(20 * time_s)
    force = np.maximum(0.0, 3600 * position)
    csv = "t_s,x_m,f_N\n" + "\n".join(
        f"{t:.4f},{x:.6f},{f:.3f}" for t, x, f in zip(time_s, position, force, strict=True)
    )
    npz = folder / "seed.npz"
    np.savez_compressed(npz, t_s=time_s, x_m=position, f_N=force)
    ours = folder / "seed.mcap"
    writer = RecordingWriter(ours, Units(position="m", force="N"))
    writer.add_topic(SLAVE_TOPIC, SLAVE)
    writer.write_rows(SLAVE_TOPIC, np.tile(np.arange(1.0, len(SLAVE) + 1), (50, 1)))
    writer.close()
    kinds = {b"PK": ".npz", b"\x89M": ".mcap"}

    def one(data: bytes) -> None:
        file = folder / f"damaged{kinds.get(data[:2], '.csv')}"
        file.write_bytes(data)
        if file.suffix == ".mcap":
            read_topics(file, [SLAVE_TOPIC])
        load_any(file, Table({}, {}, None))

    return Target(one, [csv.encode(), npz.read_bytes(), ours.read_bytes()])


def eds_file(folder: Path) -> Target:
    """Electronic data sheets."""
    file = folder / "device.eds"

    def one(data: bytes) -> None:
        file.write_bytes(data)
        eds.load(str(file), 16)

    return Target(one, [path.read_bytes() for path in sorted((PACKAGE / "eds").glob("*.eds"))])


def dbc_file(folder: Path) -> Target:
    """Descriptions of CAN messages."""
    file = folder / "bus.dbc"

    def one(data: bytes) -> None:
        file.write_bytes(data)
        load_dbc(str(file))

    return Target(one, [path.read_bytes() for path in sorted((PACKAGE / "dbc").glob("*.dbc"))])


TARGETS: dict[str, Callable[[Path], Target]] = {
    "link": link, "control": control, "yaml": yaml, "recording": recording, "eds": eds_file,
    "dbc": dbc_file, "bus": bus, "actuators": actuators, "lines": lines,
}  # fmt: skip
