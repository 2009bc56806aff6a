"""The packages built from the source tree, and an installed wheel without the tree."""

import contextlib
import json
import os
import pty
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).parents[1]
REPORTED = {"recording.mcap", "report.html", "summary.json", "trial.yaml"}


def shipped(folder):
    """Paths of a package's files, below its folder and the folders that it links to."""
    found = set()
    for place, _, files in os.walk(folder, followlinks=True):
        if "__pycache__" not in place:
            found |= {Path(place, name).relative_to(folder).as_posix() for name in files}
    return found


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Wheel and sdist, the wheel built from the unpacked sdist."""
    folder = tmp_path_factory.mktemp("built")
    ignored = shutil.ignore_patterns(".*", "runs", "build", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, folder / "source", ignore=ignored, symlinks=True)
    subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, folder / "source"],
        check=True,
        capture_output=True,
    )
    shutil.rmtree(folder / "source")
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return SimpleNamespace(wheel=wheel, sdist=sdist)


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """Call a command of the wheel, installed where no source tree is, in an empty folder.

    Its environment borrows the wheel's dependencies, so that nothing is downloaded; the source
    tree, which is installed there as editable, is not among that.
    """
    folder = tmp_path_factory.mktemp("installed")
    environment, empty = folder / "environment", folder / "empty"
    empty.mkdir()
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    python = environment / "bin" / "python"
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps",
         "--no-index", "--no-compile", built.wheel],
        check=True,
        capture_output=True,
    )  # fmt: skip
    (packages,) = environment.glob("lib/python*/site-packages")
    (packages / "borrowed.pth").write_text(sysconfig.get_path("purelib"))
    clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}

    def calling(*arguments, program="teleop-rt", **options):
        return subprocess.run(
            [environment / "bin" / program, *map(str, arguments)],
            cwd=empty, env=clean, text=True, check=False,
            **({"capture_output": True} | options),
        )  # fmt: skip

    result = calling("-c", "import teleop_rt; print(teleop_rt.__file__)", program="python")
    assert Path(result.stdout.strip()).is_relative_to(packages)
    return SimpleNamespace(call=calling, folder=empty)


def test_the_wheel_holds_all_that_runs_and_reports_need(built, tmp_path):
    zipfile.ZipFile(built.wheel).extractall(tmp_path)  # noqa: S202 - our own
    packages = {path.name for path in tmp_path.iterdir() if path.suffix != ".dist-info"}
    assert packages == {"teleop_rt", "teleop_rt_drivers"}
    for name, folder in (("teleop_rt", ROOT), ("teleop_rt_drivers", ROOT / "drivers")):
        assert shipped(tmp_path / name) == shipped(folder / name)
    config = {path for path in shipped(tmp_path) if path.startswith("teleop_rt/examples/")}
    for path in config:
        source = ROOT / "config" / path.removeprefix("teleop_rt/examples/")
        assert (tmp_path / path).read_bytes() == source.read_bytes()
    assert "teleop_rt/examples/trials/silicone_cube.yaml" in config


def test_wheel_and_sdist_say_whose_they_are_and_under_which_licence(built):
    inside = zipfile.ZipFile(built.wheel)
    (metadata,) = (name for name in inside.namelist() if name.endswith(".dist-info/METADATA"))
    result = inside.read(metadata).decode()
    assert "License-Expression: Apache-2.0" in result
    assert "Author: teleop-rt developers" in result
    assert "Keywords: teleoperation" in result
    licence = inside.read(metadata.replace("METADATA", "licenses/LICENSE"))
    assert licence == (ROOT / "LICENSE").read_bytes()
    assert b"Apache License" in licence
    with tarfile.open(built.sdist) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    config = {f"config/{name}" for name in shipped(ROOT / "config")}
    assert held >= {"LICENSE", "CITATION.cff", "CHANGELOG.md", "pyproject.toml"} | config


def test_an_installed_wheel_runs_a_trial_by_its_name_in_an_empty_folder(installed):
    done = installed.call(
        "run", "silicone_cube", "--clock", "simulated", "--duration", 0.3, "--out", "run", "--json",
        "--set", "estimation.models=[kelvin-voigt]",
    )  # fmt: skip
    assert done.returncode == 0
    phases = ["silicone_cube: starting", "reading the recording", "writing the report"]
    assert done.stderr.splitlines() == [f"{phase} ..." for phase in phases]
    assert json.loads(done.stdout)["trial"] == "silicone_cube"
    assert {path.name for path in (installed.folder / "run").iterdir()} >= REPORTED


def test_an_installed_wheel_copies_a_trial_that_then_is_checked_and_runs(installed):
    done = installed.call("new", "mine", "--trial", "handle", "--rig", "simulated_serial")
    assert done.returncode == 0, done.stderr
    trial = installed.folder / "mine" / "trials" / "handle.yaml"
    rigs = {path.stem for path in (installed.folder / "mine" / "rigs").iterdir()}
    assert rigs == {"simulated_serial", "simulated_handle"}
    assert "rig: ../rigs/simulated_serial.yaml" in trial.read_text()
    assert installed.call("check", trial).returncode == 0
    before = trial.read_text()
    again = installed.call("new", "mine", "--trial", "handle")
    assert again.returncode == 2
    assert "already exists: name another folder" in again.stderr
    assert trial.read_text() == before


def _until_closed(terminal: int) -> str:
    """Return all that a terminal without a writer holds; one read may return its echo alone."""
    found = b""
    with contextlib.suppress(OSError):  # EIO at its end
        while more := os.read(terminal, 1 << 16):
            found += more
    os.close(terminal)
    return found.decode()


def test_new_asks_on_a_terminal(installed):
    ours, theirs = pty.openpty()
    os.write(ours, b"stiffening_foam\n\n")
    done = installed.call("new", "asked", capture_output=False, stdin=theirs, stdout=theirs)
    os.close(theirs)
    asked = _until_closed(ours)
    assert done.returncode == 0
    assert "A foam that stiffens with depth" in asked
    written = {path.name for path in (installed.folder / "asked").rglob("*.yaml")}
    assert written == {"stiffening_foam.yaml", "simulated_canopen.yaml"}


def test_an_installed_wheel_repeats_a_study_outside_any_clone(installed):
    done = installed.call(
        "study", "excitation", "--out", "study", "--duration", 1, "--jobs", 1, "--json"
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["cases"]


@pytest.mark.parametrize("arguments", [("run", "silicon"), ("check", "silicon")])
def test_a_name_of_no_file_and_no_example_is_refused_with_those_there_are(installed, arguments):
    done = installed.call(*arguments)
    assert done.returncode == 2
    assert "silicon: no such file, and no example of that name" in done.stderr
    assert "silicone_cube" in done.stderr
    assert len(done.stderr.splitlines()) == 1
