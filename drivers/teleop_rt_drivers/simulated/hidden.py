"""Hidden effects of a plant: ordinary differential equations of body, guide, sensor and tip.

Constants and memories are flat vectors; a constant of 0 leaves its effect out. Nothing here is
shared with the effects that diagnosis fits. `body_force` and `body_rates` are the environment's
alone, and give the summary the force that a hand should have felt.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt.kernels.jit import kernel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Vector = NDArray[np.float64]

ARMS = 3  # Maxwell arms at most
# Constants of the body, which a hand should feel ...
(STIFFNESS, DAMPING, SURFACE, FOAM, LOCKING_DEPTH, LAYER, LAYER_DEPTH, LAYER_BLEND) = range(8)
ARM = 8  # place of the first arm's stiffness, and of its time below
ARM_TIME = ARM + ARMS
(
    YIELD_FORCE,
    YIELD_TRAVEL,
    BETA,
    GAMMA,
    SHARPNESS,
    QUADRATIC,
    PULL_OFF,
    BOND_RANGE,
    SOFTENED,
    SOFTENING_TIME,
    DAMAGE,
    DAMAGE_WIDTH,
    SET,
    SET_TIME,
    SURFACE_VELOCITY,
    SWING,
    SWING_HZ,
    EXPONENT,
    EXPONENT_DEPTH,
) = range(ARM_TIME + ARMS, ARM_TIME + ARMS + 19)
# ... and of guide, sensor and tip, which it should not.
(
    KINETIC,
    STATIC,
    STRIBECK_VELOCITY,
    BRISTLE,
    VISCOUS,
    FORWARD,
    TOOL_MASS,
    BIAS,
    DRIFT,
    DRIFT_TIME,
    MAINS,
    MAINS_HZ,
    SENSOR_HZ,
    SENSOR_DAMPING,
    LEVEL,
    SPARKS,
    SPARK_SIZE,
    DELAY_MS,
    GAP,
    PITCH_ERROR,
    PITCH,
    COMPLIANCE,
) = range(EXPONENT_DEPTH + 1, EXPONENT_DEPTH + 23)
N_CONSTANTS = COMPLIANCE + 1

# Memories: of the body, then of guide, sensor and tip. The deepest penetration is no rate: it is
# noted after each step.
STRETCH = 0
TWIST, BOND, DEEPEST, SETTLED, BRISTLES, WARMTH, WARMED, READING, READING_RATE, TIP, DEFLECTION = (
    range(ARMS, ARMS + 11)
)
N_MEMORIES = DEFLECTION + 1

_BOND_GROWS_S, _BOND_BREAKS_S = 0.01, 0.002
"""Time constants of an adhesive bond while the tool touches, and beyond its range."""
_FLANK_S, _BENDING_S = 3e-4, 5e-4
"""Time constants of a play's flank and of a tool that bends: some internal steps of 50 us each."""
_SLOWER = 1e-3
"""A small difference of velocity, for the body's damping."""
_WETTED = 1e-4
"""Penetration [rig unit] over which quadratic damping begins: it has no step at the surface."""
_MICRO_DAMPING = 2e-4
"""Damping of the bristles, as a time that multiplies their stiffness [s]."""


@kernel
def surface_at(t: float, m: Vector, c: Vector) -> float:
    """Return the surface at time t [s], set by the presses on it."""
    swing = c[SWING] * math.sin(2.0 * math.pi * c[SWING_HZ] * t)
    return float(c[SURFACE] + c[SURFACE_VELOCITY] * t + swing + m[SETTLED])


@kernel
def surface_rate(t: float, m: Vector, c: Vector) -> float:
    """Return how fast the surface recedes."""
    angular = 2.0 * math.pi * c[SWING_HZ]
    rate = c[SURFACE_VELOCITY] + c[SWING] * angular * math.cos(angular * t)
    return float(rate + set_rate(m, c))


@kernel
def set_rate(m: Vector, c: Vector) -> float:
    """Return how fast the surface settles for good."""
    if c[SET] <= 0.0:
        return 0.0
    return float(max(0.0, c[SET] * m[DEEPEST] - m[SETTLED]) / c[SET_TIME])


@kernel
def thickening(x: float, c: Vector) -> float:
    """Return (x/d)^(n - 1) at depth x > 0: 1 for a body with a linear spring."""
    if c[EXPONENT_DEPTH] <= 0.0:
        return 1.0
    return float((x / c[EXPONENT_DEPTH]) ** (c[EXPONENT] - 1.0))


@kernel
def damping_at(x: float, c: Vector) -> float:
    """Return the body's damping at depth x: b, or b (x/d)^n of Hunt and Crossley."""
    if c[EXPONENT_DEPTH] <= 0.0:
        return float(c[DAMPING])
    return float(c[DAMPING] * (x / c[EXPONENT_DEPTH]) ** c[EXPONENT])


@kernel
def elastic_force(x: float, t: float, m: Vector, c: Vector) -> float:
    """Return the force of the body's springs, damage and softening included, at depth x > 0."""
    stiffness = c[STIFFNESS]
    if c[SOFTENED] > 0.0:
        stiffness *= 1.0 - c[SOFTENED] * t / (t + c[SOFTENING_TIME])
    if c[DAMAGE] > 0.0:
        below = max(0.0, m[DEEPEST] - x)
        stiffness *= 1.0 - c[DAMAGE] * (1.0 - math.exp(-below / c[DAMAGE_WIDTH]))
    force = stiffness * x * thickening(x, c)
    if c[FOAM] > 0.0:
        squeezed = min(x, 0.98 * c[LOCKING_DEPTH])
        force += c[FOAM] * squeezed * squeezed / (c[LOCKING_DEPTH] - squeezed)
    if c[LAYER] > 0.0:
        into = (x - c[LAYER_DEPTH]) / c[LAYER_BLEND]
        grown = into if into > 30.0 else math.log1p(math.exp(into))
        force += c[LAYER] * c[LAYER_BLEND] * grown
    return float(force)


@kernel
def body_force(position: float, velocity: float, t: float, m: Vector, c: Vector) -> float:
    """Return the force of the body on a tip, > 0 when pressed; only a bond pulls."""
    x = position - surface_at(t, m, c)
    bond = 0.0
    if c[PULL_OFF] > 0.0 and m[BOND] > 0.0:
        ratio = x / c[BOND_RANGE]
        bond = -c[PULL_OFF] * m[BOND] * math.exp(-0.5 * ratio * ratio)
    if x < 0.0:
        return float(bond)
    v = velocity - surface_rate(t, m, c)
    force = elastic_force(x, t, m, c) + damping_at(x, c) * v
    for i in range(ARMS):
        force += c[ARM + i] * m[STRETCH + i]
    force += c[YIELD_FORCE] * m[TWIST]
    force += c[QUADRATIC] * v * abs(v) * min(1.0, x / _WETTED)
    return float(max(0.0, force) + bond)


@kernel
def body_rates(
    position: float, velocity: float, t: float, m: Vector, c: Vector, rates: Vector
) -> None:
    """Write the rates of the body's memories."""
    x = position - surface_at(t, m, c)
    v = velocity - surface_rate(t, m, c)
    inside = x > 0.0
    for i in range(ARMS):
        if c[ARM + i] > 0.0:
            rates[STRETCH + i] = (v if inside else 0.0) - m[STRETCH + i] / c[ARM_TIME + i]
    if c[YIELD_FORCE] > 0.0:
        z = m[TWIST]
        turn = c[BETA] * (1.0 if v * z > 0.0 else -1.0) + c[GAMMA]
        held = 1.0 - abs(z) ** c[SHARPNESS] * turn
        rates[TWIST] = v / c[YIELD_TRAVEL] * held if inside else 0.0
    if c[PULL_OFF] > 0.0:
        if inside:
            rates[BOND] = (1.0 - m[BOND]) / _BOND_GROWS_S
        else:
            rates[BOND] = -m[BOND] / _BOND_BREAKS_S if x < -3.0 * c[BOND_RANGE] else 0.0
    rates[SETTLED] = set_rate(m, c)


@kernel
def note_depth(position: float, t: float, m: Vector, c: Vector) -> None:
    """Note the deepest penetration so far; a body that is left has let go of its arms' stretch.

    It is counted from the surface as it was before it settled.
    """
    x = position - surface_at(t, m, c)
    m[DEEPEST] = max(m[DEEPEST], x + m[SETTLED])


@kernel
def friction_level(velocity: float, c: Vector) -> float:
    """Return the force at which the bristles slide."""
    ratio = velocity / c[STRIBECK_VELOCITY]
    return float(c[KINETIC] + (c[STATIC] - c[KINETIC]) * math.exp(-ratio * ratio))


@kernel
def bristle_rate(velocity: float, m: Vector, c: Vector) -> float:
    """Return the rate of LuGre's bristles (Canudas de Wit et al. 1995)."""
    if c[KINETIC] <= 0.0:
        return 0.0
    slide = c[BRISTLE] * abs(velocity) / friction_level(velocity, c)
    return float(velocity - slide * m[BRISTLES])


@kernel
def guide_force(velocity: float, m: Vector, c: Vector) -> float:
    """Return the force that the guide takes off the tool."""
    force = c[VISCOUS] * velocity + c[FORWARD] * max(velocity, 0.0)
    if c[KINETIC] > 0.0:
        force += c[BRISTLE] * (m[BRISTLES] + _MICRO_DAMPING * bristle_rate(velocity, m, c))
    return float(force)


@kernel
def led_motion(position: float, velocity: float, m: Vector, c: Vector) -> tuple[float, float]:
    """Return position and velocity to which screw and play lead the lever that carries the tip."""
    tip, rate = position, velocity
    if c[PITCH_ERROR] > 0.0:
        angle = 2.0 * math.pi * position / c[PITCH]
        tip += c[PITCH_ERROR] * math.sin(angle)
        rate += velocity * 2.0 * math.pi * c[PITCH_ERROR] / c[PITCH] * math.cos(angle)
    if c[GAP] > 0.0:
        rate = pushed(tip - m[TIP], c)
        tip = m[TIP]
    return tip, rate


@kernel
def tip_motion(
    position: float, velocity: float, t: float, m: Vector, c: Vector
) -> tuple[float, float]:
    """Return position and velocity of the tip, which the encoder does not see."""
    tip, rate = led_motion(position, velocity, m, c)
    if c[COMPLIANCE] > 0.0:
        tip -= m[DEFLECTION]
        rate -= bending_rate(tip, rate, t, m, c)
    return tip, rate


@kernel
def bending_rate(tip: float, rate: float, t: float, m: Vector, c: Vector) -> float:
    """Return how fast the lever bends that carries the tip.

    The force that bends it falls with that rate, by the body's damping: solved for both at once.
    """
    force = body_force(tip, rate, t, m, c)
    damping = (force - body_force(tip, rate - _SLOWER, t, m, c)) / _SLOWER
    return float((c[COMPLIANCE] * force - m[DEFLECTION]) / (_BENDING_S + c[COMPLIANCE] * damping))


@kernel
def pushed(distance: float, c: Vector) -> float:
    """Return how fast a flank pushes the tip that is off by `distance` within its play."""
    half = 0.5 * c[GAP]
    if distance > half:
        return float((distance - half) / _FLANK_S)
    if distance < -half:
        return float((distance + half) / _FLANK_S)
    return 0.0


@kernel
def rig_rates(
    position: float, velocity: float, t: float, loaded: float, m: Vector, c: Vector,
    rates: Vector,
) -> None:  # fmt: skip
    """Write the rates of the memories of guide, sensor and tip; `loaded` bears on the sensor."""
    rates[BRISTLES] = bristle_rate(velocity, m, c)
    if c[DRIFT] != 0.0:
        rates[WARMTH] = (c[DRIFT] - m[WARMTH]) / c[DRIFT_TIME]
        rates[WARMED] = (m[WARMTH] - m[WARMED]) / (0.2 * c[DRIFT_TIME])
    if c[SENSOR_HZ] > 0.0:
        natural = 2.0 * math.pi * c[SENSOR_HZ]
        rates[READING] = m[READING_RATE]
        rates[READING_RATE] = natural * natural * (loaded - m[READING])
        rates[READING_RATE] -= 2.0 * c[SENSOR_DAMPING] * natural * m[READING_RATE]
    if c[GAP] > 0.0:
        seen = position
        if c[PITCH_ERROR] > 0.0:
            seen += c[PITCH_ERROR] * math.sin(2.0 * math.pi * position / c[PITCH])
        rates[TIP] = pushed(seen - m[TIP], c)
    if c[COMPLIANCE] > 0.0:
        tip, rate = led_motion(position, velocity, m, c)
        rates[DEFLECTION] = bending_rate(tip - m[DEFLECTION], rate, t, m, c)


@kernel
def sensed_force(loaded: float, t: float, m: Vector, c: Vector) -> float:
    """Return the sensor's reading, before noise and delay, of the force on it."""
    force = m[READING] if c[SENSOR_HZ] > 0.0 else loaded
    force += c[BIAS] + m[WARMED]
    if c[MAINS] > 0.0:
        angle = 2.0 * math.pi * c[MAINS_HZ] * t
        force += c[MAINS] * (math.sin(angle) + 0.1 * math.sin(3.0 * angle + 0.7))
    if c[LEVEL] > 0.0:
        share = abs(force) / c[LEVEL]
        force /= (1.0 + share**12) ** (1.0 / 12.0)
    return float(force)
