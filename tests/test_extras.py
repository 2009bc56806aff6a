"""Missing packages are named as the metadata of the program has them, wherever it came from."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions

import pytest

from teleop_rt import extras
from teleop_rt_dev.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DECLARED = PROJECT["optional-dependencies"]
COME_WITH_ANOTHER = {"pydantic-core", "llvmlite", "tornado"}
"""Imported parts of pydantic, numba and bokeh, each in the version that these require."""
PROGRAMS = {"dask", "mkdocs-material", "latex2mathml"}
"""Started as programs (dask) or by the documentation, whose tools are in no wheel."""


def imported():
    """Return the names of the packages of others that the program imports, at the top or later."""
    found, packages = set(), packages_distributions()
    for folder in ("teleop_rt", "drivers/teleop_rt_drivers"):
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    found |= {alias.name for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and not node.level:
                    found.add(node.module)
    names = {name.partition(".")[0] for name in found} - sys.stdlib_module_names
    names -= {"teleop_rt", "teleop_rt_drivers"}
    return {named(one) for name in names for one in packages.get(name, [name])}


def named(requirement):
    """Return the name of a required package as all indexes write it."""
    return re.match(r"[\w.-]+", requirement)[0].lower().replace("_", "-")


def test_what_an_installation_brings_is_what_the_program_imports():
    used = {extra for extra in DECLARED if extra not in {"test", "check"}}
    extras_of_users = [one for extra in used for one in DECLARED[extra]]
    declared = {named(one) for one in (*PROJECT["dependencies"], *extras_of_users)}
    assert imported() - declared == COME_WITH_ANOTHER
    assert declared - imported() == PROGRAMS


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
