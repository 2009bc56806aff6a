"""Passivity of the rendered port, before the fact: how stiff a wall a device can render.

A sampled wall makes energy: it pushes with the force of an old sample, and holds it for a period.
With period T, gain H(z) from samples to forces (K + B times the filter of the velocity), and a
latency mT + δ from a motion to the force that answers it, 0 <= δ < T, the force of sample k works
over c_{k+m} + a_{k+m+1}, where a_n is the motion within [nT, nT + δ] and c_n that in the rest of
the period. Whatever moves in between, friction b takes at least b (a²/δ + c²/(T - δ)). So the port
is passive for every hand if, for every z = e^{jωT}, the Hermitian part of

    [ b/δ      0      ]   [ z̄ ]
    [ 0     b/(T - δ) ] + [ 1 ] z^{-m} H(z)/(z - 1) [ 1  1 ]

is positive. For δ = 0 that is the known b > sup (T/2)/(1 - cos ωT) Re{(1 - z⁻¹) z^{-m} H} of
Colgate and Schenkel (1997); where a latency is no whole number of periods, their formula with
e^{-jωδ} in the place of the motion within a period lets walls through that are 7 % too stiff.

A velocity that an ideal device measures is a sample of its own, and tones above π/T alias into it;
for each tone alone the hand then needs

    sup over all ω of T/(ωT)² · Re{(1 - e^{-jωT}) H(jω)},  D = jω,

which is K T/2 for a spring and 0.217 B for a damper. The conditions are convex in K and B, so a
blend of walls that satisfy them satisfies them too.

At the bound a spring's latency takes all of the device's friction: ringing is then damped by the
hand alone, and a hand that is loose, or reacts late, rings for long. K e^{-jωτ} is K - jωKτ at the
tones of a hand, and B = Kτ cancels it; but the stiffer the spring, the less damping fits beside it.
So a spring that has to be softened is softened to the stiffest beside which its own Kτ fits: then
the hand feels a spring on a device that has all of its friction. With a velocity behind a low-pass
of 30 Hz that is 0.92 to 0.99 of the bound; with a raw difference it would be half of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import bound, kernel

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
VelocitySource = Literal["measured", "difference"]
GRID_POINTS = 512
"""Tones at which the bound is evaluated; 2048 change no limit by more than 0.01 %."""
STIFFEST_SHARE = 0.999
"""Of the bound, for a wall at it: at the bound itself no damping fits beside the spring."""
CALM_SHARE = 0.9
"""Of the bound, the least for a wall beyond it: softer, a wall is felt as another one."""
_CALM_HALVINGS = 10
"""Halvings of the search for the calmest spring: a thousandth of its range."""
EXCESS = 0.1
"""Excess of a wall over the bound, as a share of it, from which its latency is all made up for."""
LOWEST_TONE, HIGHEST_TONE = 1e-3, 3 * np.pi
"""The tones [rad per period] that are looked at; above, the weight of aliases only falls."""
_WHOLE = 1e-6
"""A latency this near [periods] to a whole number of periods is taken for one."""


@dataclass(frozen=True, slots=True)
class Port:
    """How the device senses and how it is driven.

    `velocity` is "measured" where the device gives it (an ideal device), or "difference" for a
    backward difference, behind a first-order low-pass of `cutoff_hz` if that is above 0.
    `delay_s` is the latency from a motion to the force that answers it, the hold apart;
    `position_scale` and `force_scale` are the factors from hand to wall and from wall to hand.
    """

    period_s: float
    damping: float
    velocity: VelocitySource = "measured"
    cutoff_hz: float = 0.0
    delay_s: float = 0.0
    position_scale: float = 1.0
    force_scale: float = 1.0


_A, _D, _RE, _IM, _SQUARE = range(5)
"""Rows of a need (5, tones): a unit of K or of B asks for so much of the device's damping.

They are a Hermitian matrix [[a, c], [c*, d]] a tone, c in two parts, and |c|²: the damping must
exceed its largest eigenvalue.
"""


@kernel
def needed(
    of_stiffness: Array, of_damping: Array, room: Array, stiffness: float, damping: float
) -> float:
    """Return the device's damping that K and B need at the worst tone.

    The needs of all tones come first, into `room` (tones,): so the processor finds eight at once.
    """
    k, m = of_stiffness, of_damping
    for tone in range(len(room)):
        a = stiffness * k[_A, tone] + damping * m[_A, tone]
        d = stiffness * k[_D, tone] + damping * m[_D, tone]
        re = stiffness * k[_RE, tone] + damping * m[_RE, tone]
        im = stiffness * k[_IM, tone] + damping * m[_IM, tone]
        half = 0.5 * (a - d)
        room[tone] = 0.5 * (a + d) + math.sqrt(half * half + re * re + im * im)
    most = -math.inf
    for tone in range(len(room)):
        most = max(most, room[tone])
    return most


@kernel
def damping_within(
    of_stiffness: Array, of_damping: Array, room: Array, available: float, stiffness: float
) -> float:
    """Return the largest B beside a K for which b - K k - B m is positive at every tone.

    At each tone it is the smallest root above 0 of a determinant, a parabola in B; 0 where not
    even B = 0 is. The tones come first, as in `needed`.
    """
    k, m = of_stiffness, of_damping
    for tone in range(len(room)):
        left_a, left_d = available - stiffness * k[_A, tone], available - stiffness * k[_D, tone]
        constant = left_a * left_d - stiffness * stiffness * k[_SQUARE, tone]
        both = stiffness * (k[_RE, tone] * m[_RE, tone] + k[_IM, tone] * m[_IM, tone])
        linear = -(left_a * m[_D, tone] + left_d * m[_A, tone]) - 2 * both
        square = m[_A, tone] * m[_D, tone] - m[_SQUARE, tone]
        under = linear * linear - 4 * square * constant
        stable = -0.5 * (linear + math.copysign(math.sqrt(max(under, 0.0)), linear))
        one = stable / square if square != 0.0 else math.inf
        other = constant / stable if stable > 0.0 else math.inf
        root = min(one if one >= 0.0 else math.inf, other)
        real = root if under >= 0.0 else math.inf
        room[tone] = real if constant > 0.0 else 0.0
    most = math.inf
    for tone in range(len(room)):
        most = min(most, room[tone])
    return most


@kernel
def damping_within_alike(
    of_stiffness: Array, of_damping: Array, _room: Array, available: float, stiffness: float
) -> float:
    """Return the same where one number a tone, a, says it all."""
    most = math.inf
    for tone in range(of_stiffness.shape[1]):
        if of_damping[_A, tone] > 0.0:
            left = available - stiffness * of_stiffness[_A, tone]
            most = min(most, left / of_damping[_A, tone])
    return max(0.0, most)


class PassivityBound:
    """The damping that a device needs to render K and B, and the reduction where it lacks it."""

    def __init__(self, port: Port) -> None:
        self.available = port.damping
        self._scale = port.position_scale * port.force_scale
        self._late_s = port.delay_s + 0.5 * port.period_s
        needs = *_needs(port), np.zeros(GRID_POINTS)
        within = damping_within if np.any(needs[0][_RE:]) else damping_within_alike
        self._needed = bound(needed, needs, 0.0, 0.0)
        self._within = bound(within, needs, 0.0, 0.0)
        self._per_stiffness = self._needed(1.0, 0.0)
        self._last = (-math.inf, 0.0)
        self.calmest = self._calmest()

    @property
    def stiffness_max(self) -> float:
        """The stiffest wall without damping that the device can render."""
        return self.available / self._per_stiffness

    def stiffness_max_later(self, later_s: float) -> float:
        """Return the stiffest spring whose force comes later than the device's own by so much."""
        return self.available / (self._per_stiffness + self._scale * later_s)

    @property
    def stiffest(self) -> float:
        """The stiffest wall that is rendered: it leaves room for damping beside it."""
        return STIFFEST_SHARE * self.stiffness_max

    def required_damping(self, stiffness: float, damping: float) -> float:
        """Return the damping that the device must have for every B between 0 and `damping`.

        The need is convex in B, so it is largest at an end.
        """
        return max(stiffness * self._per_stiffness, self._needed(stiffness, damping))

    def reduce(self, stiffness: float, damping: float) -> tuple[float, float]:
        """Return the largest rendered K and B: B is reduced first, K where that is not enough."""
        stiffness = self.softened(stiffness)
        if damping > 0:
            damping = min(damping, self.damping_max(stiffness))
        return stiffness, damping

    def lost_damping(self, stiffness: float) -> float:
        """Return the device's damping that the latency of a spring beyond the bound takes.

        It grows from 0 at the bound, so that an estimate near it makes no steps.
        """
        return self._excess(stiffness) * self.softened(stiffness) * self._late_s

    def softened(self, stiffness: float) -> float:
        """Return the spring that is rendered: as it is up to the bound, then down to the calmest.

        Between them it falls as its damping grows, so that an estimate near it makes no steps.
        """
        if stiffness <= self.stiffest:
            return stiffness
        return self.stiffest - self._excess(stiffness) * (self.stiffest - self.calmest)

    def _excess(self, stiffness: float) -> float:
        """Return how far a spring is beyond the bound: 0 at it, 1 from EXCESS on."""
        beyond = stiffness - self.stiffest
        return 0.0 if beyond <= 0.0 else beyond / max(beyond, EXCESS * self.stiffest)

    def _calmest(self) -> float:
        """Return the stiffest spring whose latency takes no more damping than fits beside it."""
        low, high, middle = CALM_SHARE, STIFFEST_SHARE, STIFFEST_SHARE
        for _ in range(_CALM_HALVINGS):
            stiffness = middle * self.stiffness_max
            fits = self.damping_max(stiffness) >= stiffness * self._late_s
            low, high = (middle, high) if fits else (low, middle)
            middle = 0.5 * (low + high)
        return low * self.stiffness_max

    def damping_max(self, stiffness: float) -> float:
        """Return the largest B beside a K that is within the bound; asked twice, found once."""
        if stiffness != self._last[0]:
            self._last = stiffness, self._within(self.available, stiffness)
        return self._last[1]


def _needs(port: Port) -> tuple[Array, Array]:
    """Return the damping that a unit of K and a unit of B need."""
    scale = port.position_scale * port.force_scale
    if port.velocity == "measured":
        theta = np.geomspace(LOWEST_TONE, HIGHEST_TONE, GRID_POINTS)
        omega = theta / port.period_s
        share = port.period_s / theta**2 * (1 - np.exp(-1j * theta))
        share = scale * share * np.exp(-1j * omega * port.delay_s)
        tone: Complex = (1j * omega).astype(np.complex128)
        return _alike(share), _alike(share * _filtered(tone, theta, port))
    theta = np.geomspace(LOWEST_TONE, np.pi, GRID_POINTS)
    difference: Complex = (1 - np.exp(-1j * theta)) / port.period_s
    damping: Complex = scale * _filtered(difference, theta, port)
    return _lifted(np.full(theta.shape, scale + 0j), theta, port), _lifted(damping, theta, port)


def _filtered(differentiator: Complex, theta: Array, port: Port) -> Complex:
    if port.cutoff_hz <= 0:
        return differentiator
    pole = np.exp(-2 * np.pi * port.cutoff_hz * port.period_s)
    filtered: Complex = differentiator * (1 - pole) / (1 - pole * np.exp(-1j * theta))
    return filtered


def _alike(share: Complex) -> Array:
    """Return the need where one number a tone says it all."""
    nothing = np.zeros(share.shape)
    return np.stack((share.real, share.real, nothing, nothing, nothing))


def _lifted(gain: Complex, theta: Array, port: Port) -> Array:
    """Return the need of a gain behind the port's latency: of the motions before and after δ."""
    period_s, z = port.period_s, np.exp(1j * theta)
    whole = round(port.delay_s / period_s)
    late_s = port.delay_s - whole * period_s
    if abs(late_s) > _WHOLE * period_s:
        whole = int(port.delay_s // period_s)
        late_s = port.delay_s - whole * period_s
    work: Complex = gain * z**-whole / (z - 1)
    if abs(late_s) <= _WHOLE * period_s:
        return _alike(-period_s * work)
    before, after = late_s, period_s - late_s
    a: Array = -before * (np.conj(z) * work).real
    d: Array = -after * work.real
    c: Complex = -0.5 * np.sqrt(before * after) * (np.conj(z) * work + np.conj(work))
    return np.stack((a, d, c.real, c.imag, c.real**2 + c.imag**2))
