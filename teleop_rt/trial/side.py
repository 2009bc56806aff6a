"""One side of a trial in a process of its own, and the configs that a daemon runs in turn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from teleop_rt.config.trial import TrialConfig
from teleop_rt.realtime.parent import Emit
from teleop_rt.trial.alone import Alone


@dataclass(slots=True)
class Side:
    """One process of a trial: its config, its ring folder, its run folder, its reports.

    `alone` are the helpers of a side that was started alone; in a run there are none.
    """

    trial: TrialConfig
    ring_folder: Path
    folder: Path
    emit: Emit
    alone: Alone | None

    def finish(self, outcome: dict[str, Any]) -> None:
        """Report the outcome; alone, also write it as a summary, which a disk may refuse."""
        try:
            if self.alone is not None:
                self.alone.finish(outcome)
        finally:
            self.emit("done", **outcome)


@dataclass(slots=True)
class Configs:
    """The config that runs, and the one before, which runs again where a reload is refused.

    Without a `running` one, the next is read from the trial's file. `refusal` is the reason of the
    last refusal, for the status.
    """

    running: TrialConfig | None = None
    before: TrialConfig | None = None
    refusal: str = ""

    def begun(self) -> None:
        """Note that the loop begins: an error from now on is a fault, no refusal."""
        self.before = None

    def reload(self) -> None:
        """Note that the next config is to be read, and this one kept in case it is refused."""
        self.running, self.before, self.refusal = None, self.running, ""

    def refused(self, reason: str) -> None:
        """Go back to the config before."""
        self.running, self.before, self.refusal = self.before, None, reason
