"""How much a diagnosis computes: linear fits and predictions, which take most of its time.

The bounds are a twelfth (predictions: a sixth to a quarter) above the counts.
"""

from __future__ import annotations

from typing import Any

import pytest

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference import composed, swings
from teleop_rt.diagnosis.models import fit
from teleop_rt.diagnosis.models.fit import Problem
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.diagnosis.plants import make


class Count:
    """Counts calls of `Problem.solve` and of `force_of`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.fits = self.predictions = 0
        solve, force_of = Problem.solve, fit.force_of

        def counted_solve(*arguments: Any, **keys: Any) -> Any:
            self.fits += 1
            return solve(*arguments, **keys)

        def counted_force(*arguments: Any, **keys: Any) -> Any:
            self.predictions += 1
            return force_of(*arguments, **keys)

        monkeypatch.setattr(Problem, "solve", counted_solve)
        for module in (fit, composed, swings):
            monkeypatch.setattr(module, "force_of", counted_force)


@pytest.mark.parametrize(
    ("effects", "fits", "predictions"),
    [
        ((), 870, 520),
        (("coulomb_friction",), 1350, 1100),
        (("channel_delay", "force_bias"), 2400, 3250),
    ],
)
def test_a_recording_of_ten_seconds_needs_few_fits(
    effects: tuple[str, ...], fits: int, predictions: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = make(31, effects)
    recording = from_arrays("record", record.t, record.position, record.force)
    count = Count(monkeypatch)
    answer = diagnose(recording, record.base).answer
    assert {effect["name"] for effect in answer["effects"]} == {*effects}
    assert count.fits < fits
    assert count.predictions < predictions
