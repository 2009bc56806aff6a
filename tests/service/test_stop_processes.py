"""A stop reaches the drive within ticks, whatever else real processes ask of the daemon."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from threading import Timer

import pytest
from machine_witness import TRIES

from teleop_rt_dev.service.stop_lab import BUSY, Busy, StopLab

pytestmark = pytest.mark.realtime

MOST_TICKS = 40
"""200 ms, on a machine that others load; behind a check it took 500 and more."""
FROZEN_S = 0.4  # twice the time allowed


def ticks_of(stop_lab: StopLab, busy: Busy) -> list[int]:
    """Return the ticks of each try of a stop, the last of which counts.

    A stop is tried again only where command server or asker lacked a core for all that is too long:
    a machine that others load takes it away for a moment, load of the daemon's own every time.
    """
    tries = list[int]()
    lacked_a_core = True
    while lacked_a_core and len(tries) < TRIES and min(tries, default=MOST_TICKS + 1) > MOST_TICKS:
        taken = stop_lab.stop_while(busy)
        print(taken)
        tries.append(taken.ticks)
        lacked_a_core = taken.ticks - taken.waited_ticks <= MOST_TICKS
    return tries


def frozen_server(stop_lab: StopLab) -> Iterator[None]:
    """Freeze the command server for a while: it hangs, and waits for no core."""
    server = stop_lab.server
    thaw = Timer(FROZEN_S, os.kill, (server, signal.SIGCONT))
    os.kill(server, signal.SIGSTOP)
    thaw.start()
    yield
    thaw.join()


def test_a_stop_is_ordered_within_ticks_while_configs_are_checked_and_floods_come(tmp_path):
    stop_lab = StopLab(tmp_path)
    with stop_lab.running():
        (hung,) = ticks_of(stop_lab, frozen_server)
        assert hung > MOST_TICKS, "no second try excuses a server that hangs"
        taken = {name: ticks_of(stop_lab, busy)[-1] for name, busy in BUSY.items()}
    assert max(taken.values()) <= MOST_TICKS
