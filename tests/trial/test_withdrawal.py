"""An extended model that makes an error worse on fresh data is withdrawn, with a word."""

from __future__ import annotations

import pytest

from teleop_rt.offline.withdrawal import keep_or_withdraw, made_worse


def fresh(free_run=(0.08, 0.01), on_line=(0.08, 0.01), felt=(0.07, 0.01), floor=0.002):
    def pair(errors):
        return dict(zip(("before", "after"), errors, strict=True))

    slave = {"free_run": pair(free_run) | {"noise_floor": floor}, "on_line": pair(on_line)}
    return {"slave": slave, "master": pair(felt)}


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        ({}, []),
        ({"felt": (0.0018, 0.0066)}, ["felt at the hand, 0.0018 before, is 0.0066 after"]),
        ({"on_line": (0.03, 0.05)}, ["predicted on-line, 0.0300 before, is 0.0500 after"]),
        ({"free_run": (0.03, 0.05), "felt": (0.03, 0.05)}, ["in free run", "felt at the hand"]),
        ({"felt": (0.0005, 0.0015)}, []),
        ({"felt": (0.05, 0.053)}, []),
        ({"felt": (0.05, None)}, ["felt at the hand, 0.0500 before, is unknown after"]),
        ({"felt": (None, None)}, []),
        ({"felt": (0.0005, 0.0015), "floor": None}, ["felt at the hand"]),
    ],
)
def test_what_an_extended_model_makes_worse_is_said(errors, words):
    found = made_worse(fresh(**errors))
    assert len(found) == len(words)
    assert all(word in one for word, one in zip(words, found, strict=True))


def test_a_withdrawn_model_cannot_be_taken_by_its_name(tmp_path):
    model = tmp_path / "model.yaml"
    model.write_text("effects: []\n")
    kept = keep_or_withdraw(model, fresh())
    assert kept == {"extended_model": str(model), "withdrawn": None}
    assert model.is_file()
    gone = keep_or_withdraw(model, fresh(felt=(0.01, 0.02)))
    assert gone["extended_model"] is None
    assert "felt" in gone["reason"]
    assert [path.name for path in tmp_path.iterdir()] == ["withdrawn.yaml"]
