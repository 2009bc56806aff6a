"""When a model is sent: when the hand would feel the difference, and to keep alive."""

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from teleop_rt.config.link import LinkConfig
from teleop_rt.contact.effect import Vector
from teleop_rt.estimation import walls
from teleop_rt.estimation.rows import KELVIN_VOIGT, UNILATERAL
from teleop_rt.link.codec import decode
from teleop_rt.link.messages import Kind
from teleop_rt.slave.model_sender import ModelSender
from teleop_rt.slave.record import TickRecord

NOISE, KEEP_ALIVE_MS, MS = 0.05, 100.0, 1_000_000
DEPTHS = (0.004, 0.012)
"""Between them the window presses to and fro: 12 mm of 1000 N/m are 12 N, the range 8 N."""


class Bench:
    """A sender beside a model that the test sets, and all that it sent."""

    def __init__(self, k: float = 1000.0, **link: object) -> None:
        self.now_ms = 0
        self.sent: list[tuple[int, float]] = []
        self.k, self.code = k, KELVIN_VOIGT
        self.surface = self.surface_velocity = self.moving_m_per_s = 0.0
        self.force_std, self.effects = NOISE, ()
        record = TickRecord()
        record.tick.in_contact = record.tick.contact_id = record.tick.surface_known = 1
        self.endpoint = SimpleNamespace(connected=True, send_body=self.take)
        self.sender = ModelSender(
            self, self.endpoint, NOISE, 90.0, LinkConfig(keep_alive_ms=KEEP_ALIVE_MS, **link),
            lambda: self.now_ms * MS, record,
        )  # fmt: skip

    def take(self, kind: Kind, body: memoryview) -> None:
        self.sent.append((self.now_ms, decode(kind, bytes(body)).k))

    def write_effects(self, out: Vector, column: int) -> None:
        """There are none."""

    def wall_writer(self, out: Vector) -> Callable[[], bool]:
        def write() -> bool:
            out[walls.MODEL], out[walls.K], out[walls.N] = self.code, self.k, 1.0
            out[walls.SURFACE], out[walls.SURFACE_VELOCITY] = self.surface, self.surface_velocity
            out[walls.FORCE_STD] = self.force_std
            return True

        return write

    def run(self, count_ms: int) -> list[tuple[int, float]]:
        """Run so long; return the values sent meanwhile."""
        self.sent.clear()
        for _ in range(count_ms):
            self.now_ms += 1
            self.surface += 1e-3 * self.moving_m_per_s
            self.sender.update(DEPTHS[self.now_ms // 50 % 2])
        return list(self.sent)


@pytest.fixture
def steady():
    bench = Bench()
    bench.run(500)
    return bench


def test_in_steady_contact_a_model_goes_out_at_the_keep_alive_rate_alone(steady):
    sent = steady.run(1000)
    assert len(sent) == 10
    assert {k for _, k in sent} == {1000.0}


def test_a_change_below_the_bar_waits_for_the_keep_alive_which_carries_the_latest(steady):
    """The bar is max(2 sigma_f, 2 % of the range) = max(0.1, 0.16) N: 13 N/m at 12 mm."""
    last = steady.run(100)[-1][0]
    steady.k = 1000.0 + 0.9 * 0.16 / 0.012
    sent = steady.run(100)
    assert [k for _, k in sent] == [steady.k]
    assert sent[0][0] - last == KEEP_ALIVE_MS


def test_a_change_that_would_be_felt_goes_out_at_once(steady):
    changed_ms = steady.now_ms
    steady.k = 1000.0 + 1.2 * 0.16 / 0.012
    at_ms, k = steady.run(20)[0]
    assert (at_ms - changed_ms <= 10, k) == (True, steady.k)


def test_another_model_of_the_same_force_goes_out_at_once(steady):
    changed_ms, steady.code = steady.now_ms, UNILATERAL
    assert steady.run(20)[0][0] - changed_ms <= 10


def test_with_little_force_the_noise_is_the_bar():
    """100 N/m span 0.8 N, 2 % of which is less than twice the noise: the bar is 0.1 N."""
    bench = Bench(k=100.0)
    bench.run(500)
    bench.k = 100.0 + 0.9 * 0.1 / 0.012
    assert len(bench.run(60)) <= 1
    bench.k = 100.0 + 2.2 * 0.1 / 0.012
    assert len(bench.run(20)) >= 1


def test_without_a_session_nothing_is_counted_as_sent(steady):
    before = steady.sender.models_sent
    steady.endpoint.connected = False
    assert steady.run(300) == []
    assert steady.sender.models_sent == before


def test_a_surface_that_moves_as_predicted_is_not_sent_again(steady):
    """0.5 mm of 1000 N/m in 100 ms are three times the bar of 2 % of 8 N."""
    steady.moving_m_per_s = steady.surface_velocity = 0.005
    steady.run(2 * round(KEEP_ALIVE_MS))
    assert len(steady.run(10 * round(KEEP_ALIVE_MS))) <= 11, "kept alive"
    steady.moving_m_per_s = 0.0
    assert len(steady.run(10 * round(KEEP_ALIVE_MS))) >= 20, "it stopped, and is still said to move"
