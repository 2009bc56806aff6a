"""The axis of another package's driver, whose stamps are checked: ours check their own."""

from __future__ import annotations

from collections.abc import Callable

from teleop_rt.axis import Axis, Sample
from teleop_rt_drivers.in_words import ForeignAxis

FAR_MS = 20.0
"""A stamp that is further from the clock is no time of this sample: as long no sample may lack."""
_FAR_PERIODS = 3
"""Periods of a sensor slower than the loop for which its value may be held."""
_KEPT = ("position", "force", "stamp_ns", "position_stamp_ns", "force_stamp_ns")


class StampedAxis(ForeignAxis):
    """An axis whose sample counts as missing if a stamp of it is far from the clock, or is old.

    Old is a stamp that stays the same while its value changes. The numbers are then the last good
    ones, and `stale` is the reason.
    """

    def __init__(
        self, axis: Axis, driver: str, now_ns: Callable[[], int], sample_period_ns: int
    ) -> None:
        super().__init__(axis, driver)
        self._now_ns = now_ns
        self._far_ns = max(round(FAR_MS * 1e6), _FAR_PERIODS * sample_period_ns)
        self._good = Sample()

    def read_into(self, sample: Sample) -> None:
        """Latch the next sample. Raises EndOfRecording, and the driver's errors as Exception."""
        super().read_into(sample)
        if not sample.valid:
            return
        sample.stale = self._wrong(sample)
        sample.valid = not sample.stale
        source, target = (self._good, sample) if sample.stale else (sample, self._good)
        for name in _KEPT:
            setattr(target, name, getattr(source, name))

    def _wrong(self, sample: Sample) -> str:
        """Return the error in the stamps, in the same words as long as it lasts; empty without."""
        now_ns, good = self._now_ns(), self._good
        for name, stamp_ns, before_ns, changes in (
            ("position", sample.position_stamp_ns, good.position_stamp_ns,
             sample.position != good.position),
            ("force", sample.force_stamp_ns, good.force_stamp_ns, sample.force != good.force),
        ):  # fmt: skip
            if stamp_ns == before_ns and changes:
                return f"the driver's {name} changes, but its stamp does not"
            if abs(stamp_ns - now_ns) > self._far_ns:
                side = "ahead of" if stamp_ns > now_ns else "behind"
                far_ms = self._far_ns * 1e-6
                return f"the driver stamps the {name} more than {far_ms:g} ms {side} the clock"
        return ""
