from __future__ import annotations

from typing import Any

from teleop_rt.study.delay_table import tables


def test_the_tables_name_the_least_error_and_never_one_of_a_mode_that_is_not_always_stable() -> (
    None
):
    def result(mode: str, seed: int, nrmse: float, why: list[str]) -> dict[str, Any]:
        place = {"environment": "foam", "round_trip_ms": 30.0, "loss": 0.1}
        figures = {"nrmse": nrmse, "nrmse_transient": 0.2, "lag_ms": -0.5 * seed}
        return place | figures | {
            "mode": mode, "seed": seed, "stable": not why, "unstable_because": why,
        }  # fmt: skip

    places, modes, shares = tables(
        [
            result("direct", 1, 0.001, []),
            result("direct", 2, 0.001, ["gives energy"]),
            result("model-mediated", 1, 0.02, []),
            result("model-mediated", 2, 0.04, []),
            result("tdpa", 1, 0.01, []),
            result("tdpa", 2, 0.03, []),
        ],
        {("direct", "stiff"): 0.4, ("direct", "foam"): 1.0},
    ).split("\n\n")
    assert places.splitlines()[-1] == "| foam | 30 | 10% | 1 of 2 stable | 0.0300 | **0.0200** |"
    assert "| direct | 2 | 1 | 0.001 | 0.2 | 0.5 | gives energy (1) |" in modes
    assert "| tdpa | 2 | 2 | 0.03 | 0.2 | 1 | - |" in modes
    assert shares.splitlines() == [
        "| share of the force | foam | stiff |",
        "| --- | --- | --- |",
        "| direct | 1.0 | 0.4 |",
    ]
