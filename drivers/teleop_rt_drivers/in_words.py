"""The axis of another package's driver, whose errors become messages."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn

from teleop_rt.axis import Axis, AxisError, EndOfRecording, Sample
from teleop_rt.interrupts import interrupt


class EndedProgram(Exception):  # noqa: N818 - a fault's cause shows it, and there is no more to it
    """Replaces SystemExit, KeyboardInterrupt or their like, which a driver raised in a tick.

    Those would end the program past the slave's stop; this one is a fault of the driver.
    """


def of_a_signal(error: BaseException) -> bool:
    """Return whether an error is the interrupt by a signal, and no doing of the code it came in.

    Python's own handler leaves no frame: under it each KeyboardInterrupt may be of a signal.
    """
    if not isinstance(error, KeyboardInterrupt):
        return False
    frames = [frame.f_code for frame, _ in traceback.walk_tb(error.__traceback__)]
    return (
        interrupt.__code__ in frames
        or signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )


def raise_as_fault(error: BaseException) -> NoReturn:
    """Raise EndedProgram for an error that is no Exception; an interrupt by a signal as it is."""
    if of_a_signal(error):
        raise error
    raise EndedProgram(f"{type(error).__name__}: {error}") from error


@contextmanager
def in_words(driver: str, call: str) -> Iterator[None]:
    """Raise AxisError with cause, place and next step for any error of a driver in this call."""
    try:
        yield
    except (AxisError, EndOfRecording):
        raise
    except BaseException as error:
        if of_a_signal(error):
            raise
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
            with suppress(AxisError):  # a driver that fails may fail here, too
                self.stop()
            raise

    def read_into(self, sample: Sample) -> None:
        """Latch the next sample. Raises EndOfRecording, and the driver's errors as Exception."""
        try:
            self._axis.read_into(sample)
        except Exception:
            raise
        except BaseException as error:  # noqa: BLE001 - it would end the program
            raise_as_fault(error)

    def write(self, position: float) -> None:
        """Command a position [rig unit]. Raises the driver's errors as Exception."""
        try:
            self._axis.write(position)
        except Exception:
            raise
        except BaseException as error:  # noqa: BLE001 - it would end the program
            raise_as_fault(error)

    def stop(self) -> None:
        """Stop the drive. Raises AxisError for a driver that raises here."""
        with in_words(self._driver, "stop"):
            self._axis.stop()

    def close(self) -> None:
        """Release the devices. Raises AxisError for a driver that raises here."""
        with in_words(self._driver, "close"):
            self._axis.close()
