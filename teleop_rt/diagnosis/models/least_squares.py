"""Linear least squares from normal equations: few unknowns, many times."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.kernels.jit import kernel

_WEAKEST = 1e-5  # of a row's length beyond the others; below it singular values decide
_SWEEPS, _STILL = 10_000, 1e-12  # of a coordinate descent, and the step [of a range] that ends it
_NO_ENERGY = 1e-300  # of a row
_RANK = 1e-11  # of the largest singular value


def solution(gram: Matrix, right: Vector) -> Vector:
    """Return the least x with gram x = right, for a gram matrix of rows of about unit length.

    It uses Cholesky's factors, in a tenth of the time of a singular value decomposition; the latter
    is used if a row is, up to `_WEAKEST`, a combination of others.
    """
    factor, found = np.array(gram, order="C"), np.array(right, order="C")
    columns = found.reshape(found.shape[0], -1)
    if not _solve_by_cholesky(factor, columns):
        return np.asarray(np.linalg.lstsq(gram, right, rcond=_RANK)[0], dtype=np.float64)
    return found


@kernel
def _solve_by_cholesky(gram: Matrix, columns: Matrix) -> bool:
    """Factor and solve in place; return whether no row is nearly a combination of others."""
    size = gram.shape[0]
    for i in range(size):
        for j in range(i + 1):
            rest = gram[i, j]
            for k in range(j):
                rest -= gram[i, k] * gram[j, k]
            if j < i:
                gram[i, j] = rest / gram[j, j]
            elif not rest >= _WEAKEST**2:  # or not a number
                return False
            else:
                gram[i, i] = math.sqrt(rest)
    for column in range(columns.shape[1]):
        for i in range(size):
            for k in range(i):
                columns[i, column] -= gram[i, k] * columns[k, column]
            columns[i, column] /= gram[i, i]
        for i in range(size - 1, -1, -1):
            for k in range(i + 1, size):
                columns[i, column] -= gram[k, i] * columns[k, column]
            columns[i, column] /= gram[i, i]
    return True


def within_bounds(gram: Matrix, right: Vector, least: Vector, most: Vector) -> Vector:
    """Return x of least x gram x / 2 - right x between its bounds (coordinate descent)."""
    found = np.clip(np.zeros_like(right), least, most)
    _descend(gram, right, least, most, found)
    return found


@kernel
def _descend(gram: Matrix, right: Vector, least: Vector, most: Vector, out: Vector) -> None:
    for _ in range(_SWEEPS):
        moved = 0.0
        for i in range(out.size):
            pull = right[i]
            for j in range(out.size):
                pull -= gram[i, j] * out[j]
            value = min(max(out[i] + pull / gram[i, i], least[i]), most[i])
            moved = max(moved, abs(value - out[i]) / (most[i] - least[i]))
            out[i] = value
        if moved < _STILL:
            break


def damped_step(
    slopes: Matrix, residual: Vector, place: Vector, damping: float, moving: NDArray[np.bool_]
) -> tuple[Vector, float]:
    """Return the step of the `moving` parameters, and the predicted fall of chi-square.

    The step keeps all parameters between 0 and 1.
    """
    gram, right = slopes @ slopes.T, slopes @ residual
    outward = ((place <= 0.0) & (right < 0.0)) | ((place >= 1.0) & (right > 0.0))
    free = np.flatnonzero(moving & ~outward & (np.diag(gram) > 0.0))
    step = np.zeros_like(place)
    if free.size:
        held = gram[np.ix_(free, free)]
        damped = held + damping * np.diag(np.diag(held))
        least, most = np.minimum(-place[free], -1e-12), np.maximum(1.0 - place[free], 1e-12)
        step[free] = within_bounds(damped, right[free], least, most)
    return step, float(2.0 * right @ step - step @ gram @ step)


def least_squares(rows: Matrix, target: Vector) -> Vector:
    """Return theta that minimises |target - theta rows|^2."""
    return signed_least_squares(rows, target, np.zeros(rows.shape[0], dtype=bool))


def explained(rows: Matrix, target: Vector) -> float:
    """Return the part of |target|^2 that the rows explain."""
    return float((rows @ target) @ least_squares(rows, target))


def centred(rows: Matrix, constant: int | None) -> tuple[Matrix, Vector]:
    """Return the rows without their part along the `constant` one, and these parts.

    An encoder's zero may lie far from the motion. The force of a spring then is a large one that a
    bias takes off again, and a prior on the size of either would change their difference.
    """
    if constant is None or not (energy := float(rows[constant] @ rows[constant])):
        return rows, np.zeros(rows.shape[0])
    shares: Vector = rows @ rows[constant] / energy
    shares[constant] = 0.0
    return rows - shares[:, None] * rows[constant], shares


def uncentred(theta: Vector, shares: Vector, constant: int | None) -> Vector:
    """Return the parameters of the rows before they were `centred`."""
    if constant is not None:
        theta = theta.copy()
        theta[constant] -= float(shares @ theta)
    return theta


def signed_least_squares(
    rows: Matrix, target: Vector, nonnegative: NDArray[np.bool_], weak: float = 0.0
) -> Vector:
    """Return theta of least |target - theta rows|^2, >= 0 where `nonnegative` (active set).

    `weak` is the prior precision: it times the energy of each row's force is added to the squares.
    """
    if rows.shape[0] == 0:
        return np.zeros(0)
    # Of two different matrices: of one with itself BLAS takes four times as long.
    return signed_solution(rows @ np.concatenate((rows, target[None, :])).T, nonnegative, weak)


def signed_solution(products: Matrix, nonnegative: NDArray[np.bool_], weak: float = 0.0) -> Vector:
    """Return the same from the products of the rows with the rows and, last, with the target."""
    size = products.shape[0]
    scale, factor, system = np.empty(size), np.empty((size, size)), np.empty((size, size + 1))
    found = np.empty((size, 1))
    if _solved_at_once(products, weak, scale, system, factor, found):
        theta = found[:, 0]
        if not np.any(nonnegative & (theta < 0.0)):
            return theta / scale
    return _by_active_set(system, scale, nonnegative)


@kernel
def _solved_at_once(
    products: Matrix, weak: float, scale: Vector, system: Matrix, factor: Matrix, out: Matrix
) -> bool:
    """Scale the products to a `system` of rows of about unit length; return if it is solved.

    A row without energy has the scale 0, and it is not solved then.
    """
    size, live = products.shape[0], True
    for i in range(size):
        scale[i] = math.sqrt(products[i, i]) if products[i, i] > _NO_ENERGY else 0.0
        live = live and scale[i] > 0.0
    for i in range(size):
        mine = scale[i] if scale[i] > 0.0 else 1.0
        for j in range(size):
            system[i, j] = products[i, j] / (mine * (scale[j] if scale[j] > 0.0 else 1.0))
        system[i, i] += weak
        system[i, size] = out[i, 0] = products[i, size] / mine
        for j in range(size):
            factor[i, j] = system[i, j]
    return live and _solve_by_cholesky(factor, out)


def _by_active_set(system: Matrix, scale: Vector, nonnegative: NDArray[np.bool_]) -> Vector:
    """Return the solution in which rows that would be negative are left out, one by one."""
    gram, right, live = system[:, :-1], system[:, -1], scale > 0.0
    theta, free = np.zeros(scale.size), live.copy()
    for _ in range(2 * theta.size):
        theta[:] = 0.0
        index = np.flatnonzero(free)
        if index.size:
            theta[index] = solution(gram[np.ix_(index, index)], right[index])
        negative = nonnegative & (theta < 0.0)
        if negative.any():
            free[int(np.argmin(np.where(negative, theta, 0.0)))] = False
            continue
        if free.all():
            break
        pull = right - gram @ theta
        wants = live & ~free & (pull > 1e-9 * np.linalg.norm(right))
        if not wants.any():
            break
        free[int(np.argmax(np.where(wants, pull, 0.0)))] = True
    return np.asarray(theta / np.where(live, scale, 1.0), dtype=np.float64)
