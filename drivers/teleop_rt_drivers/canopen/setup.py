"""Find, check and configure the devices before the loop owns the bus: NMT and SDO."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.canopen import cia402
from teleop_rt_drivers.canopen.build import drive_scale
from teleop_rt_drivers.canopen.pdo import RPDO_COMMUNICATION, TPDO_COMMUNICATION, PdoCodec
from teleop_rt_drivers.canopen.sdo import BOOT_UP, ConfigurationBus, SdoNode

if TYPE_CHECKING:
    from teleop_rt.config.rig import Limits, RigConfig
    from teleop_rt_drivers.canopen.config import CanopenPart, DaemonConfig
    from teleop_rt_drivers.canopen.drive_config import DriveConfig, TorqueConfig
    from teleop_rt_drivers.canopen.node_config import ForceConfig, NodeConfig, Resolution

NMT = 0x000
"""COB-ID of network management; its commands follow (CiA 301)."""
START, STOP_NODE, PRE_OPERATIONAL, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x82  # see NMT
PDO_INVALID = 1 << 31
"""Bit of a COB-ID that switches a PDO off (CiA 301)."""
PDOS_PER_PROFILE = 4
"""PDOs of each kind that are disabled: CiA 301's default mappings have four."""
BOOT_TIMEOUT_S = 2.0
"""Longest time from a reset to the boot-up message."""
MOST_TORQUE = 2**15 - 1
"""Largest value of 6072h that is written: the target torque 6071h is a signed word."""
PROCESS_VALUE, UNIT, DIGITS = 0x9130, 0x6131, 0x6132
"""CiA 404: the input's value, its physical unit, its decimal digits."""
NEWTON = 0x00210000
"""CiA 303-2, without a prefix."""


def refuse_other_masters(bus: ConfigurationBus, config: CanopenPart) -> None:
    """Listen for the frames that only the master of a network sends; raises AxisError."""
    masters = {
        NMT: "an NMT command",
        config.daemon.sync_cob_id: "a SYNC",
        BOOT_UP + config.daemon.node_id: f"a heartbeat of node {config.daemon.node_id}",
    }
    found = bus.wait(lambda m: m.arbitration_id in masters, config.daemon.listen_ms / 1000)
    if found is not None:
        raise AxisError(
            f"another master is on {config.bus}: it sent {masters[found.arbitration_id]}; stop it, "
            "or give this run a separate bus (another channel; for udp_multicast: another port)"
        )


def call_back(sdo: SdoNode, bus: ConfigurationBus) -> None:
    """Bring a device that does not answer to where it would: one that was stopped answers nobody.

    Nothing moves before operation. Comes after it is known that there is no other master.
    """
    try:
        sdo.read("0x1018:1")
    except AxisError:
        bus.send(NMT, bytes((PRE_OPERATIONAL, sdo.node_id)))


def check_identity(sdo: SdoNode, node: NodeConfig, attempts: int) -> None:
    """Compare object 1018h with the config; the first read may be tried `attempts` times."""
    sdo.read("0x1018:1", attempts)
    sdo.expect("0x1018:1", node.identity.vendor)
    sdo.expect("0x1018:2", node.identity.product)
    if node.identity.revision is not None:
        sdo.expect("0x1018:3", node.identity.revision)


def restart(sdo: SdoNode, bus: ConfigurationBus) -> None:
    """Put a device's communication back to its power-on values and wait for its boot-up."""
    bus.send(NMT, bytes((RESET_COMMUNICATION, sdo.node_id)))
    boot_up = BOOT_UP + sdo.node_id
    if bus.wait(lambda m: m.arbitration_id == boot_up and not any(m.data), BOOT_TIMEOUT_S) is None:
        raise AxisError(f"{sdo.label} sent no boot-up message after a reset: switch it off and on")


def configure_node(
    sdo: SdoNode, node: NodeConfig, pdos: list[PdoCodec], daemon: DaemonConfig
) -> None:
    """Write heartbeat, the config's own entries and the PDO mappings; check expected entries."""
    configure_watch(sdo, node)
    if daemon.sync_counter is not None:
        sdo.write_checked("0x1019", daemon.sync_counter)
    for entry, value in node.expect.items():
        sdo.expect(entry, value)
    for entry, value in node.setup.items():
        sdo.write_checked(entry, value)
    disable_pdos(sdo)
    for codec in pdos:
        map_pdo(sdo, codec)


def configure_watch(sdo: SdoNode, node: NodeConfig) -> None:
    """Configure life signs of the device: heartbeat, or node guarding if it has none."""
    if node.guarding is not None:
        sdo.write_checked("0x100C", node.guarding.period_ms)
        sdo.write_checked("0x100D", node.guarding.life_factor)
    elif 0x1017 in sdo.dictionary:
        sdo.write_checked("0x1017", node.heartbeat_ms)
    else:
        raise AxisError(
            f"{sdo.label}: {node.eds} has no heartbeat (1017h): write `guarding: {{}}` for node "
            "guarding (100Ch, 100Dh)"
        )


def disable_pdos(sdo: SdoNode) -> None:
    """Disable every PDO that the EDS has, so that none is sent but the mapped ones."""
    for first in (TPDO_COMMUNICATION, RPDO_COMMUNICATION):
        for index in range(first, first + PDOS_PER_PROFILE):
            if index in sdo.dictionary:
                present = sdo.read(f"0x{index:04X}:1")
                sdo.write(f"0x{index:04X}:1", int(present) | PDO_INVALID)


def map_pdo(sdo: SdoNode, codec: PdoCodec) -> None:
    """Map one disabled PDO, set its transmission type, and enable it (CiA 301, 7.5.2.36)."""
    communication, mapping = f"0x{codec.communication:04X}", f"0x{codec.mapping:04X}"
    sdo.write(f"{communication}:1", codec.cob_id | PDO_INVALID)
    sdo.write_checked(f"{communication}:2", codec.transmission_type)
    sdo.write(f"{mapping}:0", 0)
    for position, word in enumerate(codec.words, start=1):
        sdo.write_checked(f"{mapping}:{position}", word)
    sdo.write_checked(f"{mapping}:0", len(codec.words))
    sdo.write_checked(f"{communication}:1", codec.cob_id)


def check_resolution(sdo: SdoNode, resolution: Resolution, per_count: float) -> None:
    """Refuse a device whose measuring step is not the scale of the config."""
    raw = sdo.read(resolution.entry)
    stated = float(raw) * resolution.unit
    if abs(stated - per_count) > 1e-6 * per_count:
        raise AxisError(
            f"{sdo.label}: its measuring step {resolution.entry} is {raw}, that is {stated:g} per "
            f"count, the rig's config says {per_count:g}: correct one of the two"
        )


def check_force_scale(sdo: SdoNode, force: ForceConfig, rig: RigConfig) -> None:
    """Refuse a sensor that says another scale than the config: its unit and decimal digits.

    CiA 404 has them in 6131h and 6132h; a device without them, or with another unit, says nothing.
    """
    index, _, subindex = force.force.partition(":")
    if int(index, 16) != PROCESS_VALUE or rig.units.force != "N":
        return
    if not {UNIT, DIGITS} <= set(sdo.dictionary):
        return
    if int(sdo.read(f"0x{UNIT:04X}:{subindex or 1}")) != NEWTON:
        return
    digits = int(sdo.read(f"0x{DIGITS:04X}:{subindex or 1}"))
    stated = 10.0**-digits
    if not abs(stated - force.scale) <= 1e-6 * stated:
        raise AxisError(
            f"{sdo.label}: it gives newton with {digits} decimal digits (6132h), {stated:g} per"
            f" count, the rig's config says {force.scale:g}: correct one of the two"
        )


def configure_drive(sdo: SdoNode, drive: DriveConfig, daemon: DaemonConfig, rig: RigConfig) -> None:
    """Set the drive's mode, limits, interpolation period and watch over this program.

    Raises AxisError when the drive is in fault or lacks the mode.
    """
    mode = cia402.MODE_CYCLIC_SYNCHRONOUS_POSITION
    if drive.torque is not None:
        mode = cia402.MODE_CYCLIC_SYNCHRONOUS_TORQUE
    if not int(sdo.read(cia402.SUPPORTED_MODES)) >> (mode - 1) & 1:
        name = cia402.MODE_NAMES[mode]
        raise AxisError(
            f"{sdo.label} has no {name} mode (6502h, bit {mode - 1}): take a drive that has it"
        )
    sdo.write(cia402.CONTROLWORD, cia402.DISABLE_VOLTAGE)
    sdo.write(cia402.CONTROLWORD, cia402.FAULT_RESET)
    sdo.write(cia402.CONTROLWORD, cia402.DISABLE_VOLTAGE)
    if cia402.drive_state(int(sdo.read(cia402.STATUSWORD))) is cia402.Cia402State.FAULT:
        code = int(sdo.read(cia402.ERROR_CODE))
        raise AxisError(
            f"{sdo.label} stays in fault, error code 0x{code:04X}: see the drive's manual"
        )
    sdo.write(cia402.MODE, mode)
    sdo.expect(cia402.MODE_DISPLAY, mode)
    write_limits(sdo, drive, rig.limits)
    if drive.rated is not None:
        count = 1e-3 if drive.torque is None else drive.torque.rated_count
        check_rated_torque(sdo, drive.rated, count)
    if drive.torque is not None:
        write_torque_limit(sdo, drive.torque, rig.limits)
    value, exponent = interpolation_period(rig.period_ns)
    sdo.write_checked("0x60C2:1", value)
    sdo.write_checked("0x60C2:2", exponent)
    watch = daemon.node_id << 16 | drive.daemon_timeout_ms
    sdo.write_checked("0x1016:1", watch)


def write_limits(sdo: SdoNode, drive: DriveConfig, limits: Limits) -> None:
    """Set the drive's software limits and top speed.

    Where its zero is unknown it may go the whole travel from where it is, either way.
    """
    scale = drive_scale(drive)
    lowest, highest = limits.position_min, limits.position_max
    if drive.zero == "unknown":
        here, travel = scale.value(sdo.read(cia402.ACTUAL_POSITION)), highest - lowest
        lowest, highest = here - travel, here + travel
    bounds = sorted((scale.counts(lowest), scale.counts(highest)))
    sdo.write_checked("0x607D:1", bounds[0])
    sdo.write_checked("0x607D:2", bounds[1])
    sdo.write_checked("0x607F", round(limits.velocity_max / (drive.speed_count or scale.per_count)))


def check_rated_torque(sdo: SdoNode, rated: float, count: float) -> None:
    """Refuse a drive whose rated torque is not the config's: its forces would be others."""
    stated = float(sdo.read(cia402.RATED_TORQUE)) * count
    if not abs(stated - rated) <= 1e-3 * rated:
        raise AxisError(
            f"{sdo.label}: its rated torque (6076h) is {stated:g}, the rig's config says "
            f"{rated:g}: correct one of the two"
        )


def write_torque_limit(sdo: SdoNode, torque: TorqueConfig, limits: Limits) -> None:
    """Limit the drive's torque to the rig's force."""
    most = round(cia402.PER_RATED * limits.force_max / torque.rated_force)
    sdo.write_checked(cia402.MAX_TORQUE, min(most, MOST_TORQUE))


def interpolation_period(period_ns: int) -> tuple[int, int]:
    """Return value and power of ten of seconds for object 60C2h; raises AxisError."""
    for exponent in range(-3, -10, -1):
        unit_ns = 10 ** (9 + exponent)
        if period_ns % unit_ns == 0 and period_ns // unit_ns <= 255:
            return period_ns // unit_ns, exponent
    raise AxisError(f"a period of {period_ns} ns cannot be set in the drive (60C2h): change rate")
