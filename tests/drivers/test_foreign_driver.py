"""A driver of another package: one file, installed as pip does, found by its entry point, run."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

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
