"""Hazards that remove the force of an operator's device, each with the fault it must raise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from teleop_rt_dev.faults.handle import CANOPEN, SERIAL, HandleBench

PUSH_N, WITHIN_MS, GONE_N = 10.0, 20, 0.05
"""Force before the hazard, its longest duration after it, and the largest that counts as none."""
HALF_STEP_N = 0.25
"""Of the Damiao handle's torque, of whose 12 bits for either sign none is exactly 0."""


@dataclass(frozen=True)
class HandleRow:
    """One hazard on one device: `inject` harms it; `heal` ends a fault that lasts."""

    name: str
    trial: Path
    inject: Callable[[HandleBench], None]
    names: frozenset[str]
    heal: str | None = None
    push_N: float = PUSH_N
    gone_N: float = GONE_N
    changes: tuple[str, ...] = ()


def mute(device: str) -> Callable[[HandleBench], None]:
    return lambda handle: handle.network.inject("mute", device)


def reset_drive(handle: HandleBench) -> None:
    handle.network.inject("reset", "drive")


def weak_motor(handle: HandleBench) -> None:
    """The motor gives no force, and its drive reports so."""
    handle.plant.push = lambda _: None
    handle.plant._pending.clear()
    handle.plant._command = 0.0


def fling(handle: HandleBench) -> None:
    """Nobody holds it any more, and it flies off."""
    handle.plant._let_go_s = 0.0
    handle.plant._handle[1] = 3.5


def carry_off(handle: HandleBench) -> None:
    """The hand takes it past the end of its travel at 1 m/s, which is allowed."""
    _, end = handle.watch.travel
    while (position := handle.plant._handle[0]) <= end - 1e-3:
        place(handle, position + 1e-3)
        handle.update(PUSH_N)
        assert handle.watch.fault.code == 0, handle.watch.fault
    place(handle, end + 0.2e-3)


def place(handle: HandleBench, position: float) -> None:
    """Put device and hand there, at rest."""
    handle.plant._handle[:4] = position, 0.0, position, 0.0


def release(handle: HandleBench) -> None:
    """The enabling switch opens."""
    handle.operator._key.held = False


class HeldSwitch:
    """An enabling switch that is held until a row says otherwise."""

    held = True

    def update(self) -> bool:
        return self.held

    def close(self) -> None:
        """Nothing is open."""


SILENCE = mute("drive")
"""Of a maker's drive: of its encoder, too."""
HAZARDS = (
    ("no sample", mute("encoder"), "handle_stale handle_device", "encoder", PUSH_N),
    (
        "drive silent",
        mute("drive"),
        "handle_not_enabled handle_device handle_stale",
        "drive",
        PUSH_N,
    ),
    ("flung away", fling, "handle_overspeed", None, PUSH_N),
    ("end of travel", carry_off, "handle_end_of_travel", None, PUSH_N),
    ("switch released", release, "handle_released", None, PUSH_N),
    ("drive restarts", reset_drive, "handle_not_enabled handle_device", None, PUSH_N),
    ("motor weak", weak_motor, "handle_force_off", None, 50.0),
)
MAKERS = ("Damiao", "ODrive", "RobStride", "moteus")
DEVICES: dict[str, tuple[Path, tuple[str, ...]]] = {
    "CANopen": (CANOPEN, ()),
    "serial": (SERIAL, ()),
} | {
    maker: (SERIAL, (f"operator.rig=../rigs/simulated_{maker.lower()}_handle.yaml",))
    for maker in MAKERS
}
WITHOUT = {
    ("serial", "drive restarts"), ("serial", "motor weak"), ("moteus", "drive restarts"),
} | {(maker, "no sample") for maker in MAKERS}  # fmt: skip
"""A serial drive measures no force, and has no state to lose. A maker's drive is its own encoder. A
moteus takes the next command for its power, and is silent while it starts."""
HANDLE_ROWS = tuple(
    HandleRow(
        f"handle, {device}: {name}",
        trial,
        inject,
        frozenset((f"{faults} handle_stale" if inject is SILENCE and changes else faults).split()),
        heal,
        push,
        HALF_STEP_N if device == "Damiao" else GONE_N,
        changes,
    )
    for name, inject, faults, heal, push in HAZARDS
    for device, (trial, changes) in DEVICES.items()
    if (device, name) not in WITHOUT
)


@dataclass(frozen=True)
class HandleOutcome:
    """The outcome of a row: the time until the force was gone, the fault, and the failed checks."""

    took_ms: int
    named: str
    problem: str


def play(row: HandleRow) -> HandleOutcome:
    """Push, harm, and see the force go and stay away."""
    handle = HandleBench(row.trial, row.changes)
    if row.inject is release:
        handle.operator._key, handle.watch._watched.has_switch = HeldSwitch(), 1
    handle.update(row.push_N, 60)
    if abs(handle.plant.servo_force + row.push_N) > 0.3:
        return HandleOutcome(0, handle.watch.fault.name, "it did not push to begin with")
    row.inject(handle)
    took = 0
    while took <= WITHIN_MS and not gone(handle, row.gone_N):
        handle.update(row.push_N)
        took += 1
    named = handle.watch.fault.name
    if took > WITHIN_MS:
        return HandleOutcome(took, named, f"{-handle.plant.servo_force:.1f} N after {WITHIN_MS} ms")
    if named not in row.names:
        return HandleOutcome(took, named, f"called {named}")
    if row.heal is not None:
        handle.network.heal(row.heal)
    handle.update(row.push_N, 50)
    return HandleOutcome(took, named, "" if gone(handle, row.gone_N) else "the force came back")


def gone(handle: HandleBench, none_N: float = GONE_N) -> bool:
    """Whether the device was let go and its motor gives no force."""
    let_go = handle.watch.fault.code != 0
    return let_go and abs(handle.plant.servo_force) < none_N
