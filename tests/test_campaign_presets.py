"""The table of rigs: which rows hold, and the worst of several runs."""

from __future__ import annotations

from typing import Any

import pytest

from teleop_rt_dev.campaign.presets import HEAD, HEAD_OF_SEEDS, cells, holds, over_seeds


def row(**changes: Any) -> dict[str, Any]:
    found = {
        "rig": "odrive", "k_value": 3610.0, "k_std": 6.0, "b_value": 20.1, "b_std": 0.1,
        "surface_mm": 0.01, "nrmse": 0.004, "rejected": 0, "fault": "none",
    }  # fmt: skip
    return found | changes


NO_SUMMARY = {"rig": "odrive", "fault": "no device on the bus"}


def test_a_row_has_a_cell_for_each_column() -> None:
    for one in (row(), row(k_value=None), NO_SUMMARY):
        assert len(cells(one)) == len(HEAD)
    assert over_seeds([row(), row()]).count("|") == len(HEAD_OF_SEEDS) + 1


@pytest.mark.parametrize(
    "wrong",
    [{"fault": "overspeed"}, {"k_value": 3200.0}, {"surface_mm": -2.0}, {"surface_mm": None}],
)
def test_a_rig_with_a_fault_or_a_wrong_estimate_does_not_hold(wrong: dict[str, Any]) -> None:
    assert holds(row())
    assert not holds(row(**wrong))
    assert not holds(NO_SUMMARY)


def test_of_several_runs_the_worst_is_shown_and_how_often_the_truth_lies_inside() -> None:
    runs = [row(), row(k_value=3480.0, k_std=70.0), row(k_value=3672.0), NO_SUMMARY]
    shown = [cell.strip() for cell in over_seeds(runs).strip("|").split("|")]
    assert dict(zip(HEAD_OF_SEEDS, shown, strict=True)) == {
        "rig": "odrive", "runs": "4", "worst k [%]": "-3.33", "worst surface [mm]": "+0.010",
        "b [N s/m]": "20.10 to 20.10", "k inside": "2 of 3", "b inside": "3 of 3",
        "within bounds": "2 of 4", "faults": "no device on the bus",
    }  # fmt: skip
