"""Files of scripts/install_service in a folder, checked offline by systemd's own tools."""

import os
import shutil
import stat
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UNITS = Path("/usr/lib/systemd/system")
needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None or not UNITS.is_dir(),
    reason="systemd-analyze is not installed",
)


def install(root: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [ROOT / "scripts" / "install_service", "--root", root, *arguments],
        env={**os.environ, "TELEOP_RT_NO_VENV": "1", **variables},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def root(tmp_path):
    done = install(tmp_path)
    assert done.returncode == 0, done.stderr
    return tmp_path


def with_program(root: Path) -> Path:
    """Put the unit's program and the system's own units into the root; return a trial's unit."""
    shutil.copytree(UNITS, root / "usr/lib/systemd/system", symlinks=True)
    program = root / "opt/teleop-rt/bin/teleop-rt"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    folder = root / "etc/systemd/system"
    return shutil.copy(folder / "teleop-rt@.service", folder / "teleop-rt@cube.service")


def analyze(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [
            str(shutil.which("systemd-analyze")),
            f"--root={root}",
            "--no-pager",
            *arguments,
            "teleop-rt@cube.service",
        ],
        capture_output=True,
        text=True,
        check=False,
    )


@needs_systemd
def test_systemd_finds_nothing_wrong_with_the_unit_and_its_exposure_is_at_most_1_5(root):
    unit = Path(with_program(root))
    verified = analyze(root, "verify")
    assert "teleop-rt" not in verified.stderr, verified.stderr
    judged = analyze(root, "security", "--offline=yes", "--threshold=15")
    assert judged.returncode == 0, judged.stdout
    print(judged.stdout.strip().splitlines()[-1])
    unit.write_text(unit.read_text().replace("WatchdogSec=3s", "WatchdogSec=soon"))
    assert "Failed to parse sec value" in analyze(root, "verify").stderr
    unit.write_text(unit.read_text().replace("ProtectSystem=strict", "ProtectSystem=no"))
    unit.write_text(unit.read_text().replace("CapabilityBoundingSet=\n", ""))
    assert analyze(root, "security", "--offline=yes", "--threshold=15").returncode != 0


def test_the_unit_asks_for_what_the_daemon_needs(root):
    unit = (root / "etc/systemd/system/teleop-rt@.service").read_text()
    for line in (
        "Type=notify",
        "WatchdogSec=3s",
        "CPUSchedulingPolicy=fifo",
        "LoadCredential=link.key:/etc/teleop-rt/keys/%i.key",
        "ExecStopPost=-/opt/teleop-rt/bin/teleop-rt make-safe /etc/teleop-rt/trials/%i.yaml",
        "ExecReload=/opt/teleop-rt/bin/teleop-rt reload --pid ${MAINPID}",
        "CacheDirectory=teleop-rt",
        "IPAddressDeny=any",
        "IPAddressAllow=localhost",
        "MemoryMax=1500M",
        "TasksMax=64",
        "OOMPolicy=continue",
        "ProcSubset=pid",
        *(f"DeviceAllow=char-tty{kind} rw" for kind in ("S", "USB", "ACM", "AMA")),
        "Environment=NUMBA_CACHE_DIR=/var/cache/teleop-rt PYTHONUNBUFFERED=1",
    ):
        assert line in unit.splitlines()
    assert "MemoryDenyWriteExecute=yes" not in unit
    assert "@PROGRAM@" not in unit
    assert stat.S_IMODE((root / "etc/teleop-rt/keys").stat().st_mode) == 0o700


def test_programs_name_the_python_that_is_theirs_once_the_folder_is_the_root(tmp_path):
    folder = tmp_path / "opt/teleop-rt/bin"
    folder.mkdir(parents=True)
    (folder / "python").symlink_to("/usr/bin/python3")
    (folder / "teleop-rt").write_text(f"#!{folder}/python\nimport sys\n")
    done = install(tmp_path)
    assert (folder / "teleop-rt").read_text() == "#!/opt/teleop-rt/bin/python\nimport sys\n"
    assert (folder / "python").is_symlink()
    assert f"where {tmp_path} is the root" in done.stderr
    assert "/opt/teleop-rt/bin/teleop-rt keygen /etc/teleop-rt/keys/TRIAL.key" in done.stderr


def test_the_command_is_on_the_path_and_one_that_is_not_ours_is_left_alone(root, tmp_path):
    command = root / "usr/local/bin/teleop-rt"
    assert str(command.readlink()) == "/opt/teleop-rt/bin/teleop-rt"
    command.unlink()
    command.write_text("another's")
    assert install(root).returncode == 0
    assert install(root, "--remove").returncode == 0
    assert command.read_text() == "another's"


def test_a_python_in_somebodys_home_which_the_service_cannot_see_is_passed_over(tmp_path):
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    for name, base in (("python3.14", "/home/ann/.pyenv"), ("python3.13", "/usr")):
        python = bin_folder / name
        python.write_text(
            "#!/bin/sh\ncase $2 in *base_prefix*) echo "
            f"{base};; *version_info*) ;; *) echo {name} >&2; exit 9;; esac\n"
        )
        python.chmod(0o755)
    people = bin_folder / "getent"
    people.write_text(
        "#!/bin/sh\necho daemon:x:1:1::/usr:\necho proxy:x:13:13::/:\n"
        "echo ann:x:1000:1000:Ann:/home/ann:/bin/sh\n"
    )
    people.chmod(0o755)
    path = f"{bin_folder}:{os.environ['PATH']}"
    done = install(tmp_path / "root", PATH=path, TELEOP_RT_NO_VENV="")
    assert (done.returncode, done.stderr) == (9, "python3.13\n")


def test_a_config_that_was_changed_survives_an_upgrade(root, tmp_path):
    ours = root / "etc/teleop-rt/trials/silicone_cube.yaml"
    kept = "# mine\n" + ours.read_text()
    ours.write_text(kept)
    own = root / "etc/teleop-rt/rigs/bench.yaml"
    own.write_text("name: bench\n")
    untouched = root / "etc/teleop-rt/rigs/simulated_serial.yaml"
    untouched.write_text("old")
    (root / "etc/teleop-rt/.shipped/rigs/simulated_serial.yaml").write_text("old")
    done = install(root)
    assert f"kept your {ours}" in done.stderr
    assert ours.read_text() == kept
    assert own.read_text() == "name: bench\n"
    shipped = ROOT / "config/trials/silicone_cube.yaml"
    assert ours.with_suffix(".yaml.new").read_text() == shipped.read_text()
    assert untouched.read_text() == (ROOT / "config/rigs/simulated_serial.yaml").read_text()


def test_removal_leaves_configs_and_keys_and_purging_leaves_nothing(root):
    (root / "etc/teleop-rt/keys/cube.key").write_text("secret")
    enabled = root / "etc/systemd/system/multi-user.target.wants/teleop-rt@cube.service"
    enabled.parent.mkdir()
    enabled.symlink_to("/etc/systemd/system/teleop-rt@.service")
    assert install(root, "--remove").returncode == 0
    assert not enabled.is_symlink()
    assert not (root / "usr/local/bin/teleop-rt").is_symlink()
    left = {path.relative_to(root).parts[:2] for path in root.rglob("*") if path.is_file()}
    assert left == {("etc", "teleop-rt")}
    assert (root / "etc/teleop-rt/keys/cube.key").read_text() == "secret"
    assert install(root, "--remove", "--purge").returncode == 0
    assert [path for path in root.rglob("*") if path.is_file()] == []


def test_the_service_reaches_this_machine_and_the_peers_that_were_named(root):
    unit = root / "etc/systemd/system/teleop-rt@.service"
    peers = unit.with_name("teleop-rt@.service.d") / "peers.conf"
    assert not peers.exists()
    assert install(root, "--peer", "192.0.2.7", "--peer", "192.0.2.8").returncode == 0
    assert peers.read_text().splitlines() == ["[Service]", "IPAddressAllow=192.0.2.7 192.0.2.8"]
    assert "IPAddressDeny=any" in unit.read_text().splitlines()


def test_help_is_the_usage_and_no_error(tmp_path):
    done = install(tmp_path, "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert "scripts/install_service [--root DIR]" in done.stdout


def test_an_unknown_option_is_refused_with_the_usage(tmp_path):
    done = install(tmp_path, "--wrong")
    assert done.returncode == 2
    assert "scripts/install_service [--root DIR]" in done.stderr


@pytest.mark.skipif(shutil.which("logrotate") is None, reason="logrotate is not installed")
def test_logrotate_reads_its_rules(root):
    rules = (root / "etc/logrotate.d/teleop-rt").read_text()
    rules = rules.replace("/var/lib", str(root / "var/lib")).replace(
        "    su teleop-rt teleop-rt\n", ""
    )
    log = root / "var/lib/teleop-rt/runs/one/log.jsonl"
    log.parent.mkdir(parents=True)
    log.write_text("x" * (11 << 20))
    (root / "rules").write_text(rules)
    done = subprocess.run(
        [str(shutil.which("logrotate")), "-s", root / "state", root / "rules"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert log.stat().st_size == 0
    assert (log.parent / "log.jsonl.1.gz").exists()
