"""A model that the residual rejects is reported as such: no deviations, and the way to diagnose."""

import numpy as np
import pytest

import teleop_rt
from teleop_rt.offline.replay import REJECTED


def pressed(friction, seed=1):
    """Return time, position and force of a spring and damper that the tool never leaves."""
    t = np.arange(0.0, 10.0, 1e-3)
    x = 0.02 + 0.008 * np.sin(2 * np.pi * 1.3 * t) + 0.003 * np.sin(2 * np.pi * 3.1 * t)
    v = np.gradient(x, t)
    force = 1500.0 * x + 20.0 * v + friction * np.tanh(v / 1e-3)
    noise = 0.05 * np.random.default_rng(seed).standard_normal(t.size)
    return t, 5e-6 * np.round(x / 5e-6), force + noise


def identified(friction, seed=1):
    recording = teleop_rt.from_arrays(*pressed(friction, seed))
    return teleop_rt.identify(recording, "kelvin-voigt", regressions="direct", solvers="rls")


@pytest.mark.parametrize("friction", [0.1, 0.5, 2.0])
def test_undeclared_friction_leaves_no_deviations_and_is_referred_to_diagnosis(friction):
    found = identified(friction)
    assert found.note == REJECTED
    assert REJECTED.split(":")[0] in repr(found)  # the advice is in the note alone
    assert [one.std for one in found.estimates[0].parameters.values()] == [None] * 3


@pytest.mark.parametrize("seed", range(1, 9))
def test_a_true_model_keeps_its_deviations(seed):
    found = identified(0.0, seed)
    assert found.note == ""
    k, b = (found.estimates[0].parameters[name] for name in "kb")
    assert abs(k.value - 1500.0) < 4.0 * k.std
    assert abs(b.value - 20.0) < 4.0 * b.std


def test_replay_prints_the_note_and_no_deviation(call, tmp_path):
    for friction in (0.0, 1.0):
        file = tmp_path / f"friction_{friction:.0f}.csv"
        np.savetxt(file, np.transpose(pressed(friction)), delimiter=",",
                   header="t_s,position_m,force_N", comments="")  # fmt: skip
        code, out, _ = call("replay", file, "--models", "kelvin-voigt", "--solvers", "rls",
                            "--regressions", "direct")  # fmt: skip
        assert code == 0
        assert (f"note: {REJECTED}" in out) is (friction > 0.0)
        assert ("±" in out) is (friction == 0.0)
