import numpy as np
import pytest

from teleop_rt.estimation.batch import least_squares


def problem(samples=200_000, condition=1e3):
    rng = np.random.default_rng(0)
    phi = rng.normal(size=(samples, 5))
    phi[:, 1] = phi[:, 0] + phi[:, 1] / condition
    phi *= np.logspace(-2, 2, 5)
    theta = np.array([3.0, -2.0, 5.0, 1.0, 0.5])
    return phi, phi @ theta + rng.normal(size=samples), theta


def test_it_gives_the_digits_of_an_orthogonal_method():
    phi, y, _ = problem()
    exact = np.linalg.lstsq(phi, y, rcond=None)[0]
    assert least_squares(phi, y) == pytest.approx(exact, rel=1e-8)


def test_a_nearly_dependent_column_is_left_to_the_orthogonal_method():
    phi, y, _ = problem(samples=2000, condition=1e7)
    exact = np.linalg.lstsq(phi, y, rcond=None)[0]
    assert least_squares(phi, y) == pytest.approx(exact, rel=1e-12)


def test_what_cannot_be_solved_is_refused():
    phi, y, _ = problem(samples=100)
    with pytest.raises(ValueError, match="cannot determine"):
        least_squares(phi[:3], y[:3])
    phi[5, 2] = np.nan
    with pytest.raises(ValueError, match="finite"):
        least_squares(phi, y)
