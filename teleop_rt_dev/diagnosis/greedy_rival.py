"""The fit that an engineer makes with SciPy in ten minutes: the rival of a diagnosis.

The base by least squares, extended greedily by the usual terms while the error on held-out blocks
falls. The position is low-passed without phase before it is differentiated, and the terms are
chosen on the blocks that score them: both flatter the rival. Imports nothing of ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

BLOCKS, FOLDS = 8, 4
MOST_TERMS = 4
MOST_ROWS = 4000  # of the regression; slower motions need no more
LEAST_GAIN = 0.02  # of the error, by which a further term must lower it
RIDGE = 1e-12  # of the columns' mean square; keeps collinear columns solvable
SURFACES = 25  # places over the lower 80 % of the travel
DAHL_TRAVELS = (0.005, 0.015, 0.04, 0.1, 0.25)  # of the travel
MAXWELL_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
SIGN_SPEEDS = (0.01, 0.05, 0.2)  # of the velocity's deviation
BASES = {
    "mass": ("mass",),
    "mass-damper": ("mass", "viscous", "bias"),
    "kelvin-voigt": ("spring", "viscous"),
}
IN_CONTACT = ("kelvin-voigt",)


@dataclass(frozen=True)
class Sampled:
    """Evenly sampled motion [s, rig unit] and force; `valid` is False in gaps."""

    dt: float
    x: Vector
    v: Vector
    a: Vector
    force: Vector
    valid: NDArray[np.bool_]

    @property
    def t(self) -> Vector:
        return np.asarray(self.dt * np.arange(self.x.size))


@dataclass(frozen=True)
class Rival:
    """Root-mean-square error over the force's deviation on held-out blocks, and the terms."""

    base_error: float
    error: float
    terms: tuple[str, ...]


def sampled(dt: float, x: Vector, force: Vector, valid: Vector, cutoff_hz: float) -> Sampled:
    """Return the motion low-passed without phase, and its derivatives."""
    rate = 1.0 / dt
    filtered = scipy.signal.butter(2, min(cutoff_hz, 0.4 * rate), fs=rate, output="sos")
    smooth = scipy.signal.sosfiltfilt(filtered, x)
    v = np.gradient(smooth, dt)
    return Sampled(dt, smooth, v, np.gradient(v, dt), force, valid > 0.0)


@dataclass(frozen=True)
class Described:
    """All columns, the names of those that the base has, and the samples to be explained."""

    columns: dict[str, Vector]
    base: tuple[str, ...]
    where: NDArray[np.bool_]


def fitted(motion: Sampled, base: str) -> Rival:
    """Return the rival's error on held-out blocks of the recording, in contact if the base is."""
    dictionary = described(motion, base)
    return _greedy(dictionary.columns, dictionary.base, motion.force, dictionary.where)


def described(motion: Sampled, base: str) -> Described:
    """Return the terms that a regression may choose; a contact begins where all fits best."""
    names = BASES.get(base) or tuple(base.split(","))
    if base in IN_CONTACT:
        return _in_contact(motion, names)
    return Described({**_base_terms(motion), **_usual_terms(motion)}, names, motion.valid)


def folds(samples: int) -> NDArray[np.int64]:
    """Return the fold of each sample."""
    return (np.arange(samples) * BLOCKS // samples) % FOLDS


def _in_contact(motion: Sampled, names: tuple[str, ...]) -> Described:
    """Return the columns of a body that begins somewhere: where all samples are explained best."""
    low, travel = float(np.min(motion.x)), float(np.ptp(motion.x))

    def columns_at(surface: float) -> tuple[dict[str, Vector], NDArray[np.bool_]]:
        inside = motion.x > surface
        depth = np.maximum(motion.x - surface, 0.0)
        base = {"spring": depth, "viscous": inside * motion.v}
        usual = {k: inside * column for k, column in _usual_terms(motion).items() if k != "bias"}
        powers = {
            "x^1.5": depth**1.5, "x^2": depth**2, "x^3": depth**3, "x v": depth * motion.v,
            "bias": np.ones_like(depth),
        }  # fmt: skip
        return {**base, **usual, **powers}, inside & motion.valid

    def left(surface: float) -> float:
        columns, _ = columns_at(surface)
        rows = {key: columns[key] for key in (*names, "x^2", "x^3", "x v", "bias")}
        return _Blocks(rows, motion.force, motion.valid).error(tuple(rows))

    surface = min(low + travel * np.linspace(0.0, 0.8, SURFACES), key=left)
    columns, inside = columns_at(float(surface))
    return Described(columns, names, inside)


def _base_terms(motion: Sampled) -> dict[str, Vector]:
    return {
        "spring": motion.x,
        "viscous": motion.v,
        "mass": motion.a,
        "bias": np.ones_like(motion.x),
    }


def _usual_terms(motion: Sampled) -> dict[str, Vector]:
    """Return the terms an engineer tries: friction, hysteresis, relaxation, powers, drift."""
    x, v, dt = motion.x - np.mean(motion.x), motion.v, motion.dt
    travel, speed = float(np.ptp(x)), float(np.std(v))
    found = {
        **_base_terms(motion), "x^2": x**2, "x^3": x**3, "forward": np.maximum(v, 0.0),
        "v|v|": v * np.abs(v), "x v": x * v, "x sign v": x * np.tanh(v / (0.05 * speed)),
        "drift": motion.t, "log drift": np.log(motion.t + 0.1),
    }  # fmt: skip
    found |= {f"sign v/{s:g}": np.tanh(v / (s * speed)) for s in SIGN_SPEEDS}
    found |= {f"dahl {s:g}": _dahl(np.diff(motion.x, prepend=motion.x[0]), s * travel)
              for s in DAHL_TRAVELS}  # fmt: skip
    found |= {f"maxwell {tau:g} s": _maxwell(v, dt, tau) for tau in MAXWELL_S}
    return found


def _dahl(steps: Vector, travel: float) -> Vector:
    """Return Dahl's friction of height 1: it decays towards the motion's sign over `travel`."""
    kept = np.exp(-np.abs(steps) / travel).tolist()
    signs = np.sign(steps).tolist()
    found, state = np.empty(steps.size), 0.0
    for i, (share, sign) in enumerate(zip(kept, signs, strict=True)):
        state = sign + (state - sign) * share
        found[i] = state
    return found


def _maxwell(v: Vector, dt: float, tau: float) -> Vector:
    """Return the force of a Maxwell arm of stiffness 1."""
    kept = float(np.exp(-dt / tau))
    return np.asarray(scipy.signal.lfilter([tau * (1.0 - kept)], [1.0, -kept], v))


class _Blocks:
    """Normal equations of each fold, by which any choice of columns is scored at once."""

    def __init__(self, columns: dict[str, Vector], force: Vector, where: NDArray[np.bool_]) -> None:
        fold = folds(force.size)
        chosen = np.flatnonzero(where)
        chosen = chosen[:: max(1, chosen.size // MOST_ROWS)]
        self.place = {name: i for i, name in enumerate(columns)}
        rows = np.array([column[chosen] for column in columns.values()])
        rows /= np.sqrt(np.mean(rows**2, axis=1, keepdims=True)) + 1e-300
        self.parts = []
        for number in range(FOLDS):
            hidden = fold[chosen] == number
            a, f = rows[:, hidden], force[chosen][hidden]
            self.parts.append((a @ a.T, a @ f, float(f @ f)))
        self.count = chosen.size
        self.deviation = float(np.std(force[chosen]))
        self.whole = (sum(p[0] for p in self.parts), sum(p[1] for p in self.parts))

    def error(self, names: Sequence[str]) -> float:
        """Return the error of these columns on blocks that their coefficients have not seen."""
        places = [self.place[name] for name in names]
        square = np.ix_(places, places)
        left = 0.0
        for gram, right, energy in self.parts:
            seen = (self.whole[0] - gram)[square] + RIDGE * self.count * np.eye(len(places))
            c = np.linalg.lstsq(seen, (self.whole[1] - right)[places], rcond=None)[0]
            left += energy - 2.0 * float(c @ right[places]) + float(c @ gram[square] @ c)
        return float(np.sqrt(max(left, 0.0) / self.count)) / max(self.deviation, 1e-300)


def _greedy(
    columns: dict[str, Vector], base: Sequence[str], force: Vector, where: NDArray[np.bool_]
) -> Rival:
    """Return the base extended term by term while its error falls by two hundredths."""
    blocks = _Blocks(columns, force, where)
    names: tuple[str, ...] = tuple(base)
    first = error = blocks.error(names)
    for _ in range(MOST_TERMS):
        longer = [(*names, name) for name in columns if name not in names]
        lower, best = min((blocks.error(candidate), candidate) for candidate in longer)
        if lower > (1.0 - LEAST_GAIN) * error:
            break
        names, error = best, lower
    return Rival(first, error, names[len(base) :])
