import numpy as np
import pytest

from teleop_rt.realtime.histogram import BINS, TimingHistograms


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


def test_times_beyond_the_last_bin_are_counted_there(tmp_path):
    written = TimingHistograms(tmp_path, create=True)
    written.add(1e9, 0.2)
    assert written.quantiles("wake_latency")["max"] == BINS + 1
    assert written.quantiles("work")["max"] == 1
    with pytest.raises(FileExistsError):
        TimingHistograms(tmp_path, create=True)
