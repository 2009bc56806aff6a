"""One report of a slave and a master that ran on two machines."""

import json
import shutil
from contextlib import closing

import numpy as np
import pytest

from teleop_rt.cli.reporting import rebuilt
from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.signals import MASTER, MASTER_TOPIC
from teleop_rt.view.joined import clock_ahead_ns, open_joined
from teleop_rt_dev.trial.closed_loop import run_into
from teleop_rt_dev.trial.files import SILICONE

pytest.importorskip("bokeh")

AHEAD_NS = 3.7e12
"""The master's machine was started an hour before the slave's."""


@pytest.fixture(scope="module")
def sides(tmp_path_factory):
    """Return the folders of one run as two machines would have written them."""
    whole = tmp_path_factory.mktemp("run") / "slave"
    summary = run_into(whole, "duration_s=6", file=SILICONE)
    counts = {key: summary[key] for key in ("safety", "missed_ticks", "late", "recorder")}
    there = whole.with_name("master")
    there.mkdir()
    shutil.copy(whole / "trial.yaml", there)
    rows = read_topics(whole / "recording.mcap", [MASTER_TOPIC])[MASTER_TOPIC]
    table = np.column_stack([rows[one.name] for one in MASTER])
    table[:, [one.name for one in MASTER].index("stamp_ns")] += AHEAD_NS
    with closing(RecordingWriter(there / "recording.mcap", Units(position="m", force="N"))) as made:
        made.add_topic(MASTER_TOPIC, MASTER)
        made.write_rows(MASTER_TOPIC, table)
    link = dict(summary["link"])
    of_master = {"link": link.pop("master"), "rendering": summary["master"]["rendering"]}
    common = {"trial": summary["trial"], "notes": []}
    for folder, side, own in (
        (whole, "slave", counts | {"link": link}), (there, "master", of_master),
    ):  # fmt: skip
        (folder / "summary.json").write_text(json.dumps({"side": side} | common | own))
    return whole, there


def test_both_sides_are_on_the_slaves_clock_within_the_jitter_of_the_link(sides):
    slave, master = sides
    run = open_joined([master, slave], rebuilt)
    whole = read_topics(slave / "recording.mcap", [MASTER_TOPIC])[MASTER_TOPIC]["stamp_ns"]
    assert np.max(np.abs(run.master["stamp_ns"] - whole)) < 3e6
    assert run.summary["link"]["master"]["received"] > 1000
    assert run.summary["master"]["rendering"]["state"]
    assert "recorded on two clocks, aligned here by" in run.summary["notes"][-1]


def test_the_report_of_both_folders_is_one_page_beside_the_slaves_recording(sides, call):
    slave, master = sides
    code, out, err = call("report", slave, master)
    assert (code, out.strip(), err) == (0, str(slave / "report.html"), "")
    page = (slave / "report.html").read_text()
    assert "rendered (master)" in page
    assert "recorded on two clocks" in page
    (slave / "report.html").unlink()


def test_folders_that_are_not_of_a_slave_and_a_master_are_refused(sides, call):
    slave, master = sides
    for folders in ((slave, slave), (master, master), (slave, master, slave)):
        code, _, err = call("report", *folders)
        assert code == 2
        assert "the folders that a slave and a master, each started alone, have written" in err
    assert "give the folder of the other one, too" in call("report", slave)[2]


def test_models_of_two_runs_or_none_align_no_clocks():
    ticks = np.arange(9000.0)
    sent = {"stamp_ns": 1e6 * ticks, "model_sequence": np.floor(ticks / 100.0)}
    taken = {"stamp_ns": 1e6 * ticks + AHEAD_NS, "model_sequence": np.floor(ticks / 100.0)}
    ahead_ns, models = clock_ahead_ns(sent, taken, 0.0)
    assert (ahead_ns, models) == (pytest.approx(AHEAD_NS, abs=1e6), 89)
    other = taken | {"model_sequence": np.floor(ticks / 103.0)}
    with pytest.raises(RecordingError, match="seem to be of two runs: the delays of their models"):
        clock_ahead_ns(sent, other, 150.0)
    for master, trip_ms in (({}, 150.0), (taken, None)):
        with pytest.raises(RecordingError, match="fewer than three models reached the master"):
            clock_ahead_ns(sent, master, trip_ms)
