"""After a fault the last second before it is in the recording, also where nobody had drained it."""

from contextlib import closing

import numpy as np

from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ring_folder import Recorder
from teleop_rt.slave.faults import State
from teleop_rt_dev.faults.world import FaultWorld


def test_the_last_second_before_a_fault_is_recorded_tick_by_tick(tmp_path):
    recording = tmp_path / "r.mcap"
    with closing(FaultWorld(tmp_path, "canopen", 1)) as world:
        world.lead_to("contact")
        recorder = Recorder(tmp_path, RecordingWriter(recording, world.trial.rig.units))
        world.until(lambda: False, 900)
        world.rig.inject("emergency", "drive")
        assert world.until(lambda: world.state is State.FAULT, 500) > 0
        recorder.close()
    slave = read_topics(recording, ["/slave"])["/slave"]
    fault = int(np.flatnonzero(slave["fault"] > 0)[0])
    before = slave["tick"][fault - 1000 : fault]
    assert np.array_equal(before, slave["tick"][fault] - np.arange(1000, 0, -1))
    assert np.all(slave["state"][fault - 900 : fault] == State.RUN)
    assert slave["state"][-1] == State.FAULT
    assert recorder.dropped["/slave"] == 0
