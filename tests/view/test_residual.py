"""The verdict on a residual: white, coloured, too short, or the daemon's own."""

import numpy as np

from teleop_rt.view import residual


def test_white_noise_behind_the_filter_is_white_and_a_left_over_spring_is_not():
    rng = np.random.default_rng(5)
    noise = np.convolve(rng.normal(0.0, 0.2, 20_000), np.full(8, 1 / 8), "same")
    white = residual.whiteness(noise, 1e-3, 60.0)
    assert white.white
    assert residual.verdict(white, 0.05, "N")["grade"] == "good"
    left = noise + 0.5 * np.sin(np.arange(noise.size) * 0.019)
    coloured = residual.whiteness(left, 1e-3, 60.0)
    assert not coloured.white
    reported = residual.verdict(coloured, 0.05, "N")
    assert reported["title"] == "model inadequate"
    assert "teleop-rt diagnose" in reported["text"]


def test_the_daemons_own_word_on_its_model_decides():
    white = residual.whiteness(np.random.default_rng(5).normal(0.0, 0.1, 20_000), 1e-3, 60.0)
    grades = [residual.verdict(white, 0.2, "N", said)["grade"] for said in (None, False, True)]
    assert grades == ["good", "good", "attention"]


def test_a_residual_that_is_too_short_is_not_judged():
    assert residual.whiteness(np.full(9, np.nan), 1e-3, 60.0) is None
    assert residual.verdict(None, 0.05, "N")["grade"] == "unknown"
    judged = residual.verdict(None, 0.05, "N", inadequate=False)  # by the daemon, on more of it
    assert (judged["grade"], judged["title"]) == ("good", residual.ADEQUATE)
    reported = residual.verdict(None, 0.05, "N", inadequate=True)
    assert (reported["grade"], reported["title"]) == ("attention", "model inadequate")
