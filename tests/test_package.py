import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

from closed_loop import run_into
from trial_files import SILICONE

ROOT = Path(__file__).parents[1]


def shipped(folder):
    """Paths of what a package needs, below its folder."""
    files = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return {path.as_posix() for path in files if "__pycache__" not in path.parts}


def test_the_wheel_holds_all_that_runs_and_reports_need(tmp_path):
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
    for name, folder in (("teleop_rt", ROOT), ("teleop_rt_drivers", ROOT / "drivers")):
        assert shipped(installed / name) == shipped(folder / name)
    # The kernels would be compiled anew at a new place, so no trial runs there: its report does.
    run_into(elsewhere / "run", "duration_s=0.3", file=SILICONE)
    shutil.copytree(ROOT / "config", elsewhere / "config")
    for arguments in (["check", "config/trials/silicone_cube.yaml"], ["report", "run"]):
        subprocess.run(
            [sys.executable, "-P", "-m", "teleop_rt", *arguments],
            cwd=elsewhere,
            env=os.environ | {"PYTHONPATH": str(installed)},
            check=True,
            capture_output=True,
        )
    assert (elsewhere / "run" / "report.html").stat().st_size > 0
