"""Targets of `scripts/campaign fuzz`: each damaged input must give an answer or a refusal."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import can
import numpy as np

from teleop_rt.axis import Sample
from teleop_rt.config_loader import load_trial
from teleop_rt.config_rig import RigConfig
from teleop_rt.errors import ExpectedError
from teleop_rt.link.channel import Endpoint, Role
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import MotionMessage, StateMessage
from teleop_rt.link.transport import Address, MemoryTransport
from teleop_rt.offline.load import load_any
from teleop_rt.offline.table import Table
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.section import Units
from teleop_rt.service.server import CommandServer
from teleop_rt.signals import SLAVE, SLAVE_TOPIC
from teleop_rt_dev.paths import CONFIG
from teleop_rt_dev.trial.files import plant_of
from teleop_rt_drivers import opening, registry
from teleop_rt_drivers.canopen import eds
from teleop_rt_drivers.framed.dbc import load_dbc
from teleop_rt_drivers.quantity import plausible_position

PACKAGE = Path(registry.__file__).parent
WORDS = [
    *(b"", b"0", b"-1", b"1e308", b"1e-320", b"nan", b".inf", b"null", b"[", b"{", b"&a [*a]"),
    *(b"*", b"!!python/object", b"\xff\xfe", b"\x00", b"9" * 400, b"\n\n", b": ", b"- "),
]

EDGES = [number.to_bytes(8, "little") for number in (0, 2**63 - 1, 2**63, 2**64 - 1024, 2**64 - 1)]
"""Whole numbers at the ends of their range: no random byte comes near them."""


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return the bytes with a few flipped, cut, doubled or replaced."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randint(0, len(changed))
        length = rng.choice((1, 2, 4, 16, 200))
        match rng.randint(0, 6):
            case 0 if at < len(changed):
                changed[at] ^= 1 << rng.randint(0, 7)
            case 1:
                del changed[at : at + length]
            case 2:
                changed[at:at] = changed[at : at + length]
            case 3:
                changed[at : at + rng.choice((0, length))] = rng.choice(WORDS)
            case 4:
                changed[at:at] = rng.randbytes(length)
            case 5:
                del changed[at + length * 50 :]
            case 6:
                changed[at : at + 8] = rng.choice(EDGES)
    return bytes(changed)


class Target:
    """One reader; `last` holds what it was given last."""

    def __init__(self, one: Callable[[bytes], object], seeds: list[bytes]) -> None:
        self._one = one
        self._seeds = seeds
        self.last = b""

    def warm_up(self) -> None:
        """Read what is whole once: importing what reads it is no case's time."""
        self._one(self._seeds[0])

    def run(self, rng: random.Random) -> None:
        """Read one damaged input; a refusal is an answer."""
        self.last = damaged(rng.choice(self._seeds), rng)
        try:
            self._one(self.last)
        except ExpectedError:
            return


def _noting(send: Callable[..., None], sent: list[bytes]) -> Callable[..., None]:
    """Return what sends and notes each packet."""

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
    """Requests at the control socket of a session without a loop."""
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


def bus(_folder: Path) -> Target:
    """Frames of any id and content, at an axis on CANopen that is armed."""
    trial = load_trial(
        CONFIG / "trials" / "silicone_cube.yaml", registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS
    )
    now = [10**9]
    assert isinstance(trial.rig, RigConfig)
    axis: Any = opening.open_lock_step(trial.rig, plant_of(trial), lambda: now[0], 1)[0]
    axis.configure()
    sample = Sample()
    wire = axis._bus

    def one(data: bytes) -> None:
        identifier = int.from_bytes(data[:2].ljust(2, b"\0"), "little") & 0x7FF
        wire.deliver(
            can.Message(
                arbitration_id=identifier,
                is_extended_id=bool(data[2:3] > b"\xe0"),
                is_error_frame=bool(data[3:4] > b"\xf0"),
                data=data[4:12],
            )
        )
        now[0] += 1_000_000
        axis.read_into(sample)
        axis.write(0.0)
        assert np.isfinite([sample.position, sample.force]).all()

    ids = (0x190, 0x1A0, 0x1B0, 0x080, 0x090, 0x710, 0x730, 0x000, 0x580)
    seeds = [one_id.to_bytes(2, "little") + bytes(10) for one_id in ids]
    return Target(one, seeds)


def _configured(name: str, now_ns: Callable[[], int]) -> tuple[RigConfig, Any]:
    """Return the simulated rig of a drive and its axis, configured on this clock."""
    trial = load_trial(
        CONFIG / "trials" / "silicone_cube.yaml",
        registry.AXIS_SCHEMAS,
        registry.PLANT_SCHEMAS,
        [f"rig=../rigs/simulated_{name}.yaml"],
    )
    axis = opening.open_lock_step(trial.rig, plant_of(trial), now_ns, 1)[0]
    axis.configure()
    return trial.rig, axis


def actuators(_folder: Path) -> Target:
    """Frames of any id and content, at every drive with a protocol of its maker, armed."""
    ends_of = []
    now = [10**9]
    for name in ("odrive", "damiao", "robstride", "moteus", "vesc"):
        rig, axis = _configured(name, lambda: now[0])
        bounds = plausible_position(rig)
        ends_of.append((axis, axis._parts[0][1]._ports[0].wire._bus, bounds))
    sample = Sample()

    def one(data: bytes) -> None:
        axis, wire, bounds = ends_of[data[0] % len(ends_of) if data else 0]
        wire.deliver(
            can.Message(
                arbitration_id=int.from_bytes(data[1:5].ljust(4, b"\0"), "little") & 0x1FFFFFFF,
                is_extended_id=True,
                is_fd=True,
                data=data[5:69],
            )
        )
        wire.deliver(
            can.Message(
                arbitration_id=int.from_bytes(data[1:3].ljust(2, b"\0"), "little") & 0x7FF,
                is_extended_id=False,
                data=data[5:13],
            )
        )
        now[0] += 1_000_000
        axis.read_into(sample)
        axis.write(0.0)
        assert bounds.lower <= sample.position <= bounds.upper
        assert np.isfinite([sample.position, sample.force]).all()

    ids = ((0, 0x61), (0, 0x69), (0, 0x74), (1, 0x11), (2, 0x02807FFD), (3, 0x100),
           (4, 0x917), (4, 0x1017))  # fmt: skip
    seeds = [
        bytes((drive,)) + frame_id.to_bytes(4, "little") + bytes(24) for drive, frame_id in ids
    ]
    return Target(one, seeds)


def lines(_folder: Path) -> Target:
    """Bytes of any content, at every servo on a serial line, armed."""
    ends_of = []
    now = [10**9]
    for name in ("dynamixel", "feetech"):
        rig, axis = _configured(name, lambda: now[0])
        line = axis._parts[0][1]._ports[0].wire._stream
        ends_of.append((axis, line, plausible_position(rig)))
    sample = Sample()

    def one(data: bytes) -> None:
        axis, line, bounds = ends_of[data[0] % len(ends_of) if data else 0]
        line._arrived += data[1:]
        now[0] += 2_000_000
        axis.read_into(sample)
        axis.write(0.0)
        assert bounds.lower <= sample.position <= bounds.upper
        assert np.isfinite([sample.position, sample.force]).all()

    packets = [bytes.fromhex("FFFFFD00011300550005010003000000000000000000000000000000")]
    packets.append(bytes.fromhex("FFFF012100") + b"\x01" + bytes(30) + b"\xdc")
    return Target(one, [bytes((drive,)) + packet for drive, packet in enumerate(packets)])


TARGETS: dict[str, Callable[[Path], Target]] = {
    "link": link, "control": control, "yaml": yaml, "recording": recording, "eds": eds_file,
    "dbc": dbc_file, "bus": bus, "actuators": actuators, "lines": lines,
}  # fmt: skip
