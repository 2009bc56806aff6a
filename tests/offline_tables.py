"""A press on a known body as arrays and as a table, for tests of the commands on recordings."""

import numpy as np


def press(duration_s=6.0, rate_hz=1000, noise=0.05, seed=1):
    """A Kelvin-Voigt body, k = 1500, b = 50, surface at 10 mm, pressed with lift-offs."""
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    x = 0.004 + 0.01 * np.sin(2 * np.pi * 1.3 * t) + 0.004 * np.sin(2 * np.pi * 3.1 * t)
    v = np.gradient(x, t)
    force = np.where(x > 0, np.maximum(0.0, 1500 * x + 50 * v), 0.0)
    force += np.random.default_rng(seed).normal(0, noise, t.size)
    return t, 0.010 + np.round(x / 5e-6) * 5e-6, force


def write_csv(path, t, position, force, header="t_s,position_m,force_N"):
    np.savetxt(path, np.c_[t, position, force], delimiter=",", header=header, comments="")
    return path
