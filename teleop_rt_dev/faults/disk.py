"""A disk that is full: a small tmpfs where the machine lets us mount one, else /dev/full."""

from __future__ import annotations

import subprocess
from io import RawIOBase
from pathlib import Path

from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ring_folder import Recorder
from teleop_rt_dev.faults.world import FaultWorld

RECORDER_PERIOD_MS = 50  # as the recorder does


class FullDisk:
    """A folder without a byte of room, until `make_room`."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self._folder = folder
        words = ["/bin/mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", str(folder)]
        self.mounted = subprocess.run(words, check=False, capture_output=True).returncode == 0
        self.recording = folder / "r.mcap"
        if self.mounted:
            with (folder / "filler").open("wb", buffering=0) as filler:
                for chunk in (1 << 16, 1 << 12, 1):
                    self._fill(filler, chunk)
        else:
            self.recording.symlink_to("/dev/full")

    @staticmethod
    def _fill(filler: RawIOBase, chunk: int) -> None:
        try:
            while True:
                filler.write(bytes(chunk))
        except OSError:
            return

    def make_room(self) -> None:
        (self._folder / "filler").unlink()

    def close(self) -> None:
        if self.mounted:
            subprocess.run(["/bin/umount", "-l", str(self._folder)], check=True)


def fill_the_disk(world: FaultWorld) -> None:
    world.kept.disk = FullDisk(world.ring_folder / "disk")
    world.closing.callback(world.kept.disk.close)
    world.kept.recorder = Recorder(
        world.ring_folder, RecordingWriter(world.kept.disk.recording, world.trial.rig.units)
    )
    world.kept.recorder.discover()


def alarmed(world: FaultWorld) -> bool:
    if world.ticks % RECORDER_PERIOD_MS == 0:
        world.kept.recorder.drain()
        world.kept.recorder.flush()
    return "No space left" in world.kept.recorder.alarm


def goes_on_and_loses_nothing(world: FaultWorld) -> str:
    """The loop runs on; once there is room, every row is there."""
    before = world.slave.tick
    world.until(lambda: alarmed(world) and False, 500)
    if world.fault != "none" or world.slave.tick < before + 500:
        return f"the loop was disturbed: {world.state.name}, {world.fault}"
    if not world.kept.disk.mounted:
        return ""
    world.kept.disk.make_room()
    world.kept.recorder.close()
    if world.kept.recorder.alarm or sum(world.kept.recorder.dropped.values()):
        return f"not recovered: {world.kept.recorder.alarm}, {world.kept.recorder.dropped}"
    ticks = read_topics(world.kept.disk.recording, ["/slave"])["/slave"]["tick"]
    whole = ticks.size == ticks[-1] - ticks[0] + 1 and ticks[-1] == world.slave.tick
    return "" if whole else "rows are missing"
