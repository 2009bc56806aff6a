"""Missing packages are named as the metadata of the program has them, wherever it came from."""

import tomllib

import pytest

from teleop_rt import extras
from teleop_rt_dev.paths import ROOT

DECLARED = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


@pytest.mark.parametrize("extra", ["report", "live", "dbc", "dask", "parquet", "ros2", "gs_usb"])
def test_the_command_names_every_package_of_an_extra_and_no_index_of_ours(extra):
    command = extras.install_command(extra)
    for package in DECLARED[extra]:
        assert package in command
    assert "teleop-rt" not in command


def test_a_tree_that_was_never_installed_names_the_extra(monkeypatch):
    def nothing(_name):
        raise extras.PackageNotFoundError

    monkeypatch.setattr(extras, "requires", nothing)
    assert extras.install_command("report") == "pip install 'teleop-rt[report]'"
