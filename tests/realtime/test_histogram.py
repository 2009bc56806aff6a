import numpy as np
import pytest

from teleop_rt.realtime.histogram import TimingHistograms


def test_a_reader_in_another_process_sees_quantiles_rounded_up_to_microseconds(tmp_path):
    written = TimingHistograms(tmp_path, create=True)
    assert written.quantiles("work") is None
    rng = np.random.default_rng(1)
    times = rng.gamma(4.0, 30.0, 20_000)
    for time in times:
        written.add(time, 2 * time)
    read = TimingHistograms(tmp_path)
    for kind, true in (("wake_latency", times), ("work", 2 * times)):
        found = read.quantiles(kind)
        for key, share in (("p50", 0.5), ("p99", 0.99), ("p999", 0.999), ("max", 1.0)):
            assert found[key] - 1 <= np.quantile(true, share, method="inverted_cdf") <= found[key]
    assert read.counts("work").sum() == 20_000


def test_the_longest_time_is_reported_as_it_was_also_beyond_the_last_bin(tmp_path):
    written = TimingHistograms(tmp_path, create=True)
    for latency_us in (3.0, 300_000.5, 20_000.0):
        written.add(latency_us, 0.2)
    assert written.quantiles("wake_latency") == dict.fromkeys(
        ("p50", "p99", "p999", "max"), 300_001
    )
    assert written.counts("wake_latency").sum() == 3
    assert written.quantiles("work")["max"] == 1
    with pytest.raises(FileExistsError):
        TimingHistograms(tmp_path, create=True)
