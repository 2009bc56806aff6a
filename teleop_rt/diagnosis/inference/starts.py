"""The start of a fit with one more effect, and the gain by which a screening finds it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Effect, Matrix, Vector
from teleop_rt.diagnosis.models.axes import grid
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.least_squares import explained
from teleop_rt.diagnosis.models.model import CandidateModel, phases

_SPANNED = 1e-8  # of a row's energy; a smaller part outside the model is a rounding error


@dataclass(frozen=True)
class Start:
    """The start of a fit with one more effect, and the screened fall of chi-square.

    `model` is the fit's with the effect, `zeta` are all its nonlinear parameters; `other` are those
    of a second place from which the fit is tried.
    """

    effect: Effect
    zeta: Vector
    gain: float
    model: CandidateModel
    other: Vector | None = None


def extended(model: CandidateModel, effect: Effect) -> CandidateModel:
    """Return the model with one more effect."""
    return replace(model, effects=(*model.effects, effect))


def points_of(problem: Problem, effect: Effect) -> list[Vector]:
    """Return the grid of the effect's nonlinear parameters without its amplitude."""
    searched = [shape for shape in effect.shapes if not (shape.phase and phases(effect))]
    axes = [grid(shape, problem.motion.scales) for shape in searched]
    return [np.array(point) for point in product(*axes)]


def chi2_falls(
    rows: NDArray[np.float64], own: Matrix, residual: Vector, nonnegative: NDArray[np.bool_]
) -> tuple[Vector, Matrix]:
    """Return the fall of chi-square by the rows of each point beyond `own`, and their factors.

    `rows` are points x rows x values. The fall is 0 where the model spans a row, or a factor has
    the wrong sign.
    """
    # Of two products with few columns each, the part within `own` takes half of the time.
    along = rows @ own
    gram = rows @ rows.transpose(0, 2, 1)
    whole = np.diagonal(gram, axis1=1, axis2=2)
    gram = gram - along @ along.transpose(0, 2, 1)
    energy = np.diagonal(gram, axis1=1, axis2=2)
    inside = energy < _SPANNED * whole  # the rest is a rounding error, which may be below 0
    scale = np.sqrt(np.maximum(np.where(inside, whole, energy), 1e-300))
    inverse = np.linalg.pinv(gram / (scale[:, :, None] * scale[:, None, :]), 1e-10, hermitian=True)
    right = (rows @ residual - along @ (own.T @ residual)) / scale
    theta = np.einsum("pij,pj->pi", inverse, right)
    spanned = np.any(inside, axis=1)
    wrong = np.any(nonnegative & (theta < 0.0), axis=1)
    return np.where(spanned | wrong, 0.0, np.sum(right * theta, axis=1)), theta / scale


def gain_of_slopes(fit: Fit, slopes: Matrix) -> float:
    """Return the fall of chi-square predicted by a fit's slopes, with free linear parameters."""
    if not slopes.shape[0]:
        return 0.0
    return explained(np.concatenate([fit.free_columns, slopes]), fit.residual)
