"""The error of any choice of columns on interleaved blocks, fitted without each block."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.diagnosis.models.held_out import FOLDS, folds

_ROWS = 8000  # samples of the normal equations; more change the third digit of an error
_RIDGE = 1e-10  # of the columns' mean square; keeps collinear terms solvable


class FoldEquations:
    """Normal equations of each fold over the samples that count, from which errors follow.

    The rows of the base are always fitted; of the `terms` those at the places asked for.
    """

    def __init__(self, own: Matrix, terms: Matrix, force: Vector, where: Vector) -> None:
        """Make the equations of rows (columns x samples) over the samples with `where` > 0."""
        chosen = np.flatnonzero(where > 0.0)
        chosen = chosen[:: max(1, chosen.size // _ROWS)]
        fold = folds(force.size)[chosen]
        used = np.concatenate((own, terms))[:, chosen]
        self._own, self.places = len(own), range(len(terms))
        sizes = np.sqrt(np.mean(used**2, axis=1)) + 1e-300
        used, self.sizes = used / sizes[:, None], sizes[self._own :]
        self._parts = []
        for number in range(FOLDS):
            a, f = used[:, fold == number], force[chosen][fold == number]
            self._parts.append((a @ a.T, a @ f, float(f @ f)))
        self._gram = np.sum([part[0] for part in self._parts], axis=0)
        self._right = np.sum([part[1] for part in self._parts], axis=0)
        self.count = int(chosen.size)

    def energy(self, places: Sequence[int]) -> float:
        """Return the mean square of the residual beside these terms on blocks hidden in turn."""
        chosen = self._with_own(places)
        square = np.ix_(chosen, chosen)
        left = 0.0
        for gram, right, whole in self._parts:
            c = self._solved((self._gram - gram)[square], (self._right - right)[chosen])
            left += whole - 2.0 * float(c @ right[chosen]) + float(c @ gram[square] @ c)
        return max(left, 0.0) / max(self.count, 1)

    def coefficients(self, places: Sequence[int]) -> Vector:
        """Return the coefficients of these terms over all samples."""
        chosen = self._with_own(places)
        found = self._solved(self._gram[np.ix_(chosen, chosen)], self._right[chosen])
        return np.asarray(found[self._own :] / self.sizes[list(places)], dtype=np.float64)

    def _with_own(self, places: Sequence[int]) -> list[int]:
        return [*range(self._own), *(self._own + place for place in places)]

    def _solved(self, gram: Matrix, right: Vector) -> Vector:
        ridge = _RIDGE * self.count * np.eye(right.size)
        return np.asarray(np.linalg.solve(gram + ridge, right), dtype=np.float64)
