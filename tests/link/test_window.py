from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from teleop_rt.link.messages import MessageError
from teleop_rt.link.session import REPLAY_WINDOW, ReplayWindow


@settings(deadline=None)  # the first call may compile
@given(st.lists(st.integers(1, 3 * REPLAY_WINDOW), max_size=300))
def test_the_replay_window_accepts_no_number_twice(numbers: list[int]) -> None:
    window, accepted = ReplayWindow(), set()
    for number in numbers:
        expected = number not in accepted and number > max(accepted, default=0) - REPLAY_WINDOW
        try:
            window.check(number)
        except MessageError:
            assert not expected
            continue
        assert expected
        window.add(number)
        accepted.add(number)
    assert window.count == len(accepted)
