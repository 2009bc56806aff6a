"""The axis of another package's driver, whose errors become messages."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from teleop_rt.axis import Axis, AxisError, EndOfRecording, Sample


@contextmanager
def in_words(driver: str, call: str) -> Iterator[None]:
    """Raise AxisError with cause, place and next step for any error of a driver in this call."""
    try:
        yield
    except (AxisError, EndOfRecording):
        raise
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        raise AxisError(
            f"the driver {driver} raised {type(error).__name__} in {call}: {error} "
            f"({Path(at.filename).name}, line {at.lineno}); correct it there, then start again"
        ) from error


class ForeignAxis:
    """An axis whose errors between ticks are messages; those within a tick are the slave's.

    The drive is stopped where it could not be armed.
    """

    def __init__(self, axis: Axis, driver: str) -> None:
        self._axis, self._driver = axis, driver

    def __getattr__(self, name: str) -> Any:
        """Return an attribute beside the interface, such as counters."""
        return getattr(self._axis, name)

    def configure(self) -> None:
        """Find, check and configure the devices. Raises AxisError."""
        with in_words(self._driver, "configure"):
            self._axis.configure()

    def arm(self) -> None:
        """Ask the drive for power. Raises AxisError."""
        try:
            with in_words(self._driver, "arm"):
                self._axis.arm()
        except AxisError:
            with suppress(Exception):  # a driver that fails may fail here, too
                self._axis.stop()
            raise

    def read_into(self, sample: Sample) -> None:
        """Latch the next sample. Raises EndOfRecording, and whatever the driver raises."""
        self._axis.read_into(sample)

    def write(self, position: float) -> None:
        """Command a position [rig unit]. Raises whatever the driver raises."""
        self._axis.write(position)

    def stop(self) -> None:
        """Stop the drive. Raises AxisError for a driver that raises here."""
        with in_words(self._driver, "stop"):
            self._axis.stop()

    def close(self) -> None:
        """Release the devices. Raises AxisError for a driver that raises here."""
        with in_words(self._driver, "close"):
            self._axis.close()
