"""Values of curves as a page holds them."""

from __future__ import annotations

import numpy as np

from teleop_rt.view.glyphs import as_page_values


def test_a_deviation_beyond_the_numbers_of_a_page_is_infinite() -> None:
    sent = as_page_values(np.array([1.5, 1e39, -1e300]))
    assert sent.dtype == np.float32
    assert sent.tolist() == [1.5, np.inf, -np.inf]
