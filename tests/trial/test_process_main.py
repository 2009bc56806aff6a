"""A side that runs in a process of its own, up to its loop."""

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.link.keys import generate_key, load_own_key
from teleop_rt.realtime.scheduling import Privilege
from teleop_rt.trial import process_main
from teleop_rt.trial.side import Side
from teleop_rt_dev.paths import SILICONE

REFUSED = Privilege("SCHED_FIFO", granted=False, reason="no", how_to_grant="ask")


def test_a_master_reports_what_the_system_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(process_main, "prepare_process", lambda _: [REFUSED])
    generate_key(tmp_path / "link.key")
    result = {}
    emit = lambda event, **content: result.update({event: content})  # noqa: E731 - of a side
    side = Side(load_trial_file(SILICONE, None), tmp_path, tmp_path, emit, None)
    key = load_own_key(tmp_path / "link.key")
    process_main.master_main(side, SILICONE.parent, key, lambda: True)
    assert result == {"ready": {"privileges": ["SCHED_FIFO: refused (no); ask"]}}
