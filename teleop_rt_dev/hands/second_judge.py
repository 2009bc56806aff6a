"""Whether a run's handle shook, judged from the run's folder by physics alone.

    python teleop_rt_dev/hands/second_judge.py FOLDER ...

Written by one who knows the folders of `teleop-rt run` and mechanics, and shares no code with the
project or its campaign. A handle shakes where five successive swings of 3 to 40 Hz, above 0.2 mm
and with a motor force that changes by more than 0.5 N, do not decay, and where the same hand makes
no such swings against an ideal continuous wall: the body itself, or a spring as stiff as the
motor's force over the motion, both behind that filter, during the swings. Tremor is a chance, so it
has several. Swings are half waves of the motion behind a zero-phase band-pass. The handle must turn
round with them, for a slow motion with a kink passes the filter as a few half waves, too; without
turns ten in a row are asked for, which no kink makes. Exits with 1 where a handle shook.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.reader import make_reader
from numba import njit
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, sosfiltfilt

Array = NDArray[np.float64]
LOWEST_HZ, HIGHEST_HZ, LEAST_M, LEAST_N = 3.0, 40.0, 0.2e-3, 0.5
IN_A_ROW, RIDING = 5, 10
"""Swings in a row; of those that ride on a motion that goes on one way."""
DECAYING = 0.95
"""Last two of five swings over the first two, as a share per swing: below, they decay."""
IDEAL_SHARE = 0.7
"""A hand that makes swings of this size against an ideal wall makes those that were seen."""
SAME_PITCH = 1.5
"""Ratio of two frequencies up to which the hand's own swings explain those that were seen."""
SHORTEST = 100
"""Samples: a shorter motion holds no five swings at most of the frequencies looked at."""
CHANCES = 6
"""Tremors drawn for the hand at an ideal wall: one of them must explain the motion seen."""
SUBSTEPS = 40
"""Steps of the ideal motion in each period."""
INTENTION = (
    "start_m", "approach_speed_m_per_s", "mean_m", "amplitude_m", "frequency_hz", "felt_force_N",
    "lift_off_every_s", "lift_off_height_m",
)  # fmt: skip
HIDDEN = {
    "nonlinear_stiffening": (("stiffness", "N_per_m", 0.0), ("locking_depth", "m", 1.0)),
    "second_layer": (("stiffness", "N_per_m", 0.0), ("depth", "m", 1.0)),
    "moving_surface": (
        ("velocity", "m_per_s", 0.0), ("swing", "m", 0.0), ("swing_hz", "hz", 0.0)
    ),
}  # fmt: skip
DEVICE = ("mass_N_s2_per_m", "damping_N_s_per_m", "coulomb_friction_N")


@dataclass(frozen=True)
class Shaken:
    """A row of swings that do not decay: how many, how large, how fast, when it ended.

    `stiffness` is the motor's force over the motion.
    """

    swings: int = 0
    size_m: float = 0.0
    hz: float = 0.0
    at_s: float = 0.0
    stiffness: float = 0.0

    def like(self, other: Shaken) -> bool:
        """Return whether another row is about as fast, and about as large or larger."""
        near = 1 / SAME_PITCH < other.hz / self.hz < SAME_PITCH
        return near and other.size_m > IDEAL_SHARE * self.size_m


def shaken(position: Array, motor: Array, period_s: float) -> list[Shaken]:
    """Return the rows of five swings and more of a motion (n,) under the motor's force (n,)."""
    band = butter(2, (LOWEST_HZ, HIGHEST_HZ), "bandpass", fs=1 / period_s, output="sos")
    if position.size < SHORTEST:
        return []
    wave, pushes = sosfiltfilt(band, position - position[0]), sosfiltfilt(band, motor)
    crossings = np.flatnonzero(np.diff(np.signbit(wave)))
    tops = [a + int(np.abs(wave[a : b + 1]).argmax()) for a, b in pairwise(crossings)]
    lasts = np.diff(crossings) * period_s
    rows, sizes, pitches = [], list[float](), list[float]()
    for i in range(1, len(tops)):
        span = slice(tops[i - 1], tops[i] + 1)
        size = abs(float(wave[tops[i]] - wave[tops[i - 1]]))
        fast = 0.5 / HIGHEST_HZ < lasts[i] < 0.5 / LOWEST_HZ
        if not (fast and size > LEAST_M and np.ptp(motor[span]) > LEAST_N):
            sizes, pitches = [], []
            continue
        sizes, pitches = [*sizes, size], [*pitches, 0.5 / float(lasts[i])]
        while len(sizes) >= IN_A_ROW and _decays(sizes[-IN_A_ROW:]):
            sizes, pitches = sizes[1 - IN_A_ROW :], pitches[1 - IN_A_ROW :]
        whole = slice(crossings[max(0, i + 1 - len(sizes))], crossings[i + 1] + 1)
        turned = turns(position[whole]) >= IN_A_ROW - 1
        if len(sizes) >= (IN_A_ROW if turned else RIDING):
            hz = float(np.median(pitches))
            middle = float(np.median(sizes[-IN_A_ROW:]))
            slope = float(np.std(pushes[whole]) / np.std(wave[whole]))
            rows.append(Shaken(len(sizes), middle, hz, float(crossings[i]) * period_s, slope))
    return rows


@njit(cache=True)
def turns(position: Array) -> int:
    """Return how often a motion turns round by more than LEAST_M."""
    found, way, extreme = 0, 0.0, position[0]
    for x in position:
        if (x - extreme) * way > 0.0:
            extreme = x
        elif abs(x - extreme) > LEAST_M:
            found += way != 0.0
            way = 1.0 if x > extreme else -1.0
            extreme = x
    return found


def _decays(five: list[float]) -> bool:
    kept = math.sqrt(five[-1] * five[-2] / (five[0] * five[1]))
    return bool(kept < DECAYING ** (IN_A_ROW - 2))


@dataclass(frozen=True)
class Body:
    """A wall as physics has it: k x^n, b, a foam that locks, a layer below, and its own motion."""

    numbers: Array

    @classmethod
    def of_plant(cls, plant: dict[str, Any]) -> Body:
        """Return the body that a trial's plant describes."""
        body = plant["environment"]
        hidden = {one["effect"]: one for one in plant.get("undeclared") or ()}
        power = body["hunt_crossley"] or {"exponent": 1.0, "depth_m": 0.0}
        none = dict[str, float]()
        numbers = [body["surface_m"], body["stiffness_N_per_m"], body["damping_N_s_per_m"]]
        numbers += [power["exponent"], power["depth_m"]]
        for effect, keys in HIDDEN.items():
            one = hidden.get(effect, none)
            # A truth.json leaves out the units that a trial.yaml has in its keys.
            numbers += [one.get(f"{k}_{unit}", one.get(k, rest)) for k, unit, rest in keys]
        return cls(np.array(numbers))

    def as_soft_as(self, stiffness: float) -> Body:
        """Return a spring at the same place."""
        plain = np.array([0.0, stiffness, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        plain[0], plain[9:] = self.numbers[0], self.numbers[9:]
        return Body(plain)


@njit(cache=True)
def wall_force(w: Array, x: float, v: float, t: float) -> float:
    """Return the force of a body (`Body.numbers`) on a tool at x, at a time."""
    angular = 2 * math.pi * w[11]
    depth = x - w[0] - w[9] * t - w[10] * math.sin(angular * t)
    speed = v - w[9] - w[10] * angular * math.cos(angular * t)
    if depth <= 0.0:
        return 0.0
    if w[4] > 0.0:
        share = (depth / w[4]) ** w[3]
        force = w[1] * w[4] * share + w[2] * share * speed
    else:
        force = w[1] * depth + w[2] * speed
    foam = min(depth, 0.98 * w[6])
    force += w[5] * foam * foam / (w[6] - foam) + w[7] * max(0.0, depth - w[8])
    return float(max(0.0, force))


@njit(cache=True)
def press(
    w: Array, hand: Array, device: Array, wish: Array, tremor: Array, grip: Array, period_s: float
) -> tuple[Array, Array]:
    """Integrate the device with the hand on it, both one mass, against a body."""
    n, lag = tremor.size, round(hand[3] / period_s)
    xs, fs = np.zeros(n), np.zeros(n)
    x = wish[0]
    v = force = 0.0
    origin, begun, pressing = wish[0], 0.0, False
    h = period_s / SUBSTEPS
    for i in range(n):
        held = 1.0 if grip[i] > 0.0 else 0.0
        mass = device[0] + held * hand[0]
        felt = fs[i - lag - 1] if i > lag else 0.0
        t = i * period_s
        goal, rate, origin, begun, pressing = intend(wish, t, felt, origin, begun, pressing)
        for s in range(SUBSTEPS):
            force = wall_force(w, x, v, t + s * h)
            push = grip[i] * (hand[1] * (goal + rate * s * h - x) + hand[2] * (rate - v))
            rub = device[1] * v + device[2] * math.tanh(v / 1e-3)
            v += h / mass * (push + held * tremor[i] - rub - force)
            x += h * v
        xs[i], fs[i] = x, force
    return xs, fs


@njit(cache=True)
def intend(
    wish: Array, t: float, felt: float, origin: float, begun: float, pressing: bool
) -> tuple[float, float, float, float, bool]:
    """Return goal, its rate, and the phase of the motion that a trial's `intention` describes."""
    speed, mean, size, hz = wish[1], wish[2], wish[3], wish[4]
    blend, omega = 2 * mean / speed, 2 * math.pi * hz
    trough = (math.ceil(max(blend, wish[6]) * hz + 0.25) - 0.25) / hz
    way = mean - size + wish[7]
    lift = 1.5 * way / max(speed, omega * size)
    if not pressing and felt > wish[5]:
        origin, begun, pressing = origin + speed * (t - begun), t, True
    elif pressing and t >= begun + trough + lift + 0.2:
        origin, begun, pressing = origin - wish[7], begun + trough + lift + 0.2, False
    tau = t - begun
    if not pressing:
        return origin + speed * tau, speed, origin, begun, pressing
    if tau >= trough:
        u = min(1.0, (tau - trough) / lift)
        goal = mean - size - way * u * u * (3 - 2 * u)
        return origin + goal, -way * 6 * u * (1 - u) / lift, origin, begun, pressing
    u = min(1.0, tau / blend)
    gain, gained = u * u * (3 - 2 * u), 6 * u * (1 - u) / blend
    sine, cosine = size * math.sin(omega * tau), size * omega * math.cos(omega * tau)
    goal = mean * u * (2 - u) + gain * sine
    rate = 2 * mean * (1 - u) / blend + gain * cosine + gained * sine
    return origin + goal, rate, origin, begun, pressing


def against(
    body: Body, trial: dict[str, Any], ticks: int, period_s: float, chance: int = 0
) -> list[Shaken]:
    """Return the rows of swings that a trial's hand makes against an ideal body."""
    operator = trial["operator"]
    hand, device = operator["hand"], operator["plant"] or operator["rig"]["device"]
    rng, wish = np.random.default_rng([trial["seed"], chance]), hand["intention"]
    arm = [hand["mass_N_s2_per_m"], hand["stiffness_N_per_m"], hand["damping_N_s_per_m"]]
    thing = [device[key] for key in DEVICE]
    position, force = press(
        body.numbers, np.array([*arm, 1e-3 * hand["reaction_ms"]]), np.array(thing),
        np.array([wish[key] for key in INTENTION]), _tremor(hand, ticks, period_s, rng),
        _grip(hand, ticks, period_s, rng), period_s,
    )  # fmt: skip
    return shaken(position, force, period_s)


def _tremor(hand: dict[str, Any], ticks: int, period_s: float, rng: np.random.Generator) -> Array:
    """Return noise through a resonance of quality 5, of the hand's tremor."""
    if hand["tremor_N"] == 0.0:
        return np.zeros(ticks)
    angle = 2 * math.pi * hand["tremor_hz"] * period_s
    r = math.exp(-angle / 10)
    noise: Array = lfilter(
        [1.0], [1.0, -2 * r * math.cos(angle), r * r], rng.standard_normal(ticks)
    )
    size: float = hand["tremor_N"]
    return size * noise / np.std(noise)


def _grip(hand: dict[str, Any], ticks: int, period_s: float, rng: np.random.Generator) -> Array:
    """Return the share of its strength with which a hand holds on, 0 once it has let go."""
    each = max(1, round(hand["grip_every_s"] / period_s))
    change = hand["grip_change"]
    steps = np.repeat(1 + rng.uniform(-change, change, 1 + ticks // each), each)[:ticks]
    grip: Array = lfilter([period_s / 0.2], [1.0, period_s / 0.2 - 1.0], steps - 1.0) + 1.0
    if hand["let_go_s"] is not None:
        grip[round(hand["let_go_s"] / period_s) :] = 0.0
    return grip


def judge(trial: dict[str, Any], position: Array, motor: Array) -> list[Shaken]:
    """Return the rows of swings that the handle made by itself.

    `trial` is a trial.yaml, position and motor (n,) are the true ones of the device at each period.
    """
    period_s = 1.0 / trial["operator"]["rig"]["rate_hz"]
    body, left = Body.of_plant(trial["plant"]), shaken(position, motor, period_s)
    for chance in range(CHANCES):
        if left:
            worst = max(left, key=lambda row: row.swings)
            for wall in (body, body.as_soft_as(worst.stiffness)):
                ideal = against(wall, trial, position.size, period_s, chance)
                left = [row for row in left if not any(row.like(own) for own in ideal)]
    return left


def judge_folder(folder: Path) -> list[Shaken]:
    """Judge a run by trial.yaml, truth.json, and the true handle in its recording."""
    trial = yaml.safe_load((folder / "trial.yaml").read_text())
    truth = json.loads((folder / "truth.json").read_text())
    trial["plant"]["undeclared"] = truth["undeclared"]
    rows = []
    with (folder / "recording.mcap").open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(["/truth/handle"]):
            row = json.loads(message.data)
            rows.append((row["position"], row["motor_force"]))
    position, motor = np.array(rows).T
    return judge(trial, position, motor)


def main() -> int:
    verdicts = []
    for name in sys.argv[1:]:
        rows = judge_folder(Path(name))
        verdicts.append(bool(rows))
        worst = max(rows, key=lambda row: row.swings, default=None)
        print(f"{name}: {f'SHAKES, {worst}' if rows else 'holds'}")
    return 1 if any(verdicts) else 0


if __name__ == "__main__":
    sys.exit(main())
