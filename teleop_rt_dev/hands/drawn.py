"""Drawn trials: who holds which handle, in front of which body, over which link.

Written from the ranges that people, bodies and links have, without regard to rendering: a
number alone draws a trial. The walls here are the plant's own overrides and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

HANDLES = (
    "handle", "serial_handle", "odrive_handle", "damiao_handle", "robstride_handle",
    "moteus_handle",
)  # fmt: skip
"""The shipped rigs `simulated_*.yaml` of an operator's device."""
KINDS = ("linear", "hunt-crossley", "stiffening", "layered", "moving", "moving-stiffening")
HELD, LETS_GO, NOBODY = 0.8, 0.1, 0.1
"""Shares of hands that hold on, let go on the way, and hold nothing at all."""
FOLLOWED = 0.5
"""Share of the moving surfaces that the slave tracks."""


@dataclass(frozen=True)
class Draw:
    """A trial: the handle's rig, the kind of wall, and overrides `key=value`."""

    handle: str
    kind: str
    seconds: float
    changes: list[str]


def draw(number: int, seconds: float) -> Draw:
    """Return the trial of a number; it lasts `seconds` and three round trips."""
    rng = np.random.default_rng([22, 2, number])
    kind, handle = str(rng.choice(KINDS)), str(rng.choice(HANDLES))
    round_trip_ms = _either(rng, 0.0, _log(rng, 10, 5000), zero=0.2)
    changes = _hand(rng) | _wall(rng, kind)
    changes |= {
        "operator.rig": f"../rigs/simulated_{handle}.yaml",
        "link.round_trip_ms": round_trip_ms,
        "link.jitter_ms": float(rng.uniform(0, min(10.0, 0.2 * round_trip_ms))),
        "link.loss": _either(rng, 0.0, rng.uniform(0, 0.2), zero=0.2),
        "seed": str(number),
    }
    if "moving" in kind and rng.random() < FOLLOWED:
        changes["contact.surface_tracking_hz"] = _log(rng, 1, 4)
    lasts = seconds + 3e-3 * round_trip_ms
    return Draw(handle, kind, lasts, [f"{key}={value}" for key, value in changes.items()])


def _hand(rng: np.random.Generator) -> dict[str, object]:
    mean = float(rng.uniform(0.002, 0.014))
    motion = {
        "start_m": 0.0,
        "approach_speed_m_per_s": float(rng.uniform(0.02, 0.12)),
        "frequency_hz": float(rng.uniform(0.3, 3.0)),
        "mean_m": mean,
        "amplitude_m": mean * float(rng.uniform(0.1, 0.9)),
    }
    hand: dict[str, object] = {
        "mass_N_s2_per_m": _log(rng, 0.1, 5),
        "stiffness_N_per_m": _either(rng, 0.01, rng.uniform(20, 3000), zero=0.1),
        "damping_N_s_per_m": _either(rng, 0.0, rng.uniform(0, 60), zero=0.1),
        "tremor_N": _either(rng, 0.0, rng.uniform(0, 1.5), zero=0.5),
        "tremor_hz": float(rng.uniform(6, 12)),
        "reaction_ms": _either(rng, 0.0, rng.uniform(0, 300), zero=0.3),
        "grip_change": _either(rng, 0.0, rng.uniform(0, 0.8), zero=0.5),
        "grip_every_s": float(rng.uniform(0.3, 2.0)),
    }
    held = rng.choice(["held", "lets go", "nobody"], p=[HELD, LETS_GO, NOBODY])
    if held != "held":
        hand["let_go_s"] = 0.0 if held == "nobody" else float(rng.uniform(1, 5))
    hand |= {f"intention.{key}": value for key, value in motion.items()}
    return {f"operator.hand.{key}": value for key, value in hand.items()}


def _wall(rng: np.random.Generator, kind: str) -> dict[str, object]:
    stiffness = _log(rng, 300, 40_000)
    wall: dict[str, object] = {
        "stiffness_N_per_m": stiffness,
        "damping_N_s_per_m": _either(rng, 0.0, rng.uniform(0, 40), zero=0.2),
        "surface_m": float(rng.uniform(0.004, 0.02)),
    }
    if kind == "hunt-crossley":
        law = {"exponent": rng.uniform(1.1, 2.2), "depth_m": rng.uniform(0.002, 0.01)}
        wall["hunt_crossley"] = _yaml(law)
    hidden = []
    if "stiffening" in kind:
        foam = {"stiffness_N_per_m": stiffness, "locking_depth_m": rng.uniform(0.008, 0.03)}
        hidden.append({"effect": "nonlinear_stiffening"} | foam)
    if kind == "layered":
        layer = {"stiffness_N_per_m": _log(rng, 1000, 40_000), "depth_m": rng.uniform(0.002, 0.008)}
        hidden.append({"effect": "second_layer"} | layer)
    if "moving" in kind:
        motion = {
            "swing_m": rng.uniform(0.0005, 0.004), "swing_hz": rng.uniform(0.1, 1.0),
            "velocity_m_per_s": rng.uniform(-0.5e-3, 1e-3),
        }  # fmt: skip
        hidden.append({"effect": "moving_surface"} | motion)
    changes = {f"plant.environment.{key}": value for key, value in wall.items()}
    if hidden:
        changes["plant.undeclared"] = "[" + ", ".join(map(_yaml, hidden)) + "]"
    return changes


def _yaml(section: Mapping[str, object]) -> str:
    return "{" + ", ".join(f"{key}: {value}" for key, value in section.items()) + "}"


def _log(rng: np.random.Generator, least: float, most: float) -> float:
    return float(np.exp(rng.uniform(np.log(least), np.log(most))))


def _either(rng: np.random.Generator, rest: float, value: float, *, zero: float) -> float:
    return rest if rng.random() < zero else float(value)
