"""A folder of runs of the test's own, and a ring folder beside it."""

import pytest


@pytest.fixture
def run_dir(tmp_path, monkeypatch):
    folder = tmp_path / "run"
    monkeypatch.setenv("TELEOP_RT_RUN_DIR", str(folder))
    return folder


@pytest.fixture
def ring_folder(tmp_path):
    folder = tmp_path / "teleop-rt-1-abc"
    folder.mkdir()
    return folder
