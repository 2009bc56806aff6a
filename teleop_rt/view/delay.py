"""The delay of the link, by the recording: from a model's sending to its receipt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Delays:
    """One entry per model sent: slave's stamp and delay to the master, NaN where never taken in."""

    sent_ns: Array
    delay_ms: Array

    @property
    def jitter_ms(self) -> float | None:
        """Standard deviation of the delay; None with fewer than two arrivals."""
        known = self.delay_ms[np.isfinite(self.delay_ms)]
        return float(np.std(known)) if known.size > 1 else None

    @property
    def median_ms(self) -> float | None:
        """Median delay; None where nothing arrived."""
        known = self.delay_ms[np.isfinite(self.delay_ms)]
        return float(np.median(known)) if known.size else None


def one_way_delays(slave: Mapping[str, Array], master: Mapping[str, Array]) -> Delays | None:
    """Return the delays of a run whose sides share a clock, to one tick of each side.

    Models still under way at the end are left out. None where one side is missing or nothing
    was sent. A master that hears only a newer model counts the one before as lost.
    """
    if not slave or not master:
        return None
    sent_ns, sent = _changes(slave)
    taken_ns, taken = _changes(master)
    sent_ns, sent = sent_ns[sent > 0], sent[sent > 0]
    if sent.size == 0 or taken.size == 0:
        return None
    decided = sent <= taken[-1]
    sent_ns, sent = sent_ns[decided], sent[decided]
    place = np.minimum(np.searchsorted(taken, sent), taken.size - 1)
    arrived = taken[place] == sent
    return Delays(sent_ns, np.where(arrived, (taken_ns[place] - sent_ns) * 1e-6, np.nan))


def _changes(columns: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return stamps and values at which a side's newest model sequence has grown."""
    sequence = columns["model_sequence"]
    grown = np.flatnonzero(np.diff(sequence, prepend=sequence[0]) > 0)
    return columns["stamp_ns"][grown], sequence[grown]
