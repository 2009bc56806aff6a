"""A table may be as slow as a testing machine's if it states its unit of time."""

from pathlib import Path

import numpy as np
import pytest

import teleop_rt
from teleop_rt.errors import RecordingError


def table(path: Path, rate_hz: float, time: str) -> Path:
    t = np.arange(600) / rate_hz
    x = 2e-3 * (1.0 - np.cos(2.0 * np.pi * 0.02 * t))
    header = f"{time},x [m],F [N]"
    np.savetxt(path, np.c_[t, x, 1500.0 * x], delimiter=",", header=header, comments="")
    return path


def test_a_table_at_2_hz_is_read_if_its_unit_of_time_is_stated(tmp_path: Path) -> None:
    recording = teleop_rt.read(table(tmp_path / "slow.csv", 2.0, "t [s]"))
    assert "600 samples at 2 Hz" in repr(recording)


@pytest.mark.parametrize(("rate_hz", "time"), [(2.0, "t"), (1.8, "t [s]")])
def test_a_slower_one_or_one_without_a_unit_is_taken_for_another_unit(
    rate_hz: float, time: str, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError, match="unit"):
        teleop_rt.read(table(tmp_path / "slow.csv", rate_hz, time))
