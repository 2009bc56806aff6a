"""Adhesion: the surface pulls the tool; seven laws of one effect of the material."""

from __future__ import annotations

from math import exp

from teleop_rt.contact.effect import Amplitude, Effect, Shape, StepFunction, Vector
from teleop_rt.contact.law import touches
from teleop_rt.kernels.jit import kernel


@kernel
def _touch(state: Vector, x: float, reach: float) -> None:
    """Note in state[0] whether the tool has touched and not yet gone beyond `reach` [rig unit]."""
    if touches(x):
        state[0] = 1.0
    if x < -reach:
        state[0] = 0.0


@kernel
def _bridge(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    """Pull the tool back after a contact until the bridge of this range breaks."""
    _touch(state, x, eta[0])
    if touches(x):
        return 0.0
    return float(-state[0] * (1.0 - min(-x / eta[0], 1.0) ** eta[1]))


@kernel
def _neck(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    """Pull the tool back after a contact by a neck that is stretched, gets thin, and breaks.

    Its force rises from nothing as it is stretched, unlike a bridge's, and is 1 at its largest.
    """
    _touch(state, x, eta[0])
    if touches(x):
        return 0.0
    rise, fall = eta[1], eta[2]
    stretch, widest = min(-x / eta[0], 1.0), rise / (rise + fall)
    most = widest**rise * (1.0 - widest) ** fall
    return float(-state[0] * stretch**rise * (1.0 - stretch) ** fall / most)


@kernel
def _attraction(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Pull the tool in all through a contact, and on until it is out of range.

    After Derjaguin, Muller and Toporov (1975): attraction acts beside the elastic force. A power
    above 1 is a liquid's neck, whose force falls nearly exponentially until it breaks.
    """
    _touch(state, x, eta[0])
    return float(-state[0] * (1.0 - min(max(-x, 0.0) / eta[0], 1.0)) ** eta[1])


@kernel
def _distance(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Pull the tool in a contact, and less the farther away it is, before a contact and after it.

    The tail (1 + gap / (power range))^-power is van der Waals' at a power of 2 (Derjaguin, Muller
    and Toporov 1975), and nearly exponential at the largest, as of a magnet.
    """
    gap = max(-x, 0.0)
    return float(-((1.0 + gap / (eta[1] * eta[0])) ** -eta[1]))


@kernel
def _bond(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    """Pull the tool back to the surface that it has touched, on both sides of it."""
    _touch(state, x, 5.0 * eta[0])
    return float(-state[0] * exp(-((abs(x) / eta[0]) ** eta[1])))


_RELEASE = 0.2752  # the distance at which a soft sphere lets go, in squared radii over its own
_ITERATIONS = 20  # of Newton's method, of which the error halves at worst
_ACCURACY = 1e-6  # of the root of the radius


@kernel
def _soft_sphere(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Pull the tool in beside Hertz's force, until the contact of a soft sphere lets go.

    After Johnson, Kendall and Roberts (1971). In units of the contact's radius r at no load, and of
    the pull-off force, depth is r^2 - 2/3 r^(1/2) and force 4 (r^3 - r^(3/2)) (Maugis 2000).
    """
    _touch(state, x, eta[0])
    if state[0] == 0.0:
        return 0.0
    depth = max(x / eta[0], -1.0) * _RELEASE
    root = (max(depth, 0.0) + 1.0) ** 0.25  # of the radius, above the solution
    for _ in range(_ITERATIONS):
        step = (root**4 - 2.0 / 3.0 * root - depth) / (4.0 * root**3 - 2.0 / 3.0)
        root -= step
        if abs(step) < _ACCURACY:
            break
    return float(-4.0 * (max(depth, 0.0) ** 1.5 - root**6 + root**3))


@kernel
def _sticking_withdrawal(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Pull the tool back while it withdraws, less with distance from the surface."""
    _touch(state, x, 5.0 * eta[0])
    if v >= 0.0:
        return 0.0
    return float(-state[0] * exp(-abs(x) / eta[0]))


_SHORTEST_RANGE_SHARE = 5e-3  # of the travel; also the range of a pull that shows nowhere
_RANGE = Shape(
    "range",
    "{x}",
    _SHORTEST_RANGE_SHARE,
    0.5,
    0.05,
    logarithmic=True,
    relative_to="travel",
    points=8,
    neutral=_SHORTEST_RANGE_SHARE,
)
"""Of a pull that is nowhere seen beyond the surface one does not know that it is a pull."""


def _law(law: str, step: StepFunction, where: str, *shapes: Shape) -> Effect:
    """Declare one law; `where` ends the report's sentence."""
    return Effect(
        name="adhesion",
        law=law,
        family="adhesion",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("pull_off_force", "{f}", nonnegative=True),
        shapes=(_RANGE, *shapes),
        step=step,
        sentence="The surface pulls with {pull_off_force} " + where,
        compensation="render",
        state_size=1,
        only_in_contact=False,
    )


_SHARP = Shape("power", "1", 0.5, 3.0, 1.0, logarithmic=True, points=2)
_NECK = Shape("power", "1", 0.7, 5.0, 1.0, logarithmic=True, points=2)
_TAIL = Shape("power", "1", 1.0, 30.0, 3.0, reciprocal=True, points=2, ideal="upper")
_ROUND = Shape("power", "1", 0.7, 3.0, 1.5, logarithmic=True, points=1)
_RISE = Shape("rise", "1", 0.3, 2.0, 1.0, logarithmic=True, points=1)
_FALL = Shape("fall", "1", 0.02, 2.0, 0.3, logarithmic=True, points=2)
EFFECTS = (
    _law("bridge", _bridge, "within {range} after a contact.", _SHARP),
    _law("neck", _neck, "where a neck is stretched, up to {range}, after a contact.", _RISE, _FALL),
    _law("in contact and after", _attraction, "in contact and within {range} after it.", _NECK),
    _law("at a distance", _distance, "in contact, and less at {range} from it.", _TAIL),
    _law("near the surface", _bond, "within {range} on both of its sides.", _ROUND),
    _law("of a soft sphere", _soft_sphere, "as a soft sphere does (JKR), to {range} after it."),
    _law("on withdrawal", _sticking_withdrawal, "within {range} on withdrawal."),
)
