"""Effects of a synthetic plant, each by its own physics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import erf

from teleop_rt_dev.diagnosis.laws import (
    adhesion_bridge,
    arms,
    bouc_wen,
    lugre,
    play,
    power_law_memory,
    resonance,
)
from teleop_rt_dev.diagnosis.motions import RATE_HZ

if TYPE_CHECKING:
    from teleop_rt_dev.diagnosis.plants import SyntheticPlant

H = 1.0 / RATE_HZ
DECIMATE = 10


def kinematics(p: SyntheticPlant, effect: str, size: float) -> bool:
    """Add an effect that moves tool or surface; return whether `effect` is one."""
    travel = size * float(np.std(np.maximum(p.x, 0.0)))
    sign = p.rng.choice([-1.0, 1.0])
    if effect == "contact_offset":
        p.tip = p.tip + sign * travel
    elif effect == "moving_surface":
        if p.rng.random() < 0.5:
            p.tip = p.tip - sign * 2.0 * travel * p.t / p.t[-1]
        else:
            p.tip = p.tip - 1.4 * travel * np.sin(2 * np.pi * p.rng.uniform(0.15, 0.9) * p.t + 1.0)
    elif effect == "series_compliance":
        deepest = float(np.max(p.x))
        stiffness = p.k * p.n * deepest ** (p.n - 1.0)
        p.channel.append(("series", stiffness / size))
    elif effect == "backlash":
        p.tip = play(p.tip, 2.0 * travel)
    elif effect == "channel_delay":
        p.channel.append(
            ("delay", float(sign * size * np.std(p.plain) / np.std(np.gradient(p.plain, H))))
        )
    elif effect == "permanent_set":
        p.tip = p.tip - 0.8 * size * np.maximum.accumulate(np.maximum(p.tip, 0.0))
    else:
        return False
    return True


def of_the_material(p: SyntheticPlant, effect: str, size: float) -> bool:
    """Add an effect of the material; return whether `effect` is one."""
    depth, goal = np.maximum(p.tip, 0.0), size * p.level
    contact = p.tip > 0.0
    if effect == "stress_relaxation":
        tau = p.rng.uniform(0.1, 1.0) * np.array([0.2, 1.0, 5.0])
        row = arms(depth, p.rng.uniform(0.2, 1.0, 3), tau)
    elif effect == "fractional_relaxation":
        slow = power_law_memory(depth[::DECIMATE].copy(), p.rng.uniform(0.15, 0.5), 1e-3)
        row = np.interp(p.t, p.t[::DECIMATE], slow)
    elif effect == "nonlinear_stiffening":
        row = depth ** p.rng.uniform(2.2, 4.0)
    elif effect == "second_layer":
        edge = p.rng.uniform(0.3, 0.7) * p.depth
        row = 1e-4 * np.logaddexp(0.0, (depth - edge) / 1e-4)
    elif effect == "hysteresis":
        row = bouc_wen(p.tip, p.rng.uniform(0.02, 0.15) * p.depth, 0.6, 0.4, p.rng.uniform(1, 2))
    elif effect == "mullins_softening":
        energy = 0.5 * depth**2
        most = np.maximum.accumulate(energy)
        row = -depth * erf((most - energy) / (0.1 * np.max(energy) + 0.3 * most))
    elif effect == "softening":
        worn = np.cumsum(contact) * H
        row = -depth * (1.0 - np.exp(-worn / p.rng.uniform(1.0, 6.0)))
    elif effect == "quadratic_damping":
        row = p.v * np.abs(p.v)
    elif effect == "adhesion":
        reach = p.rng.uniform(0.05, 0.15) * p.depth
        row = adhesion_bridge(p.x, reach)
        p.extra = p.extra + 3.0 * size * p.level * row
        return True
    else:
        return False
    row = np.where(contact, row, 0.0)
    p.body = p.body + goal * row / float(np.std(row))
    return True


def tool(p: SyntheticPlant, effect: str, size: float) -> bool:
    """Add an effect of tool or guide; return whether `effect` is one."""
    goal = size * p.level
    peak = float(np.quantile(np.abs(p.v), 0.99))
    if effect == "coulomb_friction":
        row = lugre(p.v, 1.0, 1.0, 0.05 * peak, p.rng.uniform(1e-3, 5e-3) * p.depth)
    elif effect == "stribeck_friction":
        row = lugre(
            p.v,
            1.0,
            p.rng.uniform(1.5, 2.5),
            p.rng.uniform(0.05, 0.2) * peak,
            p.rng.uniform(1e-3, 3e-3) * p.depth,
        )
    elif effect == "viscous_friction":
        row = p.v
    elif effect == "direction_dependent_damping":
        row = np.where(p.v > 0.0, 1.3, 0.7) * p.v
    elif effect == "tool_inertia":
        row = p.a
    elif effect == "position_ripple":
        pitch = p.rng.uniform(0.05, 0.25) * p.depth
        angle = 2 * np.pi * p.x / pitch + p.rng.uniform(0, 6.28)
        row = np.sin(angle) + 0.1 * np.sin(2 * angle)
    else:
        return False
    p.extra = p.extra + goal * row / float(np.std(row))
    return True


def sensor(p: SyntheticPlant, effect: str, size: float) -> bool:
    """Add an effect of the force sensor; return whether `effect` is one."""
    goal, sign = size * p.level, p.rng.choice([-1.0, 1.0])
    if effect == "force_bias":
        p.sensor = p.sensor + sign * goal
    elif effect == "force_drift":
        u = p.t / p.t[-1]
        p.sensor = p.sensor + sign * 3 * goal * (u if p.rng.random() < 0.5 else np.sqrt(u))
    elif effect == "periodic_disturbance":
        tone = p.rng.choice([50.0, 60.0, p.rng.uniform(20.0, 120.0)])
        angle = 2 * np.pi * tone * p.t
        p.sensor = p.sensor + 1.4 * goal * (np.sin(angle) + 0.1 * np.sin(2 * angle))
    elif effect == "force_lag":
        rate = np.std(np.gradient(p.plain, H)) / np.std(p.plain)
        p.channel.append(("lag", float(size / rate)))
    elif effect == "force_saturation":
        p.channel.append(("clip", float(np.max(p.plain) * (1.0 - 0.5 * min(size * 2.0, 0.8)))))
    elif effect == "outliers":
        pass
    else:
        return False
    return True


def outside_library(p: SyntheticPlant, effect: str, size: float) -> bool:
    """Add an effect that the library does not have; return whether `effect` is one."""
    depth, contact = np.maximum(p.tip, 0.0), p.tip > 0.0
    if effect == "pulsating_stiffness":
        row = depth * np.sin(2 * np.pi * p.rng.uniform(0.7, 3.0) * p.t)
    elif effect == "tool_resonance":
        row = resonance(p.a, p.rng.uniform(9.0, 20.0), 0.05)
    elif effect == "thinning_damper":
        row = np.where(contact, p.v / (1.0 + (3.0 * p.v / np.std(p.v)) ** 2), 0.0)
    elif effect == "wandering_gain":
        wander = np.cumsum(p.rng.standard_normal(p.t.size // 100 + 2))
        row = p.plain * np.interp(p.t, 0.01 * np.arange(wander.size), wander - wander.mean())
    elif effect == "depth_waves":
        row = np.where(contact, np.sin(2 * np.pi * (depth / p.depth) ** 2 * 4.0), 0.0)
    else:
        return False
    p.extra = p.extra + size * p.level * row / float(np.std(row))
    return True


ADDING = (kinematics, of_the_material, tool, sensor, outside_library)
"""Each adds an effect if it knows it, and returns whether it does."""
