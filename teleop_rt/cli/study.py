"""The studies; the command line passes them the drivers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from typer.main import get_command

from teleop_rt.study.chapter4_wiring import Wiring
from teleop_rt.study.commands import app

if TYPE_CHECKING:
    from teleop_rt.config.trial import TrialConfig
    from teleop_rt.trial.bench import Bench


def _load_trial(trial_file: Path, overrides: list[str] | None) -> TrialConfig:
    from teleop_rt.cli.wiring import load_trial_file  # noqa: PLC0415 - loads compilers and drivers

    return load_trial_file(trial_file, overrides)


def _open_bench(trial: TrialConfig, now_ns: Callable[[], int]) -> Bench:
    from teleop_rt.cli.wiring import open_bench  # noqa: PLC0415 - as above

    return open_bench(trial, now_ns)


study = get_command(app)
study.context_settings["obj"] = Wiring(_load_trial, _open_bench)
