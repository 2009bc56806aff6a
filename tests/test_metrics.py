import numpy as np
import pytest

from teleop_rt.metrics import error_of_size, in_percent, lag_s, nrmse


def contact_force(t):
    """3 Hz in contact, with a smooth lift-off every 2.3 s."""
    lift = 120 * np.exp(-((((t + 1.0) % 2.3 - 1.15) / 0.25) ** 2))
    return np.maximum(0.0, 40 + 25 * np.sin(2 * np.pi * 3 * t) - lift)


@pytest.mark.parametrize("lag_ms", [0.0, 0.4, -3.3, 20.0, 150.0, 1000.0])
def test_lag_is_read_to_a_fraction_of_a_sample(lag_ms):
    t = np.arange(0, 12, 1e-3)
    found = lag_s(contact_force(t), contact_force(t - lag_ms * 1e-3), 1e-3, 1.2)
    assert found == pytest.approx(lag_ms * 1e-3, abs=5e-5)


def test_lag_is_not_pulled_by_noise_or_gaps():
    rng = np.random.default_rng(1)
    t = np.arange(0, 12, 1e-3)
    late = contact_force(t - 0.150) + rng.normal(0, 1.0, t.size)
    late[rng.random(t.size) < 0.2] = np.nan
    assert lag_s(contact_force(t), late, 1e-3, 1.5) == pytest.approx(0.150, abs=2e-4)


def test_lag_of_a_motion_that_repeats_itself_is_unknown():
    t = np.arange(0, 4, 1e-3)
    wave = np.sin(2 * np.pi * 3 * t)
    assert lag_s(wave, np.roll(wave, 150), 1e-3, 1.5) is None
    assert lag_s(wave, np.roll(wave, 20), 1e-3, 0.1) == pytest.approx(0.020, abs=1e-4)


def test_lag_of_a_constant_is_unknown():
    assert lag_s(np.ones(1000), np.ones(1000), 1e-3, 0.1) is None


def test_a_lag_at_the_edge_of_its_search_is_unknown():
    t = np.arange(0, 12, 1e-3)
    creep = 12.6 + 0.05 * t
    assert lag_s(creep, 12.7 + 0.001 * t**2, 1e-3, 0.5) is None
    assert lag_s(contact_force(t), contact_force(t - 0.6), 1e-3, 0.5) != pytest.approx(0.5)


def test_the_error_of_a_force_that_hardly_moves_is_a_share_of_the_force():
    held = np.array([12.7, 12.75, 12.7, np.nan])
    assert error_of_size(held, held - 0.1) == pytest.approx(0.1 / 12.75)
    swung = np.array([0.0, 10.0, -10.0])
    assert error_of_size(swung, swung + 1.0) == nrmse(swung, swung + 1.0)
    assert error_of_size(np.zeros(5), np.ones(5)) is None


def test_nrmse_is_equation_4_1():
    measured = np.array([0.0, 10.0, 5.0, np.nan])
    predicted = np.array([1.0, 9.0, 6.0, 100.0])
    assert nrmse(measured, predicted) == pytest.approx(0.1)
    assert nrmse(np.ones(5), np.zeros(5)) is None


@pytest.mark.parametrize(
    ("share", "said"), [(1.2, "120 %"), (0.999, "100 %"), (12.34, "1200 %"), (0.00123, "0.12 %")]
)
def test_a_share_in_percent_is_a_plain_number(share, said):
    assert in_percent(share) == said
    assert in_percent(-share) == f"-{said}"
