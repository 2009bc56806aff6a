"""Motion of a surface in contact: a body that breathes or yields under the tool.

A Kalman filter fits f = k x + b v + c with constant k and b, and a force c of constant rate:
c = -k s for a surface at s. The tool's own motion identifies k and b and so separates them from the
surface's motion, provided that the tool moves at other frequencies. Position, velocity and force
pass the same low-pass, which preserves the equation. A tool without contact force, deeper than the
surface, corrects s as well.

A body that stiffens, f = (k + b v) (x - s)^n after Hunt and Crossley, is the same in g = f^(1/n),
which is linear in the depth, with a damping in proportion to g beside one that a late force looks
like. So there is such a filter for each
of a few exponents, and the one that leaves least of the force counts.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.kernels.jit import kernel

Matrix = NDArray[np.float64]
Laws = NDArray[np.float64]

K, B, GROWING, C, RATE, N_STATES = range(6)
X, F, ERROR_POWER, PEAK, CONTACT_S, PRESSED_S, N_SIGNALS = range(7)
GAIN, PERIOD, POLE, LEAST_FORCE, N_SETTINGS = range(5)

EXPONENTS = tuple(np.linspace(1.0, 2.0, 21).tolist())
"""Of bodies from linear to the strongest stiffening; Hertz's sphere has 1.5."""
BETTER = 0.8
"""Share of the residual of the law in use that another must leave to take its place."""
REFERENCE = 20.0
"""Force, in least forces, at which the power of a force is the force itself: a middling press."""

CUTOFF_HZ = 30.0
"""Low-pass on position and force: far above any motion of a surface."""
SETTLING_S = 0.02
"""Settling of the low-pass after an onset: four of its time constants."""
MEMORY_S = 5.0
"""Memory of k and b: several strokes of a hand."""
REMEMBERED_S = 0.5
"""Time constant of the rate's decay out of contact, where the surface is not observed."""
READY_S, READY_SHARE = 0.3, 0.05
"""Least contact time, and largest relative deviation of k, before motion is reported."""
FITTING_NOISE, FITTING_SHARE = 5.0, 0.01
"""Largest residual of a law that fits, in deviations of noise and as a share of the largest force:
0.2 % for a body that breathes by 5 mm, 2 to 5 % for one of another exponent by a half."""
CURVED_NOISE, CURVED_SHARE, CURVED_S = 2.0, 0.002, 0.3
"""The same for a law that stiffens, and for how long: of several one fits for a while by chance."""
START_VARIANCE = 1e8
"""Initial variance of every state; forces are in deviations of the sensor's noise."""
WILD = 1e9
"""Magnitude from which a number is no sample, as in `sensing.sense`."""
FASTEST_LENGTHS_PER_S = 20.0
"""Largest speed of a surface: 0.1 m/s for the pipeline's length of 5 mm."""


@kernel
def predict(z: Vector, p: Matrix, settings: Vector, seen: bool) -> None:
    """Advance the state by a tick; `seen` while the surface is in contact."""
    dt = settings[PERIOD]
    kept = 1.0 if seen else math.exp(-dt / REMEMBERED_S)
    z[C] += dt * z[RATE]
    z[RATE] *= kept
    for i in range(N_STATES):
        p[C, i] += dt * p[RATE, i]
        p[RATE, i] *= kept
    for i in range(N_STATES):
        p[i, C] += dt * p[i, RATE]
        p[i, RATE] *= kept
    p[RATE, RATE] += settings[GAIN]


@kernel
def add_process_noise(p: Matrix, dt: float) -> None:
    """Increase the uncertainty of k and b by a tick, up to that before any estimate."""
    grown = math.sqrt(1.0 + dt / MEMORY_S)
    for j in range(C):
        if p[j, j] * grown * grown <= START_VARIANCE:
            for i in range(N_STATES):
                p[i, j] *= grown
                p[j, i] *= grown


@kernel
def correct(z: Vector, p: Matrix, h: Vector, ph: Vector, force: float) -> float:
    """Take in a force for the regressors h (N_STATES,); return by how much it differed."""
    expected, spread = 0.0, 1.0
    for i in range(N_STATES):
        expected += h[i] * z[i]
        ph[i] = 0.0
        for j in range(N_STATES):
            ph[i] += p[i, j] * h[j]
        spread += h[i] * ph[i]
    error = force - expected
    for i in range(N_STATES):
        z[i] += ph[i] * error / spread
        for j in range(N_STATES):
            p[i, j] -= ph[i] * ph[j] / spread
    return error


@kernel
def follow(
    z: Vector, p: Matrix, work: Matrix, s: Vector, settings: Vector,
    x: float, force: float, pressed: bool, inside: bool, curved: bool,
) -> None:  # fmt: skip
    """Take in a sample: depth x and force, scaled, and whether the tool presses.

    `inside` means without contact, and deeper than the surface as estimated; `curved` that the
    damping grows with the force. work (2, N_STATES) is scratch.
    """
    dt, h, ph = settings[PERIOD], work[0], work[1]
    if s[PRESSED_S] == 0.0 or not pressed:
        s[PRESSED_S], s[X], s[F] = 0.0, x, force
    before = s[X]
    s[X] += (1.0 - settings[POLE]) * (x - s[X])
    s[F] += (1.0 - settings[POLE]) * (force - s[F])
    s[PRESSED_S] += dt * pressed
    predict(z, p, settings, pressed)
    if s[PRESSED_S] > SETTLING_S:
        h[K], h[B], h[C], h[RATE] = s[X], (s[X] - before) / dt, 1.0, 0.0
        h[GROWING] = h[B] * s[F] / (REFERENCE * settings[LEAST_FORCE]) if curved else 0.0
        add_process_noise(p, dt)
        error = correct(z, p, h, ph, s[F])
        s[CONTACT_S] += dt
        s[PEAK] = max(s[F], s[PEAK] * (1.0 - dt / MEMORY_S))
        s[ERROR_POWER] += dt / READY_S * (error * error - s[ERROR_POWER])
    elif inside and z[K] > 0.0:
        h[K], h[B], h[GROWING], h[C], h[RATE] = 0.0, 0.0, 0.0, 1.0, 0.0
        correct(z, p, h, ph, -z[K] * s[X])


@kernel
def follow_laws(
    z: Matrix, p: Laws, work: Matrix, s: Matrix, settings: Vector, exponents: Vector, chosen: int,
    x: float, force: float, in_contact: bool, inside: bool,
) -> int:  # fmt: skip
    """Take in a sample by every law; return which one counts, where `chosen` did before.

    z (laws, N_STATES), p (laws, N_STATES, N_STATES), s (laws, N_SIGNALS), exponents (laws,).
    """
    pressed = in_contact and force > settings[LEAST_FORCE]
    free = inside and not in_contact
    reference = REFERENCE * settings[LEAST_FORCE]
    share = max(force, 0.0) / reference
    for law in range(exponents.size):
        curved = exponents[law] > 1.0
        g = reference * share ** (1.0 / exponents[law]) if curved else force
        follow(z[law], p[law], work, s[law], settings, x, g, pressed, free, curved)
    best = chosen
    for law in range(exponents.size):
        if s[law, CONTACT_S] < READY_S:
            return chosen
        wanted = residual_share(s[best]) * (BETTER if best == chosen else 1.0)
        if residual_share(s[law]) < wanted:
            best = law
    return best


@kernel
def residual_share(s: Vector) -> float:
    """Return the residual of a law as a share of the largest force."""
    return float(math.sqrt(max(1.0, s[ERROR_POWER])) / max(s[PEAK], 1.0))


class SurfaceMotion:
    """Tracks a surface: `shift` is its motion towards the tool, `velocity` its own along the axis.

    Rig units, from the position of the first onset. `ready` means that the stiffness is known and
    one of the laws fits; otherwise the shift is kept and the velocity is 0.
    """

    def __init__(
        self, bandwidth_hz: float, period_s: float, least_force: float, noise: float, length: float
    ) -> None:
        self._period_s, self._noise, self._length = period_s, noise, length
        self._settings = np.zeros(N_SETTINGS)
        self._settings[GAIN] = (2 * math.pi * bandwidth_hz) ** 4 * period_s**2
        self._settings[PERIOD] = period_s
        self._settings[POLE] = math.exp(-2 * math.pi * CUTOFF_HZ * period_s)
        self._settings[LEAST_FORCE] = least_force / noise
        self._exponents, laws = np.array(EXPONENTS), len(EXPONENTS)
        self._z, self._s = np.zeros((laws, N_STATES)), np.zeros((laws, N_SIGNALS))
        self._p, self._work = np.zeros((laws, N_STATES, N_STATES)), np.zeros((2, N_STATES))
        self.reset()
        self.update(0.0, 0.0, 0.0, in_contact=False)  # compiled now, not in a tick
        self.reset()

    def reset(self) -> None:
        """Forget the surface."""
        self.shift = 0.0
        self._met_at = math.nan
        self._begin()

    def _begin(self) -> None:
        """Start again, from a surface found by a new onset."""
        self._z[:] = 0.0
        self._s[:] = 0.0
        self._law, self._fitted_s = 0, 0.0
        self._p[:] = START_VARIANCE * np.eye(N_STATES)
        self._before = self.shift
        self._reference = self._met_at - self.shift
        self.velocity = 0.0
        self.ready = False

    def update(self, position: float, force: float, met_at: float, *, in_contact: bool) -> float:
        """Take in a sample, and the onset's position without the motion; return the shift."""
        wild = not (abs(position) < WILD and abs(force) < WILD)
        if wild or math.isnan(met_at):
            return self.shift
        if met_at != self._met_at:
            self._met_at = met_at
            self._begin()
        x = (position - self._reference) / self._length
        inside = position + self.shift > met_at
        self._law = follow_laws(
            self._z, self._p, self._work, self._s, self._settings, self._exponents, self._law,
            x, force / self._noise, in_contact, inside,
        )  # fmt: skip
        self._publish()
        return self.shift

    def _publish(self) -> None:
        """Set shift and velocity from the state, limited to the largest speed."""
        law, state, signals = self._law, self._z[self._law], self._s[self._law]
        k, power = state.item(K), max(1.0, signals.item(ERROR_POWER))
        deviation = math.sqrt(power * max(0.0, self._p.item(law, K, K)))
        noise, share = (FITTING_NOISE, FITTING_SHARE) if law == 0 else (CURVED_NOISE, CURVED_SHARE)
        fits = power < max(noise, share * signals.item(PEAK)) ** 2
        known = signals.item(CONTACT_S) >= READY_S and deviation < READY_SHARE * k
        self._fitted_s = self._fitted_s + self._period_s if fits and known else 0.0
        self.ready = self._fitted_s > (0.0 if law == 0 else CURVED_S)
        if not self.ready:
            self.velocity = 0.0
            return
        fastest = FASTEST_LENGTHS_PER_S * self._length
        step = fastest * self._period_s
        wanted = self._before + self._length * state.item(C) / k
        self.shift += max(-step, min(step, wanted - self.shift))
        self.velocity = max(-fastest, min(fastest, -self._length * state.item(RATE) / k))
