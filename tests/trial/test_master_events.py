from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from teleop_rt.link.troubles import TROUBLES
from teleop_rt.master.engagement import LinkState
from teleop_rt.signals import MASTER, columns
from teleop_rt.trial.event_log import EventLog

COLUMN = columns(MASTER)


def rows(count: int, **changes: dict[int, float]) -> np.ndarray:
    """Rows of a master at rest; `changes` say from which row on a signal has which value."""
    table = np.zeros((count, len(MASTER)))
    table[:, COLUMN["stamp_ns"]] = np.arange(count) * 1e6
    table[:, COLUMN["blend"]] = 1.0
    for name, steps in changes.items():
        for first, value in steps.items():
            table[first:, COLUMN[name]] = value
    return table


def events(tmp_path: Path, *blocks: np.ndarray) -> list[dict[str, object]]:
    log = EventLog(tmp_path / "log.jsonl", simulated=True)
    for block in blocks:
        log.watch_master(block)
    log.close()
    return [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]


@pytest.mark.parametrize("split", [0, 25, 50])
def test_an_adoption_is_reported_once_with_the_energy_that_it_took(
    tmp_path: Path, split: int
) -> None:
    table = rows(
        60,
        blend={20: 0.5, 30: 1.0, 40: 0.2, 50: 1.0},
        adoption_energy={20: 0.001, 25: 0.004, 45: 0.010},
        model_sequence={20: 7, 40: 8},
    )
    result = events(tmp_path, table[:split], table[split:])
    assert [event["event"] for event in result] == ["adoption", "adoption"]
    assert [event["energy_J"] for event in result] == pytest.approx([0.004, 0.006])
    assert [event["model_sequence"] for event in result] == [7, 8]


def test_trouble_with_the_link_is_reported_with_its_cause(tmp_path: Path) -> None:
    version = [name for name, _ in TROUBLES].index("version")
    (result,) = events(tmp_path, rows(30, trouble={10: version, 20: 0.0}))
    assert result["trouble"] == "version"
    assert "install the same" in str(result["cause"])


def test_a_change_of_engagement_is_reported_and_refused_models_once(tmp_path: Path) -> None:
    result = events(
        tmp_path,
        rows(
            40,
            state={5: LinkState.ENGAGED, 10: LinkState.FROZEN, 20: LinkState.DECLUTCHED},
            silence_ms={10: 501.0, 20: 2001.0},
            refused_models={30: 1, 32: 7},
        ),
        rows(10, state={0: LinkState.DECLUTCHED}, refused_models={0: 8}),
    )
    assert [event["event"] for event in result] == 3 * ["engagement"] + ["models refused"]
    assert [event.get("state") for event in result[:3]] == ["ENGAGED", "FROZEN", "DECLUTCHED"]
    assert [event["silence_ms"] for event in result[:3]] == [0.0, 501.0, 2001.0]


def test_a_wall_that_the_device_cannot_render_is_reported_with_both_values(tmp_path: Path) -> None:
    (result,) = events(
        tmp_path,
        rows(30, true_stiffness={10: 3600.0}, rendered_stiffness={10: 1000.0}),
        rows(30, true_stiffness={0: 3600.0}, rendered_stiffness={0: 1000.0}),
    )
    assert result["event"] == "passivity"
    assert (result["true_stiffness"], result["rendered_stiffness"]) == (3600.0, 1000.0)
