"""Measurements of the bus and its devices, each finding with its next step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.axis import AxisError, AxisFault, Sample
from teleop_rt.slave.faults import of_axis
from teleop_rt_drivers.canopen.config import CanopenPart
from teleop_rt_drivers.canopen.eds import load
from teleop_rt_drivers.canopen.pdo import PdoCodec
from teleop_rt_drivers.canopen.survey import survey
from teleop_rt_drivers.findings import Finding
from teleop_rt_drivers.framed.config import RawCanPart
from teleop_rt_drivers.framed.dbc import load_dbc
from teleop_rt_drivers.registry import parts_of
from teleop_rt_drivers.replayed_bus import REPLAY

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

    from teleop_rt.axis import Axis
    from teleop_rt.config.rig import AxisConfig, RigConfig
    from teleop_rt_drivers.bus import BusConfig

NOT_OPENED = "follow this message, then run doctor again"
"""Next step after an error of an axis that cannot be opened."""
WARM_UP = 10
"""Cycles before the measurement, which do not count."""
VALID_SHARE = 0.98
"""Share of cycles with a valid sample that a healthy rig exceeds."""
FROZEN_SAMPLES = 100
"""Equal forces in a row that a sensor with noise does not give."""
RARE = 0.02
"""Share of cycles in which an outlier of a device's clock is no finding."""
BAD_FRAMES = ("bad_checksum", "bad_end", "no_match", "too_long", "wrong_length")
BAD_SHARE = 1e-3
"""Share of bad frames from which they are a warning."""
EVENTS = {
    "sync_sent", "frames", "cycles_without_sample", "speed_saturated",
}  # fmt: skip
ADVICE = {
    "bad_checksum": "check shielding, ground and baud rate",
    "bad_end": "check the frame's description and the baud rate",
    "wrong_length": "compare the device's mapping or DBC with the config",
    "repeated": "the device repeats itself: restart it; or two devices send the same frame",
    "unsolicited": "two devices answer under one id: give each its own",
    "late": "answers come after their cycle: lower rate_hz or the bus load",
    "clock_outliers": "frames come later than the device's clock says: see the load of the machine",
    "gaps": "frames are lost: check wiring, and the load of bus and machine",
    "skipped_bytes": "bytes that are no frame: check baud rate and the frame's description",
    "out_of_range": "check scale, sign and offset against the rig's limits",
    "impossible_jump": "check the encoder's signals, and velocity_max",
    "bad_status": "the device reports an error in its status: see its manual",
    "error_frame": "check termination and wiring of the bus",
    "send_failed": "nothing acknowledges: check power, termination and bit rate",
}


def survey_buses(
    rig: RigConfig, open_bus: Callable[[BusConfig], can.BusABC], now_ns: Callable[[], int]
) -> list[Finding]:
    """Return the nodes that answer on the rig's CANopen buses, compared with their EDS."""
    findings = []
    for part in parts_of(rig.axis).values():
        if isinstance(part, CanopenPart) and part.bus.interface != REPLAY:
            bus = open_bus(part.bus)
            try:
                findings += survey(part, bus, now_ns)
            finally:
                bus.shutdown()
    return findings


def frame_names(part: AxisConfig) -> dict[int, str]:
    """Return the names of the frames that a part of an axis reads."""
    if isinstance(part, CanopenPart):
        nodes = part.nodes
        return {
            PdoCodec(pdo, load(nodes[name].eds, nodes[name].node_id), name, receive=False).cob_id: (
                f"TPDO{pdo.number} of the {name}"
            )
            for name, pdo in part.tpdos
        }
    if isinstance(part, RawCanPart):
        messages = load_dbc(part.dbc)
        read = [signal.source for signal in part.signals.values()]
        read += [part.drive.answer] if part.drive else []
        return {messages[name].frame_id: name for name in read}
    return {}


def examine_axis(
    axis: Axis,
    wait_cycle: Callable[[], None],
    cycles: int,
    *,
    configure: bool = True,
    begin: Callable[[], object] = lambda: None,
    has_sensor: bool = True,
) -> list[Finding]:
    """Configure the axis and read it for some cycles without arming; nothing moves.

    `wait_cycle` waits for the next cycle; `begin` is called when the warm-up is over. The axis
    stays open. Without a force sensor (`has_sensor`) the force is that of a motor without power.
    """
    try:
        if configure:
            axis.configure()
    except AxisError as error:
        return [Finding("error", str(error), "devices", NOT_OPENED)]
    sample = Sample()
    valid = np.zeros(cycles, dtype=bool)
    stamps = np.zeros(cycles, dtype=np.int64)
    forces = np.zeros(cycles)
    before: dict[str, int] = {}
    for cycle in range(cycles + WARM_UP):
        axis.read_into(sample)
        axis.write(sample.position)
        wait_cycle()
        if cycle < WARM_UP:
            before = dict(getattr(axis, "counters", {}))
            begin()
            continue
        valid[cycle - WARM_UP] = sample.valid
        stamps[cycle - WARM_UP] = sample.stamp_ns
        forces[cycle - WARM_UP] = sample.force
    counters = getattr(axis, "counters", {})
    counted = {name: counters[name] - before.get(name, 0) for name in counters}
    findings = [_fault(sample.fault, axis), _share(valid), _timing(stamps[valid])]
    findings += _error_rates(counted)
    return findings + (_frozen(forces[valid]) if has_sensor else []) + _counted(counted, cycles)


def _fault(fault: AxisFault, axis: Axis) -> Finding:
    if fault is AxisFault.NONE:
        return Finding("ok", "all devices answer, and agree with the config", "devices")
    found = of_axis(fault)
    said = getattr(axis, "last_emergency", "")
    what = f"{fault.name}: {found.cause}" + (f"; {said}" if said else "")
    return Finding("error", what, "devices", found.next_step)


def _share(valid: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Finding:
    share = float(valid.mean())
    what = f"{100 * share:.1f} % of {len(valid)} cycles had a new position and a new force"
    if share < VALID_SHARE:
        step = "see the counts below; a sensor slower than the loop needs a lower rate_hz"
        return Finding("error" if share < 0.5 else "warning", what, "samples", step)
    return Finding("ok", what, "samples")


def _timing(stamps: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Finding:
    if len(stamps) < 3:
        return Finding("error", "too few samples to judge their timing", "timing", "see above")
    steps_us = np.diff(stamps) * 1e-3
    mean, jitter = float(steps_us.mean()), float(np.percentile(abs(steps_us - steps_us.mean()), 99))
    what = f"a sample every {mean:.1f} us, within {jitter:.1f} us (p99)"
    if jitter > 0.5 * mean:
        step = "end programs that load this machine, or give the daemon real-time priority"
        return Finding("warning", what, "timing", step)
    return Finding("ok", what, "timing")


def _frozen(forces: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[Finding]:
    """Say so where the newest forces are all the same: a sensor that lives has noise."""
    newest = forces[-FROZEN_SAMPLES:]
    if len(newest) < FROZEN_SAMPLES or np.ptp(newest) > 0:
        return []
    what = f"the force is exactly {newest[0]:g} in the last {FROZEN_SAMPLES} samples"
    step = "the sensor hangs, or is not connected to its amplifier: restart it, then press on it"
    return [Finding("error", what, "force sensor", step)]


def _error_rates(counted: dict[str, int]) -> list[Finding]:
    """Return the share of bad frames of each part that counts its good ones."""
    findings = []
    for name, good in counted.items():
        part, _, reason = name.rpartition(".")
        if reason != "frames":
            continue
        bad = sum(counted.get(f"{part}.{bad}" if part else bad, 0) for bad in BAD_FRAMES)
        share = bad / max(1, good + bad)
        what = f"{100 * share:.3g} % of {good + bad} frames are bad"
        if share > BAD_SHARE:
            step = "check shielding, ground, termination and baud or bit rate"
            findings.append(Finding("warning", what, part or "frames", step))
        else:
            findings.append(Finding("ok", what, part or "frames"))
    return findings


def _counted(counted: dict[str, int], cycles: int) -> list[Finding]:
    """Return a finding for each reason why frames were not used."""
    findings = []
    for name, count in counted.items():
        reason = name.rpartition(".")[2]
        if count <= (RARE * cycles if reason == "clock_outliers" else 0) or reason in EVENTS:
            continue
        what = f"{count} times {reason.replace('_', ' ')} in {cycles} cycles"
        step = ADVICE.get(reason, "see drivers/README.md on counters")
        severity = "error" if count > 0.1 * cycles else "warning"
        findings.append(Finding("error" if severity == "error" else "warning", what, name, step))
    return findings
