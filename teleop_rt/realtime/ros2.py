"""Write a recording as ROS 2 reads it: an MCAP with joint states and wrenches, without ROS.

Message definitions are those of sensor_msgs, geometry_msgs, std_msgs and builtin_interfaces, by
their fields alone; mcap-ros2-support encodes them (extra `ros2`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.errors import RecordingError
from teleop_rt.extras import install_command
from teleop_rt.outputs import refuse_existing
from teleop_rt.realtime.export import units_of
from teleop_rt.realtime.reading import read_topics
from teleop_rt.signals import MASTER_TOPIC, SLAVE_TOPIC

Columns = Mapping[str, NDArray[np.float64]]

_RULE = "=" * 80
_HEADER = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINT_STATE = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_HEADER}"""
WRENCH = f"""std_msgs/Header header
geometry_msgs/Wrench wrench
{_RULE}
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_HEADER}"""
SIDES = {
    SLAVE_TOPIC: ("slave", "sample_stamp_ns", "force"),
    MASTER_TOPIC: ("master", "stamp_ns", "rendered_force"),
}
"""Of each topic: the joint's name, the signal of its stamps, and that of its force."""


def export_ros2(recording: Path, out: Path) -> int:
    """Write both sides of a recording as far as they are in it; return the messages written.

    `/SIDE/joint_states` is sensor_msgs/JointState (m or rad), `/SIDE/wrench` is
    geometry_msgs/WrenchStamped: a force along x, or a torque about it on a rotary rig. Stamps are
    the recording's, monotonic. Raises RecordingError, OutputError.
    """
    refuse_existing([out])
    if out.suffix.lower() != ".mcap":
        raise RecordingError(f"{out}: ros2 is written as MCAP: name a file that ends in .mcap")
    try:
        from mcap_ros2.writer import Writer  # noqa: PLC0415 - an extra
    except ImportError:
        raise RecordingError(f"ros2 needs mcap-ros2-support: `{install_command('ros2')}`") from None
    topics = read_topics(recording, list(SIDES))
    if not topics:
        raise RecordingError(f"{recording}: has neither {' nor '.join(SIDES)}: give a run's")
    written = 0
    with out.open("wb") as stream:
        writer: Any = Writer(stream)
        for topic, columns in topics.items():
            rotary = units_of(recording, topic).get("position", ("m", False))[0] == "rad"
            written += _write_side(writer, topic, columns, rotary=rotary)
        writer.finish()
    return written


def _write_side(writer: Any, topic: str, columns: Columns, *, rotary: bool) -> int:
    """Write one side; a row without a new stamp, or without a number, is left out."""
    name, stamp, force = SIDES[topic]
    joint_schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
    wrench_schema = writer.register_msgdef("geometry_msgs/msg/WrenchStamped", WRENCH)
    stamps = columns[stamp].astype(np.int64)
    fresh = np.diff(stamps, prepend=-1) > 0
    fresh &= np.isfinite(columns["position"]) & np.isfinite(columns[force])
    fresh &= columns.get("valid", np.ones(stamps.size)) > 0
    for row in np.flatnonzero(fresh).tolist():
        at_ns = int(stamps[row])
        stamped = {"sec": at_ns // 10**9, "nanosec": at_ns % 10**9}
        header = {"stamp": stamped, "frame_id": name}
        velocity = float(columns["velocity"][row]) if "velocity" in columns else float("nan")
        joint: dict[str, Any] = {
            "header": header,
            "name": [f"{name}_axis"],
            "position": [float(columns["position"][row])],
            "velocity": [velocity] if np.isfinite(velocity) else [],
            "effort": [],
        }
        along, none = (
            {"x": float(columns[force][row]), "y": 0.0, "z": 0.0},
            dict.fromkeys("xyz", 0.0),
        )
        push = {"force": none, "torque": along} if rotary else {"force": along, "torque": none}
        writer.write_message(f"/{name}/joint_states", joint_schema, joint, at_ns, at_ns)
        wrench = {"header": header, "wrench": push}
        writer.write_message(f"/{name}/wrench", wrench_schema, wrench, at_ns, at_ns)
    return 2 * int(np.count_nonzero(fresh))
