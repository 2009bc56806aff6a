"""A driver of another package: one file, installed as pip does, found by its entry point, run."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from teleop_rt.axis import AxisError, EndOfRecording, Sample
from teleop_rt.interrupts import Interrupts
from teleop_rt_drivers.in_words import EndedProgram, ForeignAxis, in_words
from teleop_rt_drivers.stamped import StampedAxis

README = Path(__file__).parents[2] / "drivers" / "README.md"
METADATA, SOURCE, RIG = re.findall(
    r"```(?:python|toml|text)\n(# (?:spring_rig\.py|pyproject\.toml|rig\.yaml)\n.*?)```",
    README.read_text(),
    re.DOTALL,
)


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The package of drivers/README.md, built and installed into a folder of its own."""
    tmp_path = tmp_path_factory.mktemp("foreign")
    project, site = tmp_path / "project", tmp_path / "site"
    project.mkdir()
    (project / "spring_rig.py").write_text(SOURCE)
    (project / "pyproject.toml").write_text(METADATA)
    (tmp_path / "rig.yaml").write_text(RIG)
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index",
         "--no-build-isolation", "--target", str(site), str(project)],
        check=True, capture_output=True,
    )  # fmt: skip
    return tmp_path, site


def run(folder: Path, *sites: Path, program: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, sites))}
    return subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=env, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


READ = """
import json
from pathlib import Path
from teleop_rt.axis import Sample
from teleop_rt.config.loader import load_rig
from teleop_rt_drivers import opening, registry
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.findings import worst
rig = load_rig(Path("rig.yaml"), registry.AXIS_SCHEMAS)
now = [0]
axis = opening.open_axis(rig, lambda: now[0])
axis.configure()
axis.arm()
sample, seen = Sample(), []
for _ in range(50):
    now[0] += 1_000_000
    axis.read_into(sample)
    axis.write(0.01)
    seen.append((sample.valid, sample.enabled))
print(json.dumps([worst(check_rig(rig)), sample.position, sample.force, all(v for v, _ in seen)]))
"""


def test_the_example_package_is_found_by_its_entry_point_and_runs(installed):
    done = run(*installed, program=READ)
    assert done.returncode == 0, done.stderr
    verdict, position, force, valid = json.loads(done.stdout)
    assert verdict != "error"
    assert position == 0.01
    assert force == pytest.approx(500.0 * (0.01 - 0.004))
    assert valid


def test_a_package_that_cannot_be_loaded_is_reported_where_a_rig_names_it(installed, tmp_path):
    folder, site = installed
    (tmp_path / "spring_rig.py").write_text("raise RuntimeError('no licence')\n")
    done = run(folder, tmp_path, site, program="print(1)\n" + READ)
    assert done.stdout == "1\n"
    assert done.returncode != 0
    assert "the driver 'spring' of the package spring-rig cannot be loaded" in done.stderr
    assert "RuntimeError: no licence" in done.stderr


def test_a_key_of_the_example_is_checked_as_ours_are(installed, tmp_path):
    wrong = RIG.replace("stiffness_N_per_m: 500", "stifness_N_per_m: 500")
    (tmp_path / "rig.yaml").write_text(wrong)
    done = run(tmp_path, installed[1], program=READ)
    assert "rig.yaml" in done.stderr
    assert "did you mean 'stiffness_N_per_m'" in done.stderr


MS = 1_000_000


class Ramp:
    """An axis that moves on by 1 each ms, with stamps that are `off_ns` from the clock's."""

    def __init__(self, clock) -> None:
        self._clock, self.off_ns, self.frozen_ns = clock, 0, None
        self.counters = {"read": 1}

    def read_into(self, sample):
        now_ns = self._clock[0]
        stamp_ns = self.frozen_ns or now_ns + self.off_ns
        sample.valid, sample.position, sample.force = True, now_ns / MS, 2.0
        sample.stamp_ns = sample.position_stamp_ns = sample.force_stamp_ns = stamp_ns


def ramp(period_ns=MS):
    clock = [1000 * MS]
    axis = Ramp(clock)
    return clock, axis, StampedAxis(axis, "ramp", lambda: clock[0], period_ns)


@pytest.mark.parametrize(
    ("off_ms", "period_ms", "words"),
    [
        (10_000, 1, "the driver stamps the position more than 20 ms ahead of the clock"),
        (-50, 1, "the driver stamps the position more than 20 ms behind the clock"),
        (-50, 12, "the driver stamps the position more than 36 ms behind the clock"),
        (-50, 20, ""),
        (-20, 1, ""),
        (20, 1, ""),
    ],
)
def test_a_sample_stamped_far_from_the_clock_is_missing(off_ms, period_ms, words):
    clock, axis, stamped = ramp(period_ms * MS)
    sample = Sample()
    stamped.read_into(sample)
    assert (sample.valid, sample.stale, sample.position) == (True, "", 1000.0)
    clock[0] += 100 * MS
    axis.off_ns = off_ms * MS
    stamped.read_into(sample)
    assert (sample.valid, sample.stale) == (not words, words)
    assert sample.position == (1000.0 if words else 1100.0)
    assert sample.position_stamp_ns == (1000 * MS if words else (1100 + off_ms) * MS)
    clock[0] += MS
    axis.off_ns = 0
    stamped.read_into(sample)
    assert (sample.valid, sample.stale, sample.position) == (True, "", clock[0] / MS)


def test_a_new_value_with_an_old_stamp_is_missing_and_its_number_not_taken():
    clock, axis, stamped = ramp()
    sample = Sample()
    stamped.read_into(sample)
    stamped.read_into(sample)
    assert sample.valid  # the same value again: a sensor slower than the loop
    axis.frozen_ns = clock[0]
    clock[0] += MS
    stamped.read_into(sample)
    assert not sample.valid
    assert sample.stale == "the driver's position changes, but its stamp does not"
    assert sample.position == 1000.0
    assert stamped.counters == {"read": 1}


class Raising:
    """An axis of which one method raises; `heard` are the calls that came."""

    def __init__(self, call):
        self._call, self.heard = call, []

    def __getattr__(self, name):
        def method():
            self.heard.append(name)
            if name == self._call:
                raise KeyError("my driver broke")

        return method


@pytest.mark.parametrize("call", ["configure", "arm", "stop", "close"])
def test_an_error_of_another_s_driver_is_a_message_with_its_place(call):
    axis = Raising(call)
    with pytest.raises(AxisError) as raised:
        getattr(ForeignAxis(axis, "ramp"), call)()
    said = f"the driver ramp raised KeyError in {call}: 'my driver broke' (test_foreign_driver.py, "
    assert str(raised.value).startswith(said)
    assert str(raised.value).endswith("; correct it there, then start again")
    assert axis.heard == ([call, "stop"] if call == "arm" else [call])


class Ending:
    """An axis whose every call raises `error`, or sends the signal of Ctrl-C."""

    def __init__(self, error):
        self._error = error

    def __getattr__(self, name):
        def method(*_):
            if self._error is None:
                signal.raise_signal(signal.SIGINT)
            raise self._error

        return method


@pytest.mark.parametrize("error", [SystemExit(3), KeyboardInterrupt("mine"), GeneratorExit()])
def test_a_driver_that_ends_the_program_is_an_error_like_any_other(error):
    axis = StampedAxis(Ending(error), "ramp", lambda: 0, MS)
    said = f"{type(error).__name__}: {error}"
    with Interrupts():
        for call, values in (("read_into", [Sample()]), ("write", [0.0])):
            with pytest.raises(EndedProgram) as raised:
                getattr(axis, call)(*values)
            assert str(raised.value) == said
        for call in ("configure", "arm", "stop", "close"):
            with pytest.raises(AxisError, match=f"the driver ramp raised {type(error).__name__}"):
                getattr(axis, call)()


@pytest.mark.parametrize(("call", "values"), [("read_into", [Sample()]), ("stop", [])])
def test_an_interrupt_that_comes_within_a_driver_is_no_error_of_it(call, values):
    axis = StampedAxis(Ending(None), "ramp", lambda: 0, MS)
    with Interrupts(), pytest.raises(KeyboardInterrupt):
        getattr(axis, call)(*values)


def test_a_package_that_ends_the_program_when_loaded_is_reported(installed, tmp_path):
    folder, site = installed
    (tmp_path / "spring_rig.py").write_text("raise SystemExit('no licence')\n")
    done = run(folder, tmp_path, site, program="print(1)\n" + READ)
    assert "cannot be loaded: SystemExit: no licence" in done.stderr


def test_a_refusal_of_another_s_driver_and_the_end_of_its_recording_stay_what_they_are():
    with pytest.raises(AxisError, match=r"^no sensor; plug it in$"), in_words("ramp", "arm"):
        raise AxisError("no sensor; plug it in")
    with pytest.raises(EndOfRecording), in_words("ramp", "arm"):
        raise EndOfRecording
