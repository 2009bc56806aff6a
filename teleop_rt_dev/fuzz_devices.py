"""Devices as targets of `scripts/campaign fuzz`: frames and bytes of any content, at armed axes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import numpy as np

from teleop_rt.axis import Sample
from teleop_rt.config.loader import load_trial
from teleop_rt.config.rig import RigConfig
from teleop_rt_dev.fuzz_damage import Target
from teleop_rt_dev.paths import CONFIG
from teleop_rt_dev.trial.files import plant_of
from teleop_rt_drivers import opening, registry
from teleop_rt_drivers.quantity import plausible_position


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
