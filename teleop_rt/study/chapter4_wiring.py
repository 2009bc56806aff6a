"""Parts that the command line provides to the studies, because only it knows the drivers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teleop_rt.config.trial import TrialConfig
    from teleop_rt.trial.bench import OpenBench


@dataclass(frozen=True, slots=True)
class Wiring:
    """Functions that load a trial file with overrides and open its simulated rig."""

    load_trial: Callable[[Path, list[str] | None], TrialConfig]
    open_bench: OpenBench
