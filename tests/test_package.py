import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_the_wheel_holds_all_that_the_default_trial_needs(tmp_path):
    source = tmp_path / "source"
    ignored = shutil.ignore_patterns(".*", "runs", "build", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, source, ignore=ignored)
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path, source],
        check=True,
        capture_output=True,
    )
    (wheel,) = tmp_path.glob("*.whl")
    installed, elsewhere = tmp_path / "installed", tmp_path / "elsewhere"
    zipfile.ZipFile(wheel).extractall(installed)
    packages = {path.name for path in installed.iterdir() if path.suffix != ".dist-info"}
    assert packages == {"teleop_rt", "teleop_rt_drivers"}
    shutil.copytree(ROOT / "config", elsewhere / "config")
    arguments = ["run", "config/trials/silicone_cube.yaml", "--clock", "simulated"]
    done = subprocess.run(
        [sys.executable, "-P", "-m", "teleop_rt", *arguments, "--duration", "0.3", "--json"],
        cwd=elsewhere,
        env=os.environ | {"PYTHONPATH": str(installed)},
        check=True,
        capture_output=True,
        text=True,
    )
    assert json.loads(done.stdout)["ticks"] >= 300
    assert list((elsewhere / "runs").glob("*/report.html"))
