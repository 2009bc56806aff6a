"""Runs of real processes on the machine's clock: outcomes are asserted, never durations."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from lean_install import without_report
from machine_witness import undisturbed

from teleop_rt.realtime import ring_folder
from teleop_rt.realtime.reading import read_metadata, read_topics
from teleop_rt.realtime.recording import RUN
from teleop_rt.realtime.ring_folder import new_ring_folder
from teleop_rt.slave.faults import State
from teleop_rt_dev.trial.closed_loop import run_into
from teleop_rt_dev.trial.files import SILICONE
from teleop_rt_drivers import bus_folder
from teleop_rt_drivers.bus_folder import sweep_buses

pytestmark = pytest.mark.realtime

IN_CONTACT_HZ = 250
LOOK_S = 0.1
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - the kernel's shared memory


def command(*arguments) -> list[str]:
    return [sys.executable, "-m", "teleop_rt", *map(str, arguments)]


class Running:
    """A `teleop-rt run` under way, and the processes that it started."""

    def __init__(self, out: Path, *arguments, environment: dict[str, str] | None = None) -> None:
        self.out = out
        self.process = subprocess.Popen(
            command("run", SILICONE, "--out", out, *arguments),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )

    def children(self) -> dict[str, int]:
        """Return the process ids of the run's processes, by the names that `ps` shows."""
        found = {}
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit() or int(entry.name) == self.process.pid:
                continue
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
                name = (entry / "comm").read_text().strip()
            except OSError:
                continue
            if str(self.out).encode() in words and not name.endswith("-keeper"):
                found[name] = int(entry.name)
        return found

    def comes_into_contact(self) -> bool:
        """Wait for the recording to hold contact: an event, whenever it comes."""
        recording = self.out / "recording.mcap"
        while self.process.poll() is None:
            slave = read_topics(recording, ["/slave"]) if recording.exists() else {}
            if slave and slave["/slave"]["in_contact"].max() > 0:
                return True
            time.sleep(LOOK_S)
        return False

    def end(self) -> tuple[int, str]:
        _, errors = self.process.communicate()
        return self.process.returncode, errors


def held_up(folder: Path) -> bool:
    """Return whether the slave of a run stopped as a delayed one does."""
    fault = json.loads((folder / "summary.json").read_text())["safety"]["fault"]["name"]
    return fault in {"late_ticks", "samples_lost", "emergency"}


def in_contact(folder: Path, environment: dict[str, str] | None = None) -> Running | None:
    """Return a run that has come into contact; None for one that stopped before."""
    rate = f"rig.rate_hz={IN_CONTACT_HZ}"
    running = Running(folder, "--duration", 60, "--set", rate, environment=environment)
    if running.comes_into_contact():
        return running
    code, errors = running.end()
    assert code == 1
    assert "stopped" in errors
    assert held_up(folder)
    return None


def kelvin_voigt(summary: dict) -> tuple[float, float]:
    (row,) = (row for row in summary["estimators"] if row["model"] == "kelvin-voigt")
    return row["parameters"]["k"]["value"], row["parameters"]["b"]["value"]


def test_three_processes_find_what_the_simulated_clock_finds(tmp_path):
    duration_s, rate_hz = 6, 500  # the second contact is over; half of a slow machine's core

    def attempt(folder):
        trial = ("--duration", duration_s, "--set", f"rig.rate_hz={rate_hz}", "--out", folder)
        done = subprocess.run(
            command("run", SILICONE, "--json", *trial), env=without_report(folder.parent),
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            assert held_up(folder)
            return None
        return json.loads(done.stdout)

    real = undisturbed(tmp_path, rate_hz, attempt)
    changes = (f"duration_s={duration_s}", f"rig.rate_hz={rate_hz}")
    simulated = run_into(tmp_path / "simulated", *changes, file=SILICONE)
    (k_real, b_real), (k_simulated, b_simulated) = kelvin_voigt(real), kelvin_voigt(simulated)
    assert k_real == pytest.approx(k_simulated, rel=0.01)
    assert b_real == pytest.approx(b_simulated, abs=2.0)
    assert real["clock"] == "real"
    assert real["start_up_s"] > 0.0
    assert simulated["start_up_s"] is None
    assert real["wake_latency_us"]["p50"] > 0
    assert real["work_us"]["max"] >= real["work_us"]["p99"] >= real["work_us"]["p50"] > 0
    assert real["recorder"]["dropped"]["/slave"] == 0
    lags = [summary["master"]["lag_ms"] for summary in (real, simulated)]
    print(f"k {k_real} / {k_simulated}, b {b_real} / {b_simulated}, lag [ms] {lags}")


@pytest.mark.parametrize(
    ("victim", "how"),
    [
        ("master", signal.SIGKILL),
        ("slave", signal.SIGKILL),
        ("sim", signal.SIGKILL),
    ],
)
def test_a_process_that_ends_early_ends_the_run_and_leaves_a_readable_recording(
    tmp_path, victim, how
):
    def attempt(folder):
        running = in_contact(folder, without_report(tmp_path))
        if running is None:
            return None
        if (process := running.children().get(victim)) is not None:
            os.kill(process, how)
        code, errors = running.end()
        if victim not in errors and held_up(folder):
            return None
        return running, code, errors

    running, code, errors = undisturbed(tmp_path, IN_CONTACT_HZ, attempt)
    assert code == 1
    assert victim in errors
    assert "no report.html" in errors
    assert not running.children()
    slave = read_topics(running.out / "recording.mcap", ["/slave"])["/slave"]
    assert slave["tick"].size > 100
    assert json.loads((running.out / "summary.json").read_text())["trial"] == "silicone_cube"
    if victim == "master":
        assert slave["state"][-1] == State.DISARMED


def test_a_recorder_that_is_killed_is_followed_by_another_and_every_tick_is_recorded(tmp_path):
    def attempt(folder):
        running = in_contact(folder)
        if running is None:
            return None
        if (recorder := running.children().get("recorder")) is not None:
            os.kill(recorder, signal.SIGKILL)
        second = folder / "recording.part0002.mcap"
        while running.process.poll() is None:
            if second.exists() and second.stat().st_size > 5000:
                running.process.send_signal(signal.SIGINT)
                running.end()
                return folder
            time.sleep(0.05)
        running.end()
        assert held_up(folder)
        return None

    folder = undisturbed(tmp_path, IN_CONTACT_HZ, attempt)
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["recorder"]["restarts"] == 1
    assert set(summary["recorder"]["dropped"].values()) == {0}
    assert "the recorder ended unexpectedly once" in summary["notes"][0]
    ticks = read_topics(folder / "recording.mcap", ["/slave"])["/slave"]["tick"]
    missing = int(ticks[-1] - ticks[0]) + 1 - ticks.size
    assert missing == summary["missed_ticks"]
    page = (folder / "report.html").read_text()
    assert "the recorder ended unexpectedly once" in page


def test_ctrl_c_ends_a_run_cleanly_with_a_summary(tmp_path):
    def attempt(folder):
        running = in_contact(folder)
        if running is None:
            return None
        running.process.send_signal(signal.SIGINT)
        code, errors = running.end()
        if code == 1 and held_up(folder):
            return None
        return running, code, errors

    running, code, errors = undisturbed(tmp_path, IN_CONTACT_HZ, attempt)
    assert code == 0
    assert errors.splitlines() == [
        "silicone_cube: starting ...",
        "interrupted: the axis is off; writing summary and report",
        "reading the recording ...",
        "writing the report ...",
    ]
    assert not running.children()
    summary = json.loads((running.out / "summary.json").read_text())
    assert summary["safety"]["state"] == "DISARMED"
    assert summary["interrupted"]
    recorded = read_metadata(running.out / "recording.mcap", RUN)
    assert recorded is not None
    assert recorded["began_at"] == summary["began_at"]
    assert summary["grades"]["loop"] == "attention"
    assert summary["notes"][-1].startswith("interrupted after ")
    assert summary["duration_s"] < 55


def test_an_interrupt_at_start_up_leaves_nothing_behind(tmp_path):
    running = Running(tmp_path / "run", "--duration", 60)
    while not running.out.exists():
        time.sleep(0.02)
    running.process.send_signal(signal.SIGTERM)
    code, errors = running.end()
    began = errors.removeprefix("silicone_cube: starting ...\n")
    assert (code, began) == (130, "interrupted before the trial began\n")
    assert not running.out.exists()
    assert not running.children()
    assert not list(SHARED_MEMORY.glob(f"teleop-rt-{running.process.pid}-*"))


def test_a_killed_run_takes_its_processes_with_it(tmp_path, own_shared_memory):
    def attempt(folder):
        running = in_contact(folder, own_shared_memory)
        if running is None:
            return None
        children = running.children()
        running.process.kill()
        running.process.communicate()
        return (running, children) if "slave" in children else None

    running, children = undisturbed(tmp_path, IN_CONTACT_HZ, attempt)
    assert set(children) == {"recorder", "sim", "slave", "master"}
    for child in children.values():
        while Path(f"/proc/{child}").exists() and b"Z" not in state_of(child):
            time.sleep(0.05)
    processes = [running.process.pid, *children.values()]
    assert left_by(processes, tmp_path)
    with new_ring_folder():  # as at the next start
        sweep_buses()
    assert not left_by(processes, tmp_path)


@pytest.fixture
def own_shared_memory(tmp_path, monkeypatch):
    """Return an environment whose runs share the files of `tmp_path`, as this process does.

    The run of another test would remove from shared memory the files of a killed one.
    """
    at_start_up = tmp_path / "python"
    at_start_up.mkdir()
    (at_start_up / "sitecustomize.py").write_text(
        "from pathlib import Path\n"
        "from teleop_rt.realtime import leftovers\n"
        f"leftovers.shared_folder = lambda: Path({str(tmp_path)!r})\n"
    )
    for module in (ring_folder, bus_folder):
        monkeypatch.setattr(module, "shared_folder", lambda: tmp_path)
    path = os.pathsep.join(filter(None, (str(at_start_up), os.environ.get("PYTHONPATH"))))
    return os.environ | {"PYTHONPATH": path}


def left_by(processes: list[int], shared_memory: Path) -> list[Path]:
    """Return the files of these processes that are left in shared memory."""
    found = [shared_memory.glob(f"teleop-rt-{pid}-*") for pid in processes]
    found += [shared_memory.glob(f"can-*/{pid}-*.can") for pid in processes]
    return [path for paths in found for path in paths]


def state_of(process: int) -> bytes:
    try:
        return Path(f"/proc/{process}/stat").read_bytes().split()[2]
    except OSError:
        return b"Z"


def test_a_run_with_a_simulated_handle_says_what_the_handle_truly_did(tmp_path):
    """It ended with handle_device: the first tick took longer than a node may be silent."""
    trial = SILICONE.with_name("handle.yaml")
    out = tmp_path / "run"
    arguments = ("--duration", 3, "--out", out, "--json", "--set", "link.round_trip_ms=0")
    done = subprocess.run(
        command("run", trial, *arguments), env=without_report(tmp_path),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    truth = json.loads((out / "truth.json").read_text())
    assert truth["environment"]["stiffness"] == 3600.0
    recorded = read_topics(out / "recording.mcap", ["/truth/handle"])["/truth/handle"]
    assert recorded["position"].max() > 0.0137
    assert truth["handle"]["energy_J"] == pytest.approx(recorded["hand_energy"][-1], abs=0.05)
    assert json.loads(done.stdout)["master"]["true_port"]["motor_nrmse"] < 0.1
