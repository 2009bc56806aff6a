"""The text of a rig's file for a drive, an adapter and a sensor: a shipped rig, changed."""

from __future__ import annotations

import re

from teleop_rt.errors import ExpectedError
from teleop_rt.shipped import example
from teleop_rt_drivers.calibration.rig_file import with_values

ON_LINES = ("dynamixel", "feetech")
"""Drives on a serial line of their own; the others are on a CAN bus."""
DRIVES = ("odrive", "damiao", "cybergear", "robstride", "moteus", "vesc", *ON_LINES, "canopen")
HANDLES = ("odrive", "damiao", "cybergear", "robstride", "moteus")
"""Drives that an operator's device can be made of."""
ENCODERS = (("canopen", "wrench"), ("canopen", "load-cell"))
POSITIONS = ("drive", "encoder")
"""Whose encoder is the rig's: the drive's own, or one beside it (canopen alone)."""
CHANNELS = {
    "socketcan": "can0",
    "slcan": "/dev/ttyACM0",
    "fdcanusb": "/dev/fdcanusb",
    "gs_usb": "0",
    "pcan": "PCAN_USBBUS1",
    "serial": "ttyUSB0",
    "unix": "rig",
}
"""Adapters by their interface, and the channel that each usually has."""
WITH_FD = ("socketcan", "fdcanusb", "unix")
"""Adapters that carry CAN FD."""
SENSORS = ("wrench", "load-cell", "drive", "drive-input")
"""A fast force sensor, a slow one, none (the motor's torque), or one at the drive's own input."""
WITH_INPUT = "canopen"
"""Drive whose analog input is read."""
ON_PORTS = ("wrench", "load-cell")
"""Sensors on a serial port of their own."""
SENSOR_PORT = re.compile(r"(\n +(?:wrench|cell): \{device: )\w+")
PRESETS = {
    ("canopen", "drive"): "simulated_canopen_drive",
    ("canopen", "drive-input"): "simulated_canopen_input",
    "canopen": "simulated_mixed",
    "cybergear": "simulated_robstride",
}
"""The rig that ships with a drive (and sensor), where it is not `simulated_DRIVE`."""
CYBERGEAR = (
    ("RobStride 02", "CyberGear"),
    ("RobStride", "CyberGear"),
    ("motor: robstride02", "motor: cybergear"),
    ("torque_max_Nm: 17", "torque_max_Nm: 12"),
    ("unsafe_i_know: [", "unsafe_i_know: [watchdog, "),
)
"""Differences from a RobStride, which also takes a time-out."""
WATCHDOG = re.compile(r"^ +watchdog_ms: .*\n", re.MULTILINE)
ENCODER_NODE = re.compile(r"^      encoder:\n(?:        .*\n)+", re.MULTILINE)
NO_SENSOR = """\
      force: from drive          # the motor's torque: its friction and mass go into drivetrain
      drivetrain:
        mass_N_s2_per_m: 0       # moved by the motor; `teleop-rt calibrate drivetrain` adds to it
        torque_lag_ms: 0.5       # half of the time over which the drive averages its torque
"""
NO_SENSOR_VALUES: dict[tuple[str, ...], float] = {
    ("sensors", "force_noise_N"): 0.4,
    ("sensors", "force_lag_ms"): 5.0,
    ("limits", "acceleration_max_m_per_s2"): 10.0,
}
"""Keys of a rig without a force sensor, as in `simulated_canopen_drive`."""
SIMULATED_MASS = ("mass_N_s2_per_m: 0  ", "mass_N_s2_per_m: 2.0")
"""Of the drive in the trials that ship."""
SCHEMA = "schema/rig.schema.json"
"""The schema by which an editor checks the file, from the file's folder."""
SLOW = {
    ("rate_hz",): 500.0,
    ("limits", "velocity_max_m_per_s"): 0.2,
    ("limits", "force_max_N"): 140.0,
    ("limits", "stiffness_max_N_per_m"): 4000.0,
    ("sensors", "force_lag_ms"): 27.3,
    ("sensors", "force_lag_deviation_ms"): 0.12,
    ("sensors", "force_settling_ms"): 50,
}
"""Keys of a rig with a load cell of 80 samples a second, as in `simulated_load_cell`."""
LATE = re.compile(r"^realtime:\n  late: .*\n\n", re.MULTILINE)
"""Bounds on a stalled loop that only a simulated rig may have."""
FOLDER = re.compile("folder: /tmp/teleop-rt-ports.*")
"""Where a simulated rig offers its ports."""


class NewRigError(ExpectedError):
    """No rig can be made of these options; the message gives cause and next step."""


def rig_text(
    drive: str,
    adapter: str,
    sensor: str,
    channel: str | None,
    position: str | None = None,
    sensor_port: str | None = None,
) -> str:
    """Return the text of a rig's file. Raises NewRigError for a combination that cannot be."""
    refuse_unknown_kinds(drive, adapter, sensor)
    _refuse_adapter(drive, adapter)
    position = position or ("encoder" if (drive, sensor) in ENCODERS else "drive")
    _refuse_unknown(("--position", position, POSITIONS))
    if position == "encoder" and (drive, sensor) not in ENCODERS:
        raise NewRigError(
            "--position encoder: only --drive canopen with a force sensor has an encoder of its"
            " own: take that, or --position drive"
        )
    if sensor == "drive-input" and drive != WITH_INPUT:
        raise NewRigError(
            "--sensor drive-input: only --drive canopen sends its analog input: take that,"
            " or another sensor"
        )
    text = _with_sensor(drive, sensor)
    text = text.replace(*SIMULATED_MASS) if adapter == "unix" else text
    if position == "drive" and (drive, sensor) in ENCODERS:
        text = _without_encoder(text)
    text = _on_adapter(text, drive, adapter, channel)
    if sensor == "load-cell":
        cell = _preset("load_cell")
        text = text[: text.index("    sensor:\n")] + cell[cell.index("    sensor:\n") :]
        text = with_values(text, SLOW)
        text = text if adapter == "unix" else FOLDER.sub("folder: /dev", text)
    return text if sensor_port is None else _with_sensor_port(text, sensor, adapter, sensor_port)


def _with_sensor_port(text: str, sensor: str, adapter: str, port: str) -> str:
    """Return the text with the file of the sensor's serial port below /dev."""
    if sensor not in ON_PORTS or adapter == "unix":
        raise NewRigError(
            f"--sensor-port {port}: only --sensor {' or '.join(ON_PORTS)} on hardware has a port:"
            " take one, or leave the port out"
        )
    return SENSOR_PORT.sub(rf'\g<1>"{port.removeprefix("/dev/")}"', text)


def handle_text(drive: str, adapter: str, channel: str | None) -> str:
    """Return the text of an operator's device that is one drive. Raises NewRigError."""
    _refuse_unknown(
        ("--handle with --drive", drive, HANDLES), ("--adapter", adapter, tuple(CHANNELS))
    )
    _refuse_adapter(drive, adapter)
    at = channel or ("handle" if adapter == "unix" else None)
    return _on_adapter(_preset(drive, "_handle"), drive, adapter, at)


def refuse_unknown_kinds(drive: str | None, adapter: str | None, sensor: str | None) -> None:
    """Raise NewRigError for a kind that does not exist; None is not given yet."""
    _refuse_unknown(
        ("--drive", drive, DRIVES),
        ("--adapter", adapter, tuple(CHANNELS)),
        ("--sensor", sensor, SENSORS),
    )


def _refuse_unknown(*options: tuple[str, str | None, tuple[str, ...]]) -> None:
    for what, given, known in options:
        if given is not None and given not in known:
            raise NewRigError(f"{what} {given}: is not one of {', '.join(known)}")


def _refuse_adapter(drive: str, adapter: str) -> None:
    """Refuse an adapter that does not fit the drive's wire."""
    if drive in ON_LINES and adapter not in {"serial", "unix"}:
        raise NewRigError(f"{drive} is on a serial line: take --adapter serial, --channel its port")
    if drive not in ON_LINES and adapter == "serial":
        raise NewRigError(f"{drive} is on a CAN bus: take an adapter for it, such as socketcan")
    if drive == "moteus" and adapter not in WITH_FD:
        raise NewRigError(
            "moteus needs CAN FD: take --adapter fdcanusb, or socketcan with a controller for it "
            "that Linux shows as can0 (mjcanfd-usb does)"
        )


def _on_adapter(text: str, drive: str, adapter: str, channel: str | None) -> str:
    """Return the text with the adapter's interface and channel, named by both."""
    text = re.sub(r"^name: .*$", f"name: {drive} on {adapter}", text, count=1, flags=re.MULTILINE)
    at = channel or CHANNELS[adapter]
    if adapter == "serial":
        text = re.sub(r"(\n +device: )servo.*", rf'\g<1>"{at}"', text)
    text = re.sub(
        r"(\n +interface: )unix.*(\n +channel: )(?:rig|handle).*",
        rf'\g<1>{adapter}\g<2>"{at}"',
        text,
    )
    return text if adapter == "unix" else FOLDER.sub("folder: /dev", LATE.sub("", text))


def _without_encoder(text: str) -> str:
    """Return the mixed rig with the drive's own encoder in place of that beside it."""
    text = ENCODER_NODE.sub("      position: from drive\n", text, count=1)
    text = text.replace("encoder and drive on CANopen", "a drive with its own encoder on CANopen")
    unsafe = "unsafe_i_know: [position_comparison]   # one encoder, without a second one to compare"
    return text.replace("axis:\n", f"{unsafe}\n\naxis:\n", 1)


def _with_sensor(drive: str, sensor: str) -> str:
    """Return a rig with a drive and a force sensor; a load cell has the preset of a wrench."""
    if (drive, sensor) in PRESETS:
        return example_text(PRESETS[drive, sensor])
    return _without_sensor(drive) if sensor == "drive" else _preset(drive)


def _without_sensor(drive: str) -> str:
    """Return a rig whose force is the motor's torque."""
    text = _preset(drive)
    text = text[: text.index("    sensor:\n")]
    text = text.replace(
        ", and a force sensor on a serial port.", "; the motor's torque is the force."
    )
    text = text.replace(", and a force sensor.", "; the motor's torque is the force.")
    text = text.replace("position: from drive\n", f"position: from drive\n{NO_SENSOR}", 1)
    text = re.sub(r"(unsafe_i_know: \[[^]]*)\]", r"\1, force_comparison]", text, count=1)
    return with_values(text, NO_SENSOR_VALUES)


def _preset(drive: str, kind: str = "") -> str:
    """Return the rig that ships with a drive, or as `_handle` the operator's device."""
    text = example_text(PRESETS.get(drive, f"simulated_{drive}") + kind)
    if drive == "cybergear":
        for other, own in CYBERGEAR:
            text = text.replace(other, own)
        text = WATCHDOG.sub("", text)
    return text


def example_text(name: str) -> str:
    """Return a shipped rig's text, with its schema beside it."""
    text = example("rigs", name).read_text(encoding="utf-8")
    return text.replace(f"$schema=../{SCHEMA}", f"$schema={SCHEMA}")
