"""Least squares of a model to whitened data, separable into linear and nonlinear parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Effect, Matrix, Vector
from teleop_rt.contact.effects.sensor import range_of
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.models.axes import Axes
from teleop_rt.diagnosis.models.base import Base
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.least_squares import (
    centred,
    damped_step,
    signed_least_squares,
    solution,
    uncentred,
)
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.models.predict import columns, force_of, settled
from teleop_rt.diagnosis.noise.saturated import Flexible, basis
from teleop_rt.diagnosis.noise.whiten import Whitener
from teleop_rt.diagnosis.samples.motion import RecordedMotion

NOTHING = Base("none", ())
_INSIDE = (1e-3, 1.0 - 1e-3)  # of a parameter's range: limits for the start of a descent
_DERIVATIVE_STEP = 5e-4  # of its range: step of the difference that approximates a derivative
_DAMPING = 1e-3  # of the curvature: initial and smallest damping (Marquardt)
_LEAST_FALL = 0.01  # of chi-square; noise alone changes it by more
_ROUNDING = 1e-7  # of chi-square; a smaller fall is a rounding error
HOPELESS = 2.0  # times the chi-square to beat; far above it a descent needs to fall quickly
_TRIED, _LITTLE = 3, 0.05  # steps after which it does not, if the next promises less of chi-square
_UNSATURATED = 0.97  # of half a channel's range; a force beyond it may be clipped
_T = TypeVar("_T")


@dataclass(frozen=True)
class Fit:
    """A fitted model: nonlinear and linear parameters, whitened residual and columns."""

    model: CandidateModel
    zeta: Vector
    theta: Vector
    residual: Vector
    columns: Matrix
    effective: float

    @property
    def chi2(self) -> float:
        """Sum of squares of the whitened residual; the noise alone gives the number of values."""
        return float(self.residual @ self.residual)

    @property
    def bic(self) -> float:
        """Schwarz's criterion, up to a constant of the data."""
        return self.chi2 + self.model.size * float(np.log(self.effective))

    @property
    def free_columns(self) -> Matrix:
        """The columns of linear parameters that are not held at 0 by their sign.

        A late force would fit a damping below 0; the force of that damping is not the base's.
        """
        return np.asarray(self.columns[self.theta != 0.0], dtype=np.float64)

    @property
    def elsewhere(self) -> Fit:
        """The fit without the past of its own recording, for the prediction of another one."""
        if self.model.past == "none":
            return self
        model = replace(self.model, past="none")
        kept = [i for i, item in enumerate(self.model.linear) if item in model.linear]
        return replace(self, model=model, theta=self.theta[kept], columns=self.columns[kept])

    def force_on(self, motion: RecordedMotion) -> Vector:
        """Return the force in free run: by the motion alone, memories simulated from the start."""
        return force_of(self.model, motion, self.zeta, self.theta)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.model.effects)


@dataclass(frozen=True)
class Problem:
    """Data to fit: motion, measured force, and the whitener of its noise.

    `surface` is the position [rig unit] from which the motion counts the penetration,
    `resolution` the standard deviation of the position's noise, `settling` the number of
    samples over which the channels' filters spread a jump, and `force_step` the quantisation step
    of the force, 0 if none is visible.
    """

    motion: RecordedMotion
    force: Vector
    whitener: Whitener
    surface: float = 0.0
    resolution: float = 0.0
    settling: int = 0
    force_step: float = 0.0
    kept: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def made(self, name: str, make: Callable[[], _T]) -> _T:
        """Return the result of `make` for this problem, computed once and kept with the problem."""
        if name not in self.kept:
            self.kept[name] = make()
        found: _T = self.kept[name]
        return found

    @cached_property
    def target(self) -> Vector:
        """The whitened force."""
        return self.whitener(self.force)

    @cached_property
    def flexible(self) -> Flexible:
        """The flexible description of the force, by this noise."""
        return Flexible(self.whitener, basis(self.motion))

    @cached_property
    def flexible_in_contact(self) -> Flexible:
        """The flexible description of a force that acts in contact alone."""
        return Flexible(self.whitener, basis(self.motion) * touches(self.motion.x))

    @cached_property
    def _weak(self) -> float:
        """Prior precision of a term: its standard deviation is that of the whole force.

        It bounds two terms that cancel each other if the data do not determine their difference.
        """
        return 1.0 / max(float(self.target @ self.target), 1.0)

    def keeping(self, mask: Vector) -> Problem:
        """Return the problem with another `mask` of its samples (0 to 1)."""
        return replace(self, whitener=replace(self.whitener, mask=mask))

    def residual(self, fit: Fit) -> Vector:
        """Return the residual of a fit, on every sample."""
        return self.force - fit.force_on(self.motion)

    def mean_square(self, fit: Fit, where: NDArray[np.bool_]) -> float:
        """Return the mean square of that residual over the given samples."""
        return float(np.mean(self.residual(fit)[where] ** 2))

    def rows_of(
        self, effect: Effect, places: Sequence[Vector], shift: float = 0.0
    ) -> NDArray[np.float64]:
        """Return the whitened columns of an effect alone, for each of its shape parameters.

        `shift` is the distance by which the surface is nearer than the motion assumes.
        """
        model = CandidateModel(replace(NOTHING, finds_surface=True), (effect,))
        zetas = [np.concatenate([[shift], zeta]) for zeta in places]
        found = np.array([Course.of(model, self.motion, zeta).added for zeta in zetas])
        return self.whitener(found)

    def solve(self, model: CandidateModel, zeta: Vector, guess: Vector | None = None) -> Fit:
        """Return the best linear parameters at these nonlinear ones, with their signs kept."""
        target = self.target
        course = Course.of(model, self.motion, zeta)
        if guess is None and model.passes > 1:
            guess = self._first_guess(course)
        for further in reversed(range(model.passes)):
            parts = columns(course, guess)
            matrix = (
                self.whitener(np.array(parts.columns))
                if parts.columns
                else np.zeros((0, target.size))
            )
            wanted = target - self.whitener(parts.offset) if np.any(parts.offset) else target
            rows, shares = centred(matrix, model.base.bias_place)
            theta = signed_least_squares(rows, wanted, model.nonnegative, self._weak)
            theta = uncentred(theta, shares, model.base.bias_place)
            if not further or (guess is not None and settled(course, guess, theta)):
                break
            guess = theta
        residual = wanted - theta @ matrix
        return Fit(model, zeta, theta, residual, matrix, self.whitener.effective)

    def _first_guess(self, course: Course) -> Vector:
        """Fit without clamp, compliance and limit; below the limit, where there is one."""
        model, parts = course.model, columns(course, None)
        keep = self.whitener.mask.copy()
        for effect, (_, eta) in zip(model.effects, course.parameters, strict=True):
            if effect.acts == "limits_force":
                middle, half = range_of(effect, eta)
                keep = keep * (np.abs(self.force - middle) < _UNSATURATED * half)
        rows = np.array(parts.columns).reshape(len(parts.columns), keep.size)
        theta = signed_least_squares(rows * keep, self.force * keep, model.nonnegative)
        for effect, parameters in zip(model.effects, course.parameters, strict=True):
            if effect.acts == "deflects":
                theta = stiffer(model, theta, effect, parameters, self.motion.scales["force"])
        return theta

    def refine(
        self, model: CandidateModel, start: Vector, evaluations: int = 15, beat: float = inf
    ) -> Fit:
        """Return the least-squares fit over all parameters, from a start of the nonlinear ones.

        Gauss-Newton descent with Marquardt's damping over the nonlinear parameters, with the linear
        ones projected out (Golub and Pereyra; Kaufman's simplification of the derivative). A failed
        step is tried once more without the parameters that move a contact, because the force jumps
        there, and is then shortened. The descent ends if the predicted fall of chi-square is below
        chance, after `evaluations` steps, or where it will hardly reach the chi-square to `beat`.
        """
        if not model.coordinates:
            return self.solve(model, start)
        axes = Axes.of(model, self.motion.scales)
        place = np.clip(axes.place(start), *_INSIDE)
        fit = self.solve(model, axes.value(place))
        slopes, damping = self._slopes(fit, axes, place), _DAMPING
        everything = np.ones(place.size, dtype=bool)
        smooth = np.array([not model.moves_contact(c) for c in model.coordinates])
        moving = everything
        for tried in range(evaluations):
            step, promised = damped_step(slopes, fit.residual, place, damping, moving)
            undamped = moving is everything and damping == _DAMPING
            little = undamped and promised < _LITTLE * fit.chi2
            if little and tried >= _TRIED and fit.chi2 > HOPELESS * beat:
                break
            if promised < max(_LEAST_FALL, _ROUNDING * fit.chi2):
                if moving is everything:
                    break
                moving, damping = everything, 10.0 * damping
                continue
            further = np.clip(place + step, 0.0, 1.0)
            trial = self.solve(model, axes.value(further), fit.theta)
            fallen = fit.chi2 - trial.chi2
            if fallen > 0.0:
                fit, place, damping = trial, further, max(damping / 10.0, _DAMPING)
            if 0.0 < fallen < _LEAST_FALL:
                break
            if fallen > 0.0:
                slopes, moving = self._slopes(fit, axes, place), everything
            elif moving is everything and np.any(smooth) and not np.all(smooth):
                moving = smooth
            else:
                moving, damping = everything, 10.0 * damping
        return fit

    def _slopes(self, fit: Fit, axes: Axes, place: Vector) -> Matrix:
        """Return the derivatives of the whitened prediction, orthogonal to the linear columns."""
        rows = np.empty((place.size, self.force.size))
        steps = np.where(place < 0.5, _DERIVATIVE_STEP, -_DERIVATIVE_STEP)
        for i, step in enumerate(steps):
            beside = place.copy()
            beside[i] += step
            rows[i] = force_of(fit.model, self.motion, axes.value(beside), fit.theta)
        if fit.model.passes > 1:  # then the fit's own prediction is linearised
            rows -= fit.force_on(self.motion)
            whitened = self.whitener(rows)
        else:
            whitened = self.whitener(rows) - (self.target - fit.residual)
        whitened /= steps[:, None]
        own = fit.free_columns
        if not own.size:
            return whitened
        scale = np.sqrt(np.einsum("ij,ij->i", own, own))
        own = own / np.maximum(scale, 1e-300)[:, None]
        share = solution(own @ own.T, own @ whitened.T)
        return np.asarray(whitened - share.T @ own, dtype=np.float64)


def stiffer(
    model: CandidateModel,
    theta: Vector,
    joint: Effect,
    parameters: tuple[float, Vector],
    strongest: float,
) -> Vector:
    """Return linear parameters with the stiffness corrected for a joint in series.

    `parameters` are the joint's compliance and shape, `strongest` is the largest force, at which
    its deflection counts.
    """
    found = theta.copy()
    if not model.base.has_power:
        compliance, eta = parameters
        nothing = np.zeros(1)
        compliance *= joint.step(nothing, strongest, 0.0, 0.0, 0.0, 1.0, eta) / strongest
        place = [linear.name for linear in model.linear].index("k")
        found[place] /= max(1.0 - compliance * found[place], 0.1)
    return found
