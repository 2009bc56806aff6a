"""The sweep runner: resuming, seeds, folders, Dask."""

import errno
import json
import os

import pytest

from teleop_rt.batch.sweep import CASES, finished, in_order, open_folder, sweep
from teleop_rt.batch.workers import ClusterError, Workers
from teleop_rt.outputs import OutputError
from teleop_rt.study import excitation

ONE = Workers(jobs=1)


def quiet(done, total):
    assert 0 <= done <= total


class Counted:
    """Squares, and remembers its arguments."""

    def __init__(self, fails_at=None):
        self.asked = []
        self.fails_at = fails_at

    def __call__(self, case):
        if case["x"] == self.fails_at:
            raise KeyboardInterrupt
        self.asked.append(case["x"])
        return {"square": case["x"] ** 2}


def cases(*xs):
    return [{"x": x, "seed": 10 + x} for x in xs]


def test_a_second_call_does_only_what_is_missing(tmp_path):
    first = Counted(fails_at=3)
    with pytest.raises(KeyboardInterrupt):
        sweep(tmp_path, first, cases(1, 2, 3, 4), ONE, quiet)
    assert first.asked == [1, 2]
    second = Counted()
    results = sweep(tmp_path, second, cases(4, 3, 2, 1), ONE, quiet)
    assert second.asked == [4, 3]
    assert [one["square"] for one in results] == [16, 9, 4, 1]


def test_a_line_cut_off_is_done_again_and_spoils_no_other(tmp_path):
    sweep(tmp_path, Counted(), cases(1, 2), ONE, quiet)
    path = tmp_path / CASES
    path.write_bytes(path.read_bytes()[:-9])
    again = Counted()
    assert [r["square"] for r in sweep(tmp_path, again, cases(1, 2, 3), ONE, quiet)] == [1, 4, 9]
    assert again.asked == [2, 3]
    assert len(finished(path)) == 3


def test_a_full_disk_loses_no_result_that_is_there(tmp_path, monkeypatch):
    def no_room(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("teleop_rt.batch.sweep._append", no_room)
    results = in_order(tmp_path / CASES, Counted(), cases(3, 4), ONE, quiet)
    assert next(results) == {"square": 9}
    with pytest.raises(OSError, match=f"No space left on device: '{tmp_path / CASES}'"):
        next(results)


def test_another_seed_is_another_case_and_seeds_are_recorded(tmp_path):
    sweep(tmp_path, Counted(), [{"x": 1, "seed": 1}], ONE, quiet)
    counted = Counted()
    sweep(tmp_path, counted, [{"x": 1, "seed": 2}], ONE, quiet)
    assert counted.asked == [1]
    lines = [json.loads(line) for line in (tmp_path / CASES).read_text().splitlines()]
    assert [line["case"]["seed"] for line in lines] == [1, 2]


def test_progress_reports_what_was_done_before(tmp_path):
    sweep(tmp_path, Counted(), cases(1, 2), ONE, quiet)
    reported = []
    sweep(tmp_path, Counted(), cases(1, 2, 3), ONE, lambda *one: reported.append(one))
    assert reported == [(2, 3), (3, 3)]


def test_results_that_are_no_numbers_become_null(tmp_path):
    (result,) = sweep(tmp_path, lambda _case: {"y": float("nan")}, cases(1), ONE, quiet)
    assert result == {"y": None}


def test_a_folder_of_something_else_is_refused(tmp_path):
    open_folder(tmp_path / "a", "noise")
    assert open_folder(tmp_path / "a", "noise") == tmp_path / "a"
    with pytest.raises(OutputError, match="name another folder"):
        open_folder(tmp_path / "a", "excitation")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "letter.txt").write_text("dear")
    with pytest.raises(OutputError, match="name another folder"):
        open_folder(tmp_path / "b", "noise")


def some_cases():
    return excitation.cases((0.005,), (0.001,), (3.0,), duration_s=1.0)


def test_cores_give_the_same_answers_as_one(tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    alone = sweep(tmp_path / "one", excitation.evaluate, some_cases(), ONE, quiet)
    both = sweep(tmp_path / "two", excitation.evaluate, some_cases(), Workers(jobs=2), quiet)
    assert alone == both


def test_a_dask_cluster_of_two_workers_gives_the_same_answers(tmp_path):
    distributed = pytest.importorskip("distributed")
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    alone = sweep(tmp_path / "one", excitation.evaluate, some_cases(), ONE, quiet)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, host="127.0.0.1", protocol="tcp://",
        dashboard_address=None,
    ) as cluster:  # fmt: skip
        workers = Workers(scheduler=cluster.scheduler_address)
        assert sweep(tmp_path / "two", excitation.evaluate, some_cases(), workers, quiet) == alone
        assert len(cluster.scheduler.workers) == 2


def test_a_scheduler_that_does_not_answer_is_named(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("teleop_rt.batch.workers.CONNECT_S", 0.2)
    workers = Workers(scheduler="tcp://127.0.0.1:9")
    with pytest.raises(ClusterError, match="no Dask scheduler answers at tcp"):
        sweep(tmp_path, excitation.evaluate, some_cases(), workers, quiet)


def test_the_command_says_which_scheduler_does_not_answer(call, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("teleop_rt.batch.workers.CONNECT_S", 0.2)
    code, out, err = call("study", "excitation", "--out", tmp_path / "out",
                          "--scheduler", "tcp://127.0.0.1:9")  # fmt: skip
    assert code == 2
    assert out == ""
    assert "no Dask scheduler answers" in err
