"""A side that runs in a process of its own, up to its loop."""

from __future__ import annotations

from contextlib import closing

import pytest

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.link.channel import Endpoint
from teleop_rt.link.keys import generate_key, load_own_key
from teleop_rt.link.transport import LinkError, UdpTransport
from teleop_rt.master.master import Master
from teleop_rt.realtime.scheduling import Privilege
from teleop_rt.trial import process_main
from teleop_rt.trial.side import Configs, Side
from teleop_rt_dev.paths import SILICONE

MOST_TICKS = 1000
REFUSED = Privilege("SCHED_FIFO", granted=False, reason="no", how_to_grant="ask")


@pytest.fixture
def run_master(tmp_path, monkeypatch):
    """Runs a master that is to end at once; returns its events."""

    def run() -> dict[str, object]:
        monkeypatch.setattr(process_main, "prepare_process", lambda _: [REFUSED])
        generate_key(tmp_path / "link.key")
        result: dict[str, object] = {}
        emit = lambda event, **content: result.update({event: content})  # noqa: E731 - of a side
        side = Side(load_trial_file(SILICONE, None), tmp_path, tmp_path, emit, None)
        key = load_own_key(tmp_path / "link.key")
        process_main.master_main(side, SILICONE.parent, key, lambda: True)
        return result

    return run


def test_a_master_reports_what_the_system_refused(run_master):
    assert run_master() == {"ready": {"privileges": ["SCHED_FIFO: refused (no); ask"]}}


@pytest.mark.parametrize("taker", [Endpoint, Master])
def test_a_master_takes_the_slave_s_packets_in_ahead_of_its_ticks(run_master, monkeypatch, taker):
    taken = []
    monkeypatch.setattr(taker, "take_ahead", lambda _: taken.append(True))

    def one_tick(clock, *_) -> None:
        for _ in range(MOST_TICKS):
            if not taken:  # a late tick leaves no time for it
                clock.wait_next_tick()

    monkeypatch.setattr(process_main, "run_loop", one_tick)
    run_master()
    assert len(taken) == 1


@pytest.mark.parametrize(
    ("alone", "step"),
    [
        (None, r"choose another link\.slave_port \(0 takes a free one\)"),
        (object(), r"give both sides another link\.slave_port"),
    ],
)
def test_only_a_slave_of_a_run_is_offered_port_0(tmp_path, alone, step):
    with closing(UdpTransport()) as taken:
        trial = load_trial_file(SILICONE, [f"link.slave_port={taken.port}"])
        side = Side(trial, tmp_path, tmp_path, print, alone)
        with pytest.raises(LinkError, match=rf"in use; {step} or an address of this machine"):
            process_main.slave_main(side, Configs(), None, None, lambda: True, arm=False)
