"""Pairs of slow forces with the positions that they belong to."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teleop_rt.axis import Sample
from teleop_rt.estimation.pair_kernels import PAIR, take_sample
from teleop_rt.estimation.pairing import EvenPairing, Pairing, pairs_of
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.recorded import estimated_samples
from teleop_rt.estimation.rows import rows_for
from teleop_rt.kernels.jit import bound

MS = 1_000_000
LOOP_NS, PAIR_NS = 2 * MS, 12_500_000


def position_at(stamp_ns):
    return 0.02 + 0.15e-9 * stamp_ns


def curved_at(stamp_ns):
    """3 Hz and 8 mm: straight lines 2 ms long miss it by 1.5 um, longer ones by far more."""
    return 0.012 - 0.008 * np.cos(6e-9 * np.pi * (stamp_ns - 10**9))


def run(pairing, forces_ns, cycles=600, path=position_at):
    """Feed a straight motion, and each force at the first cycle after its stamp.

    Before the first one there is a force that is older than every position.
    """
    met = []
    for cycle in range(cycles):
        now_ns = 10**9 + cycle * LOOP_NS
        come = [stamp for stamp in forces_ns if stamp <= now_ns]
        arrived = come[-1] if come else 1
        if pairing.take(path(now_ns), now_ns, float(len(come)), arrived):
            met.append((pairing.position, pairing.force, pairing.stamp_ns, pairing.gap))
    return met


@given(
    lag_ms=st.floats(0.0, 40.0),
    jitter=st.lists(st.integers(-3 * MS, 3 * MS), min_size=40, max_size=40),
)
def test_each_force_meets_the_position_of_its_own_time_once(lag_ms, jitter):
    forces_ns = [10**9 + 60 * MS + n * PAIR_NS + jitter[n] for n in range(40)]
    met = run(Pairing(LOOP_NS, PAIR_NS, 1e-3 * lag_ms), forces_ns)
    assert [force for _, force, _, _ in met] == [float(n + 1) for n in range(40)]
    for (position, _, stamp_ns, gap), force_ns in zip(met, forces_ns, strict=True):
        assert stamp_ns == pytest.approx(force_ns - 1e6 * lag_ms, abs=1)
        assert position == pytest.approx(position_at(force_ns - 1e6 * lag_ms), abs=1e-9)
        assert gap == 0


@pytest.mark.parametrize("kind", [Pairing, EvenPairing])
def test_a_cycle_s_sample_is_taken_as_its_values_are_and_only_where_it_is_ready_and_valid(kind):
    by_values, by_sample = kind(LOOP_NS, PAIR_NS, 0.004), kind(LOOP_NS, PAIR_NS, 0.004)
    sample = Sample()
    take, met = bound(take_sample, (by_sample.of(sample.stored),), True), []  # noqa: FBT003
    for cycle in range(600):
        now_ns = 10**9 + cycle * LOOP_NS
        sample.position, sample.position_stamp_ns = curved_at(now_ns), now_ns
        sample.force, sample.force_stamp_ns = float(cycle % 7), now_ns - now_ns % PAIR_NS
        sample.valid, ready = cycle % 11 != 0, cycle % 13 != 0
        values = sample.position, now_ns, sample.force, sample.force_stamp_ns
        wanted = ready and sample.valid and by_values.take(*values)
        assert (take(ready) == PAIR) == wanted
        for name in ("position", "force", "gap", "stamp_ns"):
            assert getattr(by_sample, name) == getattr(by_values, name)
        met.append(wanted)
    assert 50 < sum(met) < 100


@pytest.mark.parametrize("kind", [Pairing, EvenPairing])
def test_a_pair_is_estimated_from_in_the_step_that_found_it_as_in_steps_of_their_own(kind):
    settings = PipelineSettings(
        period_s=1e-9 * PAIR_NS, position_resolution=5e-6, force_noise=0.05, onset_force=0.4,
        release_force=0.2, cutoff_hz=10.0,
    )  # fmt: skip
    at_once, in_steps = (Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), settings)
                         for _ in range(2))  # fmt: skip
    by_sample, by_values = kind(LOOP_NS, PAIR_NS, 0.004), kind(LOOP_NS, PAIR_NS, 0.004)
    sample, gaps = Sample(valid=True), 0
    take = at_once.pairs_at_once(by_sample.of(sample.stored))
    for cycle in range(6000):
        now_ns = 10**9 + cycle * LOOP_NS
        force_ns = now_ns - now_ns % PAIR_NS
        depth = max(0.0, curved_at(force_ns - 4 * MS) - 0.006)
        sample.position, sample.position_stamp_ns = curved_at(now_ns), now_ns
        sample.force, sample.force_stamp_ns = 3600.0 * depth, force_ns
        if ready := cycle % 500 > 20:
            values = sample.position, now_ns, sample.force, force_ns
            if by_values.take(*values):
                in_steps.skip(by_values.gap)
                in_steps.update(by_values.position, by_values.force, valid=True)
                gaps += by_values.gap
        take(ready)
        assert np.array_equal(at_once.theta, in_steps.theta)
    assert gaps > 10
    assert at_once.onsets == in_steps.onsets > 1
    assert at_once.theta.any()


def test_a_force_that_leads_waits_for_its_position():
    forces_ns = [10**9 + 60 * MS + n * PAIR_NS for n in range(20)]
    met = run(Pairing(LOOP_NS, PAIR_NS, -0.005), forces_ns, path=curved_at)
    assert len(met) == 20
    for (position, _, _, _), force_ns in zip(met, forces_ns, strict=True):
        assert position == pytest.approx(curved_at(force_ns + 5 * MS), abs=2e-6)


@pytest.mark.parametrize("share", [0.97, 1.0, 1.03])
def test_lost_values_are_counted_by_time_whatever_the_device_s_own_rate(share):
    period_ns = round(share * PAIR_NS)
    kept = [n for n in range(60) if n not in {20, 21, 40}]
    met = run(Pairing(LOOP_NS, PAIR_NS, 0.0), [10**9 + n * period_ns for n in kept])
    assert [gap for _, _, _, gap in met if gap] == [2, 1]


def test_a_held_force_is_no_new_one_and_an_old_position_is_not_taken_for_its_own():
    pairing = Pairing(LOOP_NS, PAIR_NS, 0.0)
    assert not pairing.take(1.0, 10**9, 5.0, 10**9 - 1)  # no position before it
    assert pairing.take(1.0, 10**9 + LOOP_NS, 6.0, 10**9 + MS)
    for cycle in range(2, 6):
        assert not pairing.take(1.0, 10**9 + cycle * LOOP_NS, 6.0, 10**9 + MS)


def test_a_recording_gives_the_pairs_that_the_run_had():
    forces_ns = np.array([10**9 + 60 * MS + n * PAIR_NS for n in range(40) if n != 17])
    now_ns = 10**9 + LOOP_NS * np.arange(400)
    index = np.searchsorted(forces_ns, now_ns, side="right") - 1
    valid = np.ones(400, dtype=bool)
    force_ns = np.where(index >= 0, forces_ns[np.maximum(index, 0)], 1)
    pairing = Pairing(LOOP_NS, PAIR_NS, 0.01)
    x, f, result, stamps = pairs_of(
        pairing, position_at(now_ns), now_ns, index.astype(float), force_ns, valid
    )
    live = run(Pairing(LOOP_NS, PAIR_NS, 0.01), forces_ns.tolist(), 400)
    assert np.count_nonzero(result) == len(live) == 39
    assert np.count_nonzero(~result) == 1
    assert x[result].tolist() == [one[0] for one in live]
    assert stamps[result].tolist() == [one[2] for one in live]
    assert np.all(np.diff(f[result]) == 1.0)


def test_a_lag_that_is_not_known_well_widens_damping_by_the_stiffness():
    def estimate(deviation_s):
        settings = PipelineSettings(
            period_s=1e-3, position_resolution=1e-6, force_noise=0.05, onset_force=0.4,
            release_force=0.2, surface=0.0, force_lag_deviation_s=deviation_s,
        )  # fmt: skip
        pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), settings)
        t = np.arange(4000) * 1e-3
        x = 0.01 - 0.008 * np.cos(6 * np.pi * t)
        v = 0.008 * 6 * np.pi * np.sin(6 * np.pi * t)
        force = 3600 * x + 20 * v + 0.05 * np.random.default_rng(1).standard_normal(t.size)
        pipeline.run(x, force, np.ones(t.size, dtype=bool))
        names, values, deviations = pipeline.estimate(0)
        return dict(zip(names, zip(values, deviations, strict=True), strict=True))

    known, vague = estimate(0.0), estimate(1e-4)
    assert vague["b"][0] == known["b"][0]
    assert vague["k"] == known["k"]
    assert vague["b"][1] == pytest.approx(np.hypot(known["b"][1], 3600 * 1e-4), rel=1e-3)
    assert known["b"][1] < 0.1


def test_two_clocks_as_fast_as_the_loop_give_even_pairs_of_the_same_times():
    """Frames come 0.4 or 1.6 periods apart, as where they straddle the loop's deadline."""
    period_ns, rng = 2_000_000, np.random.default_rng(3)
    even, plain = (kind(period_ns, period_ns, 1e-3) for kind in (EvenPairing, Pairing))
    spacing = {even: [], plain: []}
    for k in range(1, 400):
        now_ns = k * period_ns
        position_ns = now_ns - 1_800_000 + int(rng.integers(0, 200_000))
        force_ns = now_ns - (1_400_000 if k % 2 else 200_000)
        for pairing, stamps in spacing.items():
            taken = pairing.take(1e-9 * position_ns, position_ns, 1e-9 * (force_ns - 1e6), force_ns)
            if taken:
                stamps.append(pairing.stamp_ns)
                assert pairing.position == pytest.approx(pairing.force, abs=1e-9)
    assert set(np.diff(spacing[even])) == {period_ns}
    assert len(spacing[even]) > 390
    assert len(set(np.diff(spacing[plain]))) > 1


def test_even_pairs_count_what_a_stall_left_out():
    pairing = EvenPairing(2_000_000, 2_000_000, 0.0)
    gaps = []
    for k in [*range(1, 20), *range(40, 60)]:
        now_ns = k * 2_000_000
        if pairing.take(0.0, now_ns, 0.0, now_ns):
            gaps.append(pairing.gap)
    assert sum(gaps) in range(18, 23)


def test_two_forces_in_a_row_that_are_lost_are_a_gap_and_no_straight_line():
    pairing = EvenPairing(2_000_000, 2_000_000, 0.0)
    gaps = []
    for k in range(1, 40):
        now_ns, lost = k * 2_000_000, k in {20, 21}
        if not lost and pairing.take(0.0, now_ns, 0.0, now_ns):
            gaps.append(pairing.gap)
    assert sum(gaps) == 2


def test_a_recording_s_values_have_the_stamps_that_their_own_ages_give():
    """Position 2 ms old and force 5 ms: of each pair both are of one time."""
    now_ns = 10**9 + LOOP_NS * np.arange(200)
    position_ns, force_ns = now_ns - 2 * MS, now_ns - 5 * MS
    slave = {
        "stamp_ns": now_ns.astype(float),
        "position_age_ms": np.full(200, 2.0),
        "force_age_ms": np.full(200, 5.0),
        "position": position_at(position_ns),
        "force": position_at(force_ns),
        "valid": np.ones(200),
    }
    settings = PipelineSettings(
        period_s=2e-3, position_resolution=1e-6, force_noise=0.05, onset_force=0.4,
        release_force=0.2, paired_lag_s=0.0,
    )  # fmt: skip
    pairs = estimated_samples(slave, settings, LOOP_NS)
    assert np.count_nonzero(pairs.valid) > 190
    own = position_at(pairs.stamp_ns[pairs.valid])
    assert pairs.position[pairs.valid] == pytest.approx(own, abs=1e-9)
    assert pairs.force[pairs.valid] == pytest.approx(own, abs=1e-9)
