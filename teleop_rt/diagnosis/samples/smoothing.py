"""Width of the derivatives' window: a trade-off between lost motion and encoder noise."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.criteria import SIGMAS
from teleop_rt.diagnosis.samples.motion import SMOOTHING_ORDER, differentiate, position_noise
from teleop_rt.recordings.filters import fast_length, local_polynomial
from teleop_rt.recordings.rows import quantisation_step

HALF_WINDOWS_S = (0.020, 0.015, 0.010)  # s: bandwidths of 50 to 110 Hz
_NARROWER_S = (0.007, 0.005, 0.003)  # s: up to 360 Hz, for tools that follow steps
# 50 Hz of bandwidth down to 3: a machine of 0.1 Hz read at 100 Hz needs the widest.
_WIDER_S = (0.030, 0.045, 0.070, 0.100, 0.150, 0.200, 0.300)
NOISY_SPEED = 0.03  # of the speed's deviation; steps of the motion lose more than that
_THROWN_SPEED = 0.2  # of the speed's deviation; usual motion recovers a tenth, limiters 0.4 to 0.8
_LARGEST_QUICK_SHARE = 0.05  # of the samples; the base is fitted without them as well as with them
_QUIET_SPEED = 0.01  # of the same: a wider window is of no use, no law's form is known better
_LONGEST_WINDOW = 1.0 / 16.0  # of a recording: the edges of two windows are given up
_FLOOR_OCTAVES = 4  # down from half the rate; the quietest of them holds the least movement
_GROUPS = 80  # of bins, in which powers are compared: about seven an octave
_FELT_ORDER = 4  # of differences, of which slow motion has none
_FELT_REACH = 2  # samples between motion and force, of damping, sensors and drives
_LARGE_FORCE = 0.2  # of the force's 99.9 % quantile
_FEWEST_FELT = 100  # samples
_FELT_SHARE = 0.9  # of power; 0.96 to 1 behind links, 0 to 0.03 in measured data, an AFM's 0.6
_STEPS_POWER_RATIO = 0.02  # of the power recovered before; steps 0.05 to 0.6, tones to 150 Hz 0.001
_NORMAL_KURTOSIS = 3.0  # of noise [1]; steps 3.8 to 5.5, tones 1.5 to 2.3
_DOUBT = 2.0  # times the noise, below which a spectrum does not show the motion


def half_window(position: Vector, dt: float, derivative: int = 1) -> int:
    """Return half the width [samples] of the widest window that does not change the motion.

    The bandwidth is 50 to 110 Hz: a wider window is chosen if it differs from the narrowest by no
    more than the encoder noise. It rises to 360 Hz if narrower windows recover more than noise, as
    with a tool that follows steps. It falls to 3 Hz (see `_quietest`) if encoder noise is more than
    a hundredth of the velocity, or of the acceleration for a model that uses it (`derivative` 2).
    """
    samples = np.ascontiguousarray(position, dtype=np.float64).tobytes()
    return _half_window(samples, dt, derivative)


@lru_cache(maxsize=4)
def _half_window(samples: bytes, dt: float, derivative: int) -> int:
    position = np.frombuffer(samples)
    return _quietest(position, dt, _faithful(position, dt), derivative)


def _faithful(position: Vector, dt: float) -> int:
    """Return half the width [samples] of the widest window that changes nothing beyond noise."""
    noise = position_noise(position, dt)

    def smooth(half: int) -> Vector:
        return local_polynomial(position, half, SMOOTHING_ORDER)

    halves = [max(3, round(seconds / dt)) for seconds in HALF_WINDOWS_S]
    narrow, half = smooth(halves[-1]), halves[-1]
    for narrower in (max(3, round(seconds / dt)) for seconds in _NARROWER_S):
        less = smooth(narrower)
        if float(np.std(less - narrow)) < noise:
            break
        narrow, half = less, narrower
    if half < halves[-1]:
        return half
    for half in halves:
        if float(np.max(np.abs(smooth(half) - narrow))) < 2.0 * noise:
            return half
    return halves[-1]


def _quietest(position: Vector, dt: float, half: int, derivative: int) -> int:
    """Return half the width [samples] with the least expected error of a derivative.

    The error of a window is the motion that it removes plus the encoder noise that it passes
    (Wiener). No window is wider than needed for a noise error below `_QUIET_SPEED`.
    """
    most = int(_LONGEST_WINDOW * position.size)
    halves = [half, *(h for h in (round(s / dt) for s in _WIDER_S) if half < h <= most)]
    motion, noise, omega = _spectra(position, dt, halves[-1])
    ideal = (1j * omega) ** derivative
    wanted = float(np.sum(np.abs(ideal) ** 2 * motion))
    errors = []
    for each in halves:
        passed = _response(each, dt, position.size, derivative)
        by_noise = float(np.sum(np.abs(passed) ** 2 * noise))
        errors.append((float(np.sum(np.abs(passed - ideal) ** 2 * motion)) + by_noise, each))
        if by_noise < _QUIET_SPEED**2 * wanted:
            break
    return min(errors)[1]


def _spectra(position: Vector, dt: float, half: int) -> tuple[Vector, Vector, Vector]:
    """Return the power of motion and of noise in the position, and the angular frequencies.

    The noise is the larger of white noise at the level of the quietest of the highest octaves, and
    the quantisation error of the encoder's steps along the path behind the widest window: at a
    steady slow speed this error is a tone within the band. Powers are means over groups of
    bins, ever wider.
    """
    length, omega = _frequencies(position.size, dt)
    per_difference = (2.0 * np.sin(0.5 * omega * dt)) ** 2
    window = np.hanning(position.size - 1)
    starts = np.unique(np.geomspace(1.0, omega.size, _GROUPS).astype(np.int64)) - 1
    sizes = np.diff(np.append(starts, omega.size))

    def power(row: Vector) -> Vector:
        found = np.abs(np.fft.rfft(np.diff(row) * window, length)[1:]) ** 2 / per_difference
        return np.asarray(np.repeat(np.add.reduceat(found, starts) / sizes, sizes))

    measured = power(position)
    octaves = [omega.size >> i for i in range(_FLOOR_OCTAVES + 1)]
    levels = [float(np.mean(measured[low:high])) for high, low in pairwise(octaves) if low < high]
    noise = np.full(omega.size, min(levels))
    if step := quantisation_step(position):
        path = differentiate(position, dt, half)[0]
        noise = np.maximum(noise, power(step * np.round(path / step) - path))
    return np.maximum(measured - _DOUBT * noise, 0.0), noise, omega


def _frequencies(samples: int, dt: float) -> tuple[int, Vector]:
    """Return a length that is fast to transform, and its angular frequencies [rad/s] but 0."""
    length = fast_length(samples)
    omega = 2.0 * np.pi * np.fft.rfftfreq(length, dt)[1:]
    return length, np.asarray(omega, dtype=np.float64)


def _response(half: int, dt: float, samples: int, derivative: int) -> NDArray[np.complex128]:
    """Return the response [1/s^n] of the n-th derivative, at the bins of `_spectra`."""
    length, omega = _frequencies(samples, dt)
    middle = 4 * half + 2
    impulse = np.zeros(2 * middle + 1)
    impulse[middle] = 1.0
    answer = differentiate(impulse, dt, half)[derivative]
    found = np.fft.rfft(answer, length)[1:] * np.exp(1j * omega * dt * middle)
    return np.asarray(found, dtype=np.complex128)


def lost_motion(
    position: Vector, dt: float, half: int, number: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return draws (3, number, samples) of the movement that a window removes, and its derivatives.

    It has the spectrum of the motion beyond the window, at random phases: of an encoder with large
    steps the window must be wide, and then a mass feels accelerations that no derivative shows.
    """
    motion, _, omega = _spectra(position, dt, half)
    length = _frequencies(position.size, dt)[0]
    window = np.hanning(position.size - 1)
    removed = np.abs(1.0 - _response(half, dt, position.size, 0)) ** 2 * motion
    size = np.sqrt(removed * length / float(window @ window))
    white = np.fft.rfft(rng.standard_normal((number, length))) / np.sqrt(length)
    white[:, 0], white[:, 1:] = 0.0, white[:, 1:] * size
    slopes = (1j * np.append(0.0, omega)) ** np.arange(3)[:, None]
    found = np.fft.irfft(white * slopes[:, None, :], length)
    return np.asarray(found[..., : position.size], dtype=np.float64)


def too_quick(position: Vector, dt: float, half: int) -> Vector:
    """Return 1 where the window reaches a motion that is quicker than it, for a moment.

    Half the window finds another velocity there, beyond the encoder noise. A motion that a
    window removes all along is noise (see `lost_motion`); a tool that a limiter throws back is not.
    Where such moments take more than `_LARGEST_QUICK_SHARE` of the time they are the motion: all
    samples are 0 then.
    """
    none, near = np.zeros(position.size), max(3, half // 2)
    if near >= half:
        return none
    impulse = np.zeros(8 * half + 1)
    impulse[4 * half] = 1.0
    found, by_noise = (_recovered(row, dt, half, near) for row in (position, impulse))
    noise = position_noise(position, dt) * float(np.linalg.norm(by_noise))
    speed = float(np.std(differentiate(position, dt, half)[1]))
    quick = np.abs(found) > max(SIGMAS * noise, _THROWN_SPEED * speed)
    quick[: 2 * half] = quick[-2 * half :] = False  # there a window looks to one side only
    reached = np.convolve(quick, np.ones(2 * half + 1), "same") > 0.5
    return reached.astype(np.float64) if np.mean(reached) <= _LARGEST_QUICK_SHARE else none


def _recovered(position: Vector, dt: float, half: int, near: int) -> Vector:
    """Return the velocity that the window of `near` finds and the one of `half` does not."""
    wide, narrow = (differentiate(position, dt, each)[1] for each in (half, near))
    return np.asarray(narrow - wide)


def narrowest(dt: float) -> int:
    """Return half the width [samples] of the narrowest window, which follows steps best."""
    return max(3, round(_NARROWER_S[-1] / dt))


def moves_in_steps(position: Vector, force: Vector, dt: float) -> bool:
    """Return whether the velocity changes in steps between samples, which every window smooths.

    A link that jitters or loses packets causes such steps. They are detected if even the narrowest
    window is too wide, and the narrowest usual one loses more than `NOISY_SPEED` of the velocity.
    Steps have no highest frequency, so each narrower window recovers more of them, and they jump;
    of a quick motion that a wider window follows already the narrowest recovers nothing, and
    tones reach their largest values more often than noise does.
    """
    narrow, usual = narrowest(dt), max(3, round(HALF_WINDOWS_S[-1] / dt))
    if narrow < usual and half_window(position, dt) <= narrow:
        inner = slice(2 * usual, -2 * usual)  # at the ends a window looks to one side only
        found = _recovered(position, dt, usual, narrow)[inner]
        speed = float(np.std(differentiate(position, dt, usual)[1][inner]))
        lost = float(np.mean(found**2))
        jumps = float(np.mean(found**4)) > _NORMAL_KURTOSIS * lost**2
        return lost > (NOISY_SPEED * speed) ** 2 and jumps and _recovers_more(position, dt, usual)
    return _noise_is_motion(position, force, dt)


def _recovers_more(position: Vector, dt: float, usual: int) -> bool:
    """Return whether the narrowest window recovers more than the one before it."""
    narrow, between = narrowest(dt), max(3, round(_NARROWER_S[1] / dt))
    if between == narrow:
        return True
    before, more = ((usual, between), (between, narrow))
    least = _STEPS_POWER_RATIO * _power_recovered(position, dt, *before)
    return _power_recovered(position, dt, *more) > least


def _power_recovered(position: Vector, dt: float, half: int, near: int) -> float:
    """Return the mean square of the velocity that a narrower window recovers, beyond noise."""
    impulse = np.zeros(8 * half + 1)
    impulse[4 * half] = 1.0
    found, by_noise = (_recovered(row, dt, half, near) for row in (position, impulse))
    noise = position_noise(position, dt) ** 2 * float(by_noise @ by_noise)
    return max(float(np.var(found[2 * half : -2 * half])) - noise, 0.0)


def _noise_is_motion(position: Vector, force: Vector, dt: float) -> bool:
    """Return whether the force follows the apparent noise of the position.

    At a low rate steps look like noise of the encoder, which has no effect on the force. Where the
    force is large (near a touch it follows nothing), its differences are explained by those of the
    position about the same sample, by least squares.
    """
    speed_noise = position_noise(position, dt) / (np.sqrt(2.0) * dt)
    if speed_noise < NOISY_SPEED * float(np.std(np.gradient(position, dt))):
        return False
    moved, felt = (np.diff(row, _FELT_ORDER) for row in (position, force))
    taps = np.lib.stride_tricks.sliding_window_view(moved, 2 * _FELT_REACH + 1)
    large = np.abs(force) > _LARGE_FORCE * np.quantile(np.abs(force), 0.999)
    large = np.lib.stride_tricks.sliding_window_view(large, force.size - taps.shape[0] + 1)
    rows = np.all(large, axis=1)
    if np.count_nonzero(rows) < _FEWEST_FELT:
        return False
    taps, felt = taps[rows], felt[_FELT_REACH : felt.size - _FELT_REACH][rows]
    left = felt - taps @ np.linalg.lstsq(taps, felt, rcond=None)[0]
    return float(np.sum(left**2)) < (1.0 - _FELT_SHARE) * float(np.sum(felt**2))
