"""A folder of recordings with known answers: the grade of an answer, and the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from teleop_rt_dev.campaign import keyed as campaign


@pytest.mark.parametrize(
    ("truth", "tied", "verdict", "sets", "worth"),
    [
        ("none", "", "no_missing_effect", [], "right"),
        ("none", "", "unexplained", [], "honest"),
        ("none", "", "partial", [["adhesion"]], "wrong"),
        ("outside:chatter", "", "unexplained", [], "right"),
        ("outside:chatter", "", "partial", [["adhesion"]], "right"),
        ("outside:chatter", "", "no_missing_effect", [], "honest"),
        ("outside:chatter", "", "class", [["adhesion"], ["delay"]], "wrong"),
        ("delay", "", "named", [["delay"]], "right"),
        ("delay", "", "class", [["force_lag"], ["delay"]], "right"),
        ("delay", "force_lag", "named", [["force_lag"]], "right"),
        ("delay", "", "named", [["force_lag"]], "wrong"),
        ("delay", "", "error", [], "honest"),
        ("delay+adhesion", "", "named", [["adhesion", "delay"]], "right"),
        ("delay+adhesion", "", "named", [["adhesion"]], "honest"),
        ("delay+adhesion", "", "partial", [["adhesion"]], "honest"),
        ("delay+adhesion", "", "named", [["adhesion", "backlash"]], "wrong"),
        ("delay+adhesion", "backlash", "named", [["backlash"]], "right"),
    ],
)
def test_the_worth_of_an_answer_follows_from_the_key(
    truth: str, tied: str, verdict: str, sets: list[list[str]], worth: str
) -> None:
    assert campaign.worth({"truth": truth, "tied": tied}, verdict, sets) == worth


def test_a_folder_is_diagnosed_by_its_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(3000) * 2e-3
    x = 1e-3 * np.sin(7.0 * t) + 4e-4 * np.sin(23.0 * t)
    noise = 0.01 * np.random.default_rng(3).standard_normal(t.size)
    plain = 900.0 * x + noise
    for name, force in (("plain", plain), ("rubs", plain + 0.3 * np.sign(np.gradient(x)))):
        rows = np.column_stack([t, x, force])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,x,f", comments="")
    (tmp_path / "key.csv").write_text(
        "name,group,base,truth\n"
        'plain,null,"spring,viscous,bias",none\n'
        'rubs,single,"spring,viscous,bias",coulomb_friction\n'
        'gone,single,"spring,viscous,bias",delay\n',
        encoding="utf-8",
    )
    assert campaign.main([str(tmp_path), "--only", "plain", "rubs"]) == 0
    table = capsys.readouterr().out
    assert "| null | 1 | 1 | 1 | 0 | 0 | 0 |" in table
    assert "| single | 1 | 1 | 1 | 1 | 0 | 0 |" in table
    assert "1 of 1" in table[table.index("0.95 to 1.00") :].splitlines()[0]
    (gone,) = [campaign.row(entry) for entry in campaign.entries(tmp_path, ["gone"])]
    assert (gone["verdict"], gone["worth"]) == ("error", "honest")
