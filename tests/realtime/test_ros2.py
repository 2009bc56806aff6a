"""Recordings as ROS 2 reads them: written without ROS, read back by the reader of MCAP's own."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.outputs import OutputError
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ros2 import export_ros2
from teleop_rt.signals import SLAVE, columns


def recorded(folder, position="m", force="N"):
    """Five ticks of a slave: one invalid, one without a new sample, one of unknown velocity."""
    place, path = columns(SLAVE), folder / "recording.mcap"
    rows = np.zeros((5, len(SLAVE)))
    rows[:, place["stamp_ns"]] = rows[:, place["sample_stamp_ns"]] = 10**12 + 2e6 * np.arange(5)
    rows[:, place["position"]] = 0.01 * np.arange(5)
    rows[:, place["force"]] = 3.5 * np.arange(5)
    rows[:, place["velocity"]] = 0.25
    rows[:, place["valid"]] = 1.0
    rows[1, place["valid"]] = 0.0
    rows[3, place["sample_stamp_ns"]] = rows[2, place["sample_stamp_ns"]]
    rows[4, place["velocity"]] = np.nan
    writer = RecordingWriter(path, Units(position=position, force=force), {})
    writer.add_topic("/slave", SLAVE)
    writer.write_rows("/slave", rows)
    writer.close()
    return path


def read_back(path):
    """Return (topic, schema, stamp, message) of each message, by MCAP's reader for ROS 2."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        return [
            (channel.topic, schema.name, message.log_time, decoded)
            for schema, channel, message, decoded in reader.iter_decoded_messages()
        ]


@pytest.mark.parametrize("rotary", [False, True])
def test_new_and_valid_samples_are_joint_states_and_wrenches(tmp_path, rotary):
    path = recorded(tmp_path, *(("rad", "Nm") if rotary else ("m", "N")))
    out = tmp_path / "ros2.mcap"
    assert export_ros2(path, out) == 6
    messages = read_back(out)
    joints = [one for one in messages if one[0] == "/slave/joint_states"]
    wrenches = [one for one in messages if one[0] == "/slave/wrench"]
    assert {one[1] for one in joints} == {"sensor_msgs/msg/JointState"}
    assert {one[1] for one in wrenches} == {"geometry_msgs/msg/WrenchStamped"}
    for tick, (_, _, stamp_ns, joint), (_, _, _, wrench) in zip(
        (0, 2, 4), joints, wrenches, strict=True
    ):
        assert stamp_ns == 10**12 + 2_000_000 * tick
        assert joint.header.stamp.sec * 10**9 + joint.header.stamp.nanosec == stamp_ns
        assert joint.name == ["slave_axis"]
        assert joint.position == [0.01 * tick]
        assert joint.velocity == ([] if tick == 4 else [0.25])
        along, none = (
            (wrench.wrench.torque, wrench.wrench.force)
            if rotary
            else (wrench.wrench.force, wrench.wrench.torque)
        )
        assert (along.x, along.y, along.z) == (3.5 * tick, 0.0, 0.0)
        assert (none.x, none.y, none.z) == (0.0, 0.0, 0.0)


def test_what_cannot_be_written_is_refused(tmp_path, monkeypatch):
    path = recorded(tmp_path)
    with pytest.raises(OutputError, match="already exists"):
        export_ros2(path, path)
    with pytest.raises(RecordingError, match=r"ends in \.mcap"):
        export_ros2(path, tmp_path / "table.csv")
    monkeypatch.setitem(sys.modules, "mcap_ros2.writer", None)
    with pytest.raises(RecordingError, match=r"pip install .mcap-ros2-support"):
        export_ros2(path, tmp_path / "new.mcap")


def test_the_command_writes_it(tmp_path, call):
    code, out, err = call("export", recorded(tmp_path), tmp_path / "ros2.mcap", "--ros2")
    assert code == 0, err
    assert out.startswith("6 messages in")
