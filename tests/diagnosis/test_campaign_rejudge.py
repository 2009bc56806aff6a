"""Stored candidates are judged again as they were, and otherwise with another level or gate."""

from __future__ import annotations

from pathlib import Path

import pytest

from teleop_rt_dev.campaign import diagnosis, rejudge


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("kept")
    case = ("drawn", diagnosis.plan("single", 1, 91))
    (place / f"{rejudge.name_of(case)}.pickle").write_bytes(rejudge.keep(case))
    return place


def test_nothing_changes_without_a_change(folder: Path) -> None:
    (line,) = rejudge.compare(folder, [], [])
    assert line == "single own: 1 records, 1 answered rightly, 0 judged otherwise"


def test_another_level_changes_the_judgement_and_is_put_back(folder: Path) -> None:
    lines = rejudge.compare(folder, ["CERTAIN_BIC=1e12"], [])
    assert ": moving_surface: ('named', [['moving_surface']]) -> ('unexplained', [])" in lines[0]
    assert lines[-1].endswith("1 judged otherwise")
    assert rejudge.compare(folder, [], [])[-1].endswith("0 judged otherwise")


def test_an_unknown_level_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        rejudge.main([str(folder), "--set", "NO_SUCH_LEVEL=1"])
    assert "unknown level NO_SUCH_LEVEL" in capsys.readouterr().err
