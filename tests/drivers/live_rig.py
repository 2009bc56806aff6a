"""A simulated rig that runs beside the test, on the machine's clock."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager

from rig_bench import plant_config

from teleop_rt_drivers.opening import open_rig


@contextmanager
def serving(rig):
    """The simulated rig on its own bus, in another thread as it is in another process."""
    simulated = open_rig(rig, plant_config(), time.monotonic_ns, 1)
    stop = threading.Event()
    thread = threading.Thread(target=simulated.serve, args=(stop.is_set,))
    thread.start()
    try:
        yield simulated
    finally:
        stop.set()
        thread.join()
        simulated.close()


def cycles_until(axis, sample, done, most=5000):
    """Cycles at about 1 kHz until `done()`; the real clock paces, nothing is timed."""
    for _ in range(most):
        axis.read_into(sample)
        axis.write(0.0)
        if done():
            return True
        threading.Event().wait(0.001)
    return False
