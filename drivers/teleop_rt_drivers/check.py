"""Everything that can be known of a config without moving, or even opening, anything."""

from __future__ import annotations

from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING

from can.interfaces import VALID_INTERFACES

from teleop_rt.axis import AxisError
from teleop_rt.config.link import LinkConfig
from teleop_rt.config.rig import LOWEST_RATE_HZ
from teleop_rt.link.keys import KeyFileError, load_keys
from teleop_rt.slave.pace import met_within_cap, unknown_speed
from teleop_rt.trial.simulated_wall import unmet
from teleop_rt_drivers.actuators.config import ActuatorDeviceConfig
from teleop_rt_drivers.actuators.part import ActuatorPart, CanActuatorPart, LineActuatorPart
from teleop_rt_drivers.bus import ADAPTERS, FDCANUSB, SOCKETCAN, UNIX, BusConfig
from teleop_rt_drivers.bus_load import (
    FULLEST_LINE,
    actuator_load,
    asked_load,
    canopen_load,
    line_turn_s,
    raw_can_load,
    serial_loads,
)
from teleop_rt_drivers.canopen import eds
from teleop_rt_drivers.canopen.config import CanopenPart
from teleop_rt_drivers.canopen.setup import interpolation_period
from teleop_rt_drivers.ends import LockStepEnds
from teleop_rt_drivers.findings import Finding
from teleop_rt_drivers.framed.config import RawCanPart, SerialPart
from teleop_rt_drivers.opening import open_axis_on
from teleop_rt_drivers.quantity import Scale
from teleop_rt_drivers.recording import RecordingAxisConfig, columns_of, recording_path
from teleop_rt_drivers.registry import parts_of
from teleop_rt_drivers.replayed_bus import REPLAY
from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
from teleop_rt_drivers.slow_check import check_line_rates, check_overshoot, check_stamps
from teleop_rt_drivers.stall_check import check_stalls
from teleop_rt_drivers.transport import DEFAULT_BIT_RATE

if TYPE_CHECKING:
    from teleop_rt.config.rig import AxisConfig, RigConfig
    from teleop_rt.config.trial import TrialConfig
    from teleop_rt_drivers.bus_load import Load
    from teleop_rt_drivers.canopen.drive_config import ForceInputConfig

WARN_ABOVE = 0.9
"""Share of the allowed value from which a finding is reported."""
INT32 = 2**31 - 1
SIMULATED_NETWORK = ("round_trip_ms", "jitter_ms", "loss", "duplicate", "reorder", "blackouts_s")
"""Keys of a trial's `link` that worsen the network, each of no effect by default."""
SPEED_SATURATES = 0.32767
"""Speed [rig unit/s] at which 6030h:1, 16 bits of 0.01 mm/s, ends."""


def check_rig(rig: RigConfig, force_cap: float | None = None) -> list[Finding]:
    """Return findings on a rig's config: descriptions, loads, limits, conversions.

    `force_cap` is the trial's, where there is one.
    """
    step = "restore the safeguard, or keep out of reach while the axis has power"
    findings = [Finding("danger", sentence, "unsafe_i_know", step) for sentence in rig.unsafe]
    findings += check_placeholders(rig)
    findings += _check_descriptions(rig)
    if any(finding.severity == "error" for finding in findings):
        return findings
    for name, part in parts_of(rig.axis).items():
        where = f"axis.parts.{name}" if name else "axis"
        findings += _check_interface(part, where)
        findings += _check_loads(part, rig, where)
        findings += _check_limits(part, rig, where)
        findings += check_stalls(part, rig, where)
        findings += check_line_rates(part, rig, where)
    return findings + check_stamps(rig) + check_overshoot(rig, force_cap)


def check_first_touch(trial: TrialConfig) -> list[Finding]:
    """State at which speed an unknown wall is met, and up to which stiffness the cap holds then."""
    rig, cap = trial.rig, trial.slave.force_cap
    if trial.mode != "model-mediated":
        return []
    limits, unit = rig.limits, rig.units
    key = f"limits.stiffness_max_{unit.force}_per_{unit.position}"
    of_stiffness, promise = (
        f"{unit.force}/{unit.position}",
        f"slave.force_cap {cap:g} {unit.force} is kept",
    )
    if limits.stiffness_max is None:
        fastest = limits.velocity_max
        most = met_within_cap(rig, cap, fastest)
        what = f"up to {most:.0f} {of_stiffness}, at up to {fastest:g} {unit.position}/s; {key} "
        what += "would slow the tool down where it has not been before"
    else:
        fastest = min(limits.velocity_max, unknown_speed(rig, cap, limits.stiffness_max))
        what = f"up to {limits.stiffness_max:g} {of_stiffness}: the tool is no faster than "
        what += f"{fastest:.3g} {unit.position}/s where it has not been before"
    return [Finding("ok", f"{promise} on an unknown wall of {what}", key)]


def check_simulated_wall(trial: TrialConfig) -> list[Finding]:
    """Return warnings where the trial does not meet the wall that is simulated for it."""
    if not isinstance(trial.plant, SimulatedPlantConfig):
        return []
    found = unmet(trial, trial.plant.environment.model_dump(), trial.plant.start)
    return [Finding("warning", one.what, one.key, one.next_step) for one in found]


def check_placeholders(rig: RigConfig) -> list[Finding]:
    """Return a warning that lists the keys whose values are still an example's."""
    if not rig.placeholders:
        return []
    what = f"still with an example's value: {', '.join(rig.placeholders)}"
    step = "put in your own, then remove the key from this list"
    return [Finding("warning", what, "placeholders", step)]


def check_link(link: LinkConfig) -> list[Finding]:
    """Return findings on a trial's link: its key, and who may reach it."""
    findings = []
    if link.key_file is None:
        findings.append(Finding("ok", "a run on one machine makes its own key", "link.key_file"))
    else:
        try:
            load_keys(Path(link.key_file))
            findings.append(
                Finding("ok", "the key is readable, and only by its owner", "link.key_file")
            )
        except KeyFileError as error:
            makes = "make one with `teleop-rt keygen`"
            step = "then check again" if "keygen" in str(error) else makes
            findings.append(Finding("error", str(error), "link.key_file", step))
    if not link.bind_host.startswith("127.") and link.bind_host != "localhost":
        what = f"the link listens beyond this machine, on {link.bind_host}"
        step = "keep the key secret, and let the firewall admit the peer alone"
        findings.append(Finding("warning", what, "link.bind_host", step))
    return findings


def check_network(link: LinkConfig) -> list[Finding]:
    """Return a warning that lists the simulated impairments of a trial on real hardware."""
    ideal = LinkConfig()
    set_here = [key for key in SIMULATED_NETWORK if getattr(link, key) != getattr(ideal, key)]
    if not set_here:
        return []
    what = f"a poor network is simulated on real hardware: {', '.join(set_here)}"
    step = "remove these keys, unless the real network is to be made worse"
    return [Finding("warning", what, f"link.{set_here[0]}", step)]


def _check_descriptions(rig: RigConfig) -> list[Finding]:
    """Build the axis without opening anything: EDS, DBC and formats must fit the config."""
    if isinstance(rig.axis, RecordingAxisConfig):
        try:
            recording_path(rig.axis.file, columns_of(rig.axis))
        except AxisError as error:
            return [Finding("error", str(error), "axis.file", "set it to an existing file")]
        return [Finding("ok", "the recording is there", "axis.file")]
    try:
        open_axis_on(rig, lambda: 0, LockStepEnds())
    except AxisError as error:
        return [Finding("error", str(error), "axis", "correct the file or the key that it names")]
    return [Finding("ok", "descriptions, mappings and units fit the config", "axis")]


def _check_interface(part: AxisConfig, where: str) -> list[Finding]:
    """Return an error for a bus on an interface that neither python-can nor this program has."""
    bus = getattr(part, "bus", None)
    known = {*VALID_INTERFACES, UNIX, FDCANUSB, REPLAY}
    if not isinstance(bus, BusConfig) or bus.interface is None or bus.interface in known:
        return []
    usual = get_close_matches(bus.interface, known, 1) or [SOCKETCAN, *ADAPTERS, UNIX]
    what = f"{bus.interface!r} is not a CAN interface of python-can or of this program"
    return [Finding("error", what, f"{where}.bus.interface", f"take {', '.join(usual)}")]


def _check_loads(part: AxisConfig, rig: RigConfig, where: str) -> list[Finding]:
    rate_hz = rig.rate_hz
    if isinstance(part, LineActuatorPart):
        return [_turn(part, rig, where), _reach(part, rig, where)]
    if isinstance(part, CanActuatorPart):
        bit_rate, axis = part.bus.bitrate or DEFAULT_BIT_RATE, rig.axis
        load = actuator_load(part, rig, bit_rate)
        if isinstance(axis, ActuatorDeviceConfig):
            load = asked_load(axis, rig, bit_rate)
        return [_load_finding(load, rate_hz, f"{where}.bus"), _reach(part, rig, where)]
    if isinstance(part, CanopenPart):
        dictionaries = {n: eds.load(node.eds, node.node_id) for n, node in part.nodes.items()}
        load = canopen_load(part, dictionaries, part.bus.bitrate or DEFAULT_BIT_RATE)
        return [_load_finding(load, rate_hz, f"{where}.bus")]
    if isinstance(part, RawCanPart):
        load = raw_can_load(part, part.bus.bitrate or DEFAULT_BIT_RATE)
        return [_load_finding(load, rate_hz, f"{where}.bus")]
    if isinstance(part, SerialPart):
        return [
            _load_finding(load, rate_hz, f"{where}.ports.{name}")
            for name, load in serial_loads(part).items()
        ]
    return []


def _turn(part: LineActuatorPart, rig: RigConfig, where: str) -> Finding:
    """Compare the time of request and answer on a line with a cycle."""
    turn_ms, cycle_ms = 1e3 * line_turn_s(part, rig), 1e3 / rig.rate_hz
    what = (
        f"an order and its answer take {turn_ms:.3g} ms at {part.baud} baud, of it "
        f"{part.usb_latency_ms:g} ms in the adapter, of a cycle of {cycle_ms:.3g} ms"
    )
    if turn_ms > FULLEST_LINE * cycle_ms:
        fitting = FULLEST_LINE * 1e3 / turn_ms
        step = f"lower rate_hz to {fitting:.0f}, raise the baud rate, or take a faster adapter"
        return Finding("error", what, f"{where}.baud", step)
    return Finding("ok", what, f"{where}.baud")


def _reach(part: ActuatorPart, rig: RigConfig, where: str) -> Finding:
    """Return whether the drive's numbers hold the rig's travel."""
    scale = Scale(part.scale, part.sign, part.offset)
    ends = [scale.raw(end) for end in (rig.limits.position_min, rig.limits.position_max)]
    furthest, reach = max(abs(end) for end in ends), part.codec(rig).reach
    what = f"the travel is {min(ends):.4g} to {max(ends):.4g} {part.unit} of the drive"
    if furthest > reach:
        step = "choose a larger transmission, or offset_ so that the travel is about the drive's 0"
        return Finding("error", f"{what}, which holds {reach:.4g}", f"{where}.scale", step)
    return Finding("ok", what, where)


def _load_finding(load: Load, rate_hz: int, where: str) -> Finding:
    """Judge a load: above the reserve it is refused, with the rate that fits."""
    share = load.share(rate_hz)
    what = f"{100 * share:.0f} % of {load.bit_rate} bit/s is used at {rate_hz} Hz, at worst"
    if share > load.fullest:
        fitting = load.fitting_rate_hz
        slower = f"set rate_hz to at most {fitting}, or " if fitting >= LOWEST_RATE_HZ else ""
        step = f"{slower}raise the bit rate"
        return Finding("error", what, where, step)
    if share > WARN_ABOVE * load.fullest:
        return Finding("warning", what, where, "leave room for repeated frames: lower rate_hz")
    return Finding("ok", what, where)


def _check_limits(part: AxisConfig, rig: RigConfig, where: str) -> list[Finding]:
    """Compare the rig's limits with the ranges of objects and fields."""
    if not isinstance(part, CanopenPart):
        return []
    findings = []
    unit, limits = rig.units.position, rig.limits
    furthest = max(abs(limits.position_min), abs(limits.position_max))
    for name, node in (("encoder", part.encoder), ("drive", part.drive)):
        if node is None:
            continue
        what = f"one count is {node.scale:g} {unit}"
        findings.append(Finding("ok", what, f"{where}.{name}"))
        if (furthest + abs(node.offset)) / node.scale > INT32:
            what = f"{furthest:g} {unit} does not fit into 32 bits of {node.scale:g} {unit}"
            findings.append(Finding("error", what, f"{where}.{name}", "use a coarser count"))
    encoder = part.encoder
    if encoder is not None:
        if encoder.scale > 1.01 * rig.sensors.position_resolution:
            what = f"one count, {encoder.scale:g} {unit}, is coarser than position_resolution"
            step = f"set sensors.position_resolution_{unit} to {encoder.scale:g}"
            findings.append(Finding("warning", what, f"{where}.encoder", step))
        if encoder.speed is not None and limits.velocity_max > SPEED_SATURATES:
            what = (
                f"its own speed saturates at {SPEED_SATURATES:g} {unit}/s, below"
                f" limits.velocity_max {limits.velocity_max:g} {unit}/s: the velocity is computed"
                " from the position, and saturated samples are counted"
            )
            findings.append(Finding("ok", what, f"{where}.encoder.speed"))
    if part.drive is not None:
        try:
            interpolation_period(rig.period_ns)
        except AxisError as error:
            findings.append(Finding("error", str(error), "rate_hz", "choose another rate"))
        if part.drive.force_input is not None:
            findings.append(_input_range(part.drive.force_input, rig, f"{where}.drive.force_input"))
    return findings


def _input_range(config: ForceInputConfig, rig: RigConfig, where: str) -> Finding:
    """Compare the forces that an analog input measures with the limit that it has to see."""
    unit, most = rig.units.force, rig.limits.force_max
    ends = sorted(
        config.offset + config.sign * config.scale * count
        for count in (config.lowest, config.highest)
    )
    what = f"the drive's input measures {ends[0]:g} to {ends[1]:g} {unit}"
    if ends[0] <= -most and most <= ends[1]:
        return Finding("ok", what, where)
    step = f"lower force_max_{unit}, or amplify the sensor's signal less"
    what = f"{what}, and force_max is {most:g} {unit} either way: a larger force would not be seen"
    return Finding("error", what, where, step)
