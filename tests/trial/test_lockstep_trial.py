import hashlib
import io
import json
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import cases
from rich.console import Console

from teleop_rt.axis import AxisError
from teleop_rt.cli.wiring import open_bench
from teleop_rt.diagnosis.answers.notes import STEPS_OF_MOTION
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.samples.smoothing import moves_in_steps
from teleop_rt.offline.load import load_any
from teleop_rt.offline.table import Table
from teleop_rt.realtime.reading import read_topics
from teleop_rt.slave.faults import State
from teleop_rt.slave.slave import Slave
from teleop_rt.trial import summary as summary_module
from teleop_rt.trial.bench import Bench
from teleop_rt.trial.folder import RECORDING, write_trial
from teleop_rt.trial.lockstep_run import LockstepTrial, run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt.trial.table import print_summary
from teleop_rt_dev.trial.files import MEASURED_SPRING, SILICONE, load, silicone
from teleop_rt_drivers import opening
from teleop_rt_drivers.simulated.reference import environment_force


def silent(_seconds: float) -> None:
    """Show no progress."""


def run(trial, folder, open_bench=open_bench):
    folder.mkdir()
    write_trial(folder, trial)
    outcome = run_lockstep(trial, SILICONE, open_bench, folder, silent)
    return summarise(folder, trial, outcome, environment_force)


def estimator(summary, model, regression="direct", solver="rls"):
    (row,) = (
        row
        for row in summary["estimators"]
        if (row["model"], row["regression"], row["solver"]) == (model, regression, solver)
    )
    return row


@pytest.fixture(scope="module")
def default_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "default"
    return folder, run(silicone(), folder)


def test_the_chain_finds_surface_and_kelvin_voigt_within_the_stated_bounds(default_run):
    _, summary = default_run
    contact = summary["contact"]
    assert contact["surface_true"] == 0.0137
    assert abs(contact["surface_found"] - 0.0137) < 0.2e-3
    assert contact["onsets"] >= 4
    row = estimator(summary, "kelvin-voigt")
    assert row["parameters"]["k"]["value"] == pytest.approx(3600, rel=0.03)
    assert row["parameters"]["b"]["value"] == pytest.approx(20, rel=0.15)
    assert row["status"] == "estimated"
    assert row["nrmse"] < 0.01
    assert row["parameters"]["k"]["unit"] == "N/m"
    assert {row["model"] for row in summary["estimators"]} == {
        "kelvin-voigt",
        "mass-spring-damper",
        "hunt-crossley",
    }


def test_the_operator_feels_the_true_wall_without_lag_while_reflection_lags(default_run):
    _, summary = default_run
    assert summary["master"]["nrmse"] < 0.01
    assert abs(summary["master"]["lag_ms"]) <= 1.0
    assert summary["master"]["direct_reflection_lag_ms"] == pytest.approx(155, abs=10)
    assert summary["link"]["round_trip_ms"] == pytest.approx(150, abs=8)


def test_the_summary_holds_every_promised_key_and_no_number_that_json_lacks(default_run):
    _, summary = default_run
    assert set(summary) >= {
        "trial", "clock", "seed", "duration_s", "ticks", "missed_ticks", "wake_latency_us",
        "work_us", "contact", "estimators", "selected", "link", "master",
    }  # fmt: skip
    assert summary["wake_latency_us"] is None
    assert summary["work_us"] is None
    assert summary["ticks"] >= 20_000
    assert summary["missed_ticks"] == 0
    assert set(summary["link"]) >= {"sent", "received", "lost", "rejected", "round_trip_ms"}
    assert summary["link"]["lost"] > 0
    assert summary["selected"]["model"] in {"kelvin-voigt", "mass-spring-damper"}
    json.dumps(summary, allow_nan=False)


def test_the_recording_holds_every_tick_of_both_sides_and_replays_to_the_same_estimates(
    default_run,
):
    folder, summary = default_run
    topics = read_topics(
        folder / "recording.mcap",
        ["/slave", "/master", "/truth/plant", "/estimates/kelvin-voigt/direct/rls"],
    )
    for topic in ("/slave", "/master"):
        ticks = topics[topic]["tick"]
        assert np.array_equal(ticks, np.arange(1, ticks.size + 1))
    assert topics["/truth/plant"]["stamp_ns"].size >= 20_000
    online = topics["/estimates/kelvin-voigt/direct/rls"]
    replayed = estimator(summary, "kelvin-voigt")["parameters"]
    assert online["k"][-1] == replayed["k"]["value"]
    assert online["b"][-1] == replayed["b"]["value"]
    assert topics["/slave"]["surface"][-1] == summary["contact"]["surface_found"]


def test_what_was_measured_at_a_stamp_is_what_the_plant_did_at_that_stamp(default_run):
    folder, _ = default_run
    topics = read_topics(folder / "recording.mcap", ["/slave", "/truth/plant"])
    slave, truth = topics["/slave"], topics["/truth/plant"]
    _, at_slave, at_truth = np.intersect1d(
        slave["sample_stamp_ns"], truth["stamp_ns"], return_indices=True
    )
    assert at_slave.size > 19_000
    error = slave["position"][at_slave] - truth["position"][at_truth]
    assert np.abs(error).max() <= 2.5e-6 * (1 + 1e-6)


def test_a_run_behind_a_link_that_jitters_names_the_steps_of_its_motion(default_run):
    folder, summary = default_run
    recording = load_any(folder / RECORDING, Table({}, {}, None))
    assert moves_in_steps(recording.position, recording.force, recording.dt)
    assert STEPS_OF_MOTION in summary["notes"]
    assert not summary["adequacy"]["inadequate"]


README = Path(__file__).parents[2] / "README.md"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def test_the_readme_shows_what_the_default_trial_prints(default_run):
    """The same lines, and numbers within 2 %: the last digits are those of the processor."""
    _, summary = default_run
    printed = io.StringIO()
    print_summary(Console(file=printed, width=1000), summary, silicone().rig.units)
    shown = README.read_text().partition("it prints:\n\n```\n")[2].partition("\nfiles in")[0]
    lines = [line.rstrip() for line in printed.getvalue().splitlines()]
    for expected, line in zip(shown.splitlines(), lines, strict=True):
        wanted, cut, _ = expected.rstrip().partition("[...]")
        whole = line[: len(wanted)] if cut else line
        assert NUMBER.sub("#", whole) == NUMBER.sub("#", wanted)
        numbers = [[float(x) for x in NUMBER.findall(text)] for text in (whole, wanted)]
        assert numbers[0] == pytest.approx(numbers[1], rel=0.02, abs=1e-4), line


@pytest.mark.parametrize("seconds", [None, 1.64])
def test_the_time_to_the_first_tick_is_printed_where_the_clock_is_the_machines(
    default_run, seconds
):
    printed = io.StringIO()
    summary = default_run[1] | {"start_up_s": seconds}
    print_summary(Console(file=printed, width=200), summary, silicone().rig.units)
    found = re.findall(r"first tick +(.+?) *\n", printed.getvalue())
    assert found == ([] if seconds is None else ["1.6 s after the command"])


def test_the_slave_stays_under_its_force_cap(default_run):
    folder, _ = default_run
    slave = read_topics(folder / "recording.mcap", ["/slave"])["/slave"]
    assert slave["force"].max() < 90.0
    assert set(slave["state"]) <= {1.0, 2.0, 3.0, 4.0, 5.0}
    assert slave["state"][-1] == State.DISARMED


@pytest.mark.parametrize("seed", range(2))  # `scripts/campaign trial` plays twenty
def test_every_seed_finds_surface_stiffness_and_damping(tmp_path, seed):
    """After a second and a half in contact, of which half is the estimators' settling."""
    trial = silicone(f"seed={seed}", "duration_s=2.5")
    summary = run(trial, tmp_path / "run")
    assert abs(summary["contact"]["surface_found"] - 0.0137) < 0.2e-3
    parameters = estimator(summary, "kelvin-voigt")["parameters"]
    assert parameters["k"]["value"] == pytest.approx(3600, rel=0.02)
    assert parameters["b"]["value"] == pytest.approx(20, rel=0.05)


@pytest.mark.parametrize(("round_trip_ms", "duration_s"), cases((1000, 10.0), (0, 6.0)))
def test_felt_force_never_lags_whatever_the_delay(tmp_path, round_trip_ms, duration_s):
    trial = silicone(f"link.round_trip_ms={round_trip_ms}", f"duration_s={duration_s}")
    summary = run(trial, tmp_path / "run")
    assert abs(summary["master"]["lag_ms"]) <= 1.0
    assert summary["master"]["nrmse"] < 0.01
    reflection = summary["master"]["direct_reflection_lag_ms"]
    assert round_trip_ms <= reflection <= round_trip_ms + 15


def test_a_rendering_that_is_delayed_by_20_ticks_reads_20_ms(tmp_path, default_run):
    source, _ = default_run
    topics = read_topics(source / "recording.mcap", ["/slave", "/master"])
    master = dict(topics["/master"])
    master["rendered_force"] = np.roll(master["rendered_force"], 20)
    truth = json.loads((source / "truth.json").read_text())
    felt = summary_module.judge_felt_force(silicone(), {}, master, truth, environment_force)
    assert felt["lag_ms"] == pytest.approx(20.0, abs=0.1)


def test_a_force_that_hardly_moves_has_no_lag():
    """A hand at rest in tissue that is tracked had 344 ms: its force moved by 0.2 N."""
    trial, ticks = silicone(), np.arange(9000.0)
    noise = np.convolve(np.random.default_rng(1).normal(size=ticks.size), np.ones(200), "same")
    hand = 0.0237 + 3e-5 * noise / np.max(np.abs(noise))  # a motion that does not repeat itself
    master = {
        "stamp_ns": 1e6 * ticks,
        "tick": ticks,
        "position": hand,
        "velocity": np.gradient(hand, 1e-3),
        "offset": 0.0 * ticks,
        "contact_id": (ticks > 500).astype(float),
    }
    truth = {"environment": {"surface": 0.0137, "stiffness": 3600.0, "damping": 0.0}}
    force = lambda _, x, v, dt: 3600.0 * (x - 0.0137)  # noqa: E731 - one use
    moved = force(truth, hand, None, None)
    master |= {"rendered_force": np.roll(moved, 344), "reflected_force": np.roll(moved, 150)}
    felt = summary_module.judge_felt_force(trial, {}, master, truth, force)
    assert (felt["lag_ms"], felt["direct_reflection_lag_ms"]) == (None, None)
    assert felt["reason"] == (
        "the true force moved by less than contact.onset_force 0.4 N: it shows no lag"
    )
    assert felt["nrmse"] < 0.01
    hand[:] = 0.0237 + 20 * (hand - 0.0237)
    moved = force(truth, hand, None, None)
    master |= {"rendered_force": np.roll(moved, 20), "reflected_force": np.roll(moved, 150)}
    felt = summary_module.judge_felt_force(trial, {}, master, truth, force)
    assert felt["lag_ms"] == pytest.approx(20.0, abs=0.1)


def test_a_seed_gives_the_same_bytes_and_another_seed_others(tmp_path):
    digests = []
    for number, seed in enumerate((3, 3, 4)):
        folder = tmp_path / str(number)
        assert run(silicone(f"seed={seed}", "duration_s=1.2"), folder)["contact"]["onsets"] >= 1
        digests.append(hashlib.sha256((folder / "recording.mcap").read_bytes()).hexdigest())
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]


def test_nothing_but_the_plant_knows_the_plant(tmp_path):
    """A slave that never saw the plant's section does the very same."""
    trial = silicone("duration_s=1.5")
    assert run(trial, tmp_path / "given")["contact"]["onsets"] >= 1
    bench = lambda other, now_ns: open_bench(trial, now_ns)  # noqa: E731 - one use
    run(trial.model_copy(update={"plant": None}), tmp_path / "withheld", bench)
    given, withheld = (
        read_topics(tmp_path / name / "recording.mcap", ["/slave", "/master"])
        for name in ("given", "withheld")
    )
    for topic in ("/slave", "/master"):
        for name, values in given[topic].items():
            assert np.array_equal(values, withheld[topic][name], equal_nan=True), (topic, name)


def test_an_error_in_the_cycle_stops_the_axis_and_is_raised_again(tmp_path, monkeypatch):
    benches, act = [], Slave._act

    def failing(trial, now_ns):
        benches.append(open_bench(trial, now_ns))
        return benches[0]

    def breaking(slave, action):
        act(slave, action)
        if slave.tick == 501:
            raise ZeroDivisionError("broken on purpose")

    monkeypatch.setattr(Slave, "_act", breaking)

    with pytest.raises(ZeroDivisionError, match="on purpose"):
        run(silicone("duration_s=2.0"), tmp_path / "run", failing)
    slave = read_topics(tmp_path / "run" / "recording.mcap", ["/slave"])["/slave"]
    assert slave["state"][-1] in (State.RUN, State.HOLD)
    assert slave["tick"].size == 500
    truth = read_topics(tmp_path / "run" / "recording.mcap", ["/truth/plant"])
    assert truth["/truth/plant"]["stamp_ns"].size >= 499


def test_a_slave_that_starts_minutes_after_its_master_begins_without_what_has_waited(tmp_path):
    trial = LockstepTrial(silicone(), SILICONE.parent, open_bench, tmp_path)
    for _ in range(1200):
        trial.clock.move_to(trial.clock.now_ns() + 100_000_000)
        trial.master_endpoint.poll()
    trial.slave.configure()
    for _ in range(300):
        trial.clock.move_to(trial.clock.now_ns() + trial.trial.rig.period_ns)
        trial.slave.cycle()
        trial.master.cycle()
    assert trial.slave_endpoint.statistics.refused == 0
    assert trial.slave_endpoint.connected


class Raises:
    """An axis one of whose methods raises from its 200th call on."""

    def __init__(self, axis, method):
        self._axis, self._method, self._calls = axis, method, 0

    def __getattr__(self, name):
        if name == self._method:
            self._calls += 1
            if self._calls > 200:
                raise OSError(5, "bus gone")
        return getattr(self._axis, name)


@pytest.mark.parametrize("method", ["read_into", "write"])
def test_a_driver_that_raises_is_a_fault_with_its_traceback_in_the_log(method, tmp_path):
    def raising(trial, now_ns):
        bench = open_bench(trial, now_ns)
        bench.axis = Raises(bench.axis, method)
        return bench

    summary = run(silicone("duration_s=2"), tmp_path / "run", raising)
    assert summary["safety"]["state"] == "FAULT"
    fault = summary["safety"]["fault"]
    assert (fault["name"], fault["said"]) == ("driver", "OSError: [Errno 5] bus gone")
    lines = (tmp_path / "run" / "log.jsonl").read_text().splitlines()
    events = [json.loads(line) for line in lines]
    assert [event["fault"] for event in events if event["event"] == "fault"] == ["driver"]
    (report,) = [event for event in events if event["event"] == "device"]
    assert report["said"] == fault["said"]
    assert "in __getattr__" in report["traceback"]
    console = Console(file=io.StringIO(), width=200)
    print_summary(console, summary, silicone().rig.units)
    assert "FAULT, driver: OSError: [Errno 5] bus gone" in console.file.getvalue()


@pytest.mark.parametrize("wrong", [math.inf, -math.inf, math.nan])
def test_a_position_that_is_no_number_stops_and_is_a_missing_sample_to_readers(wrong, tmp_path):
    def spoiling(trial, now_ns):
        bench = open_bench(trial, now_ns)
        read_into, calls = bench.axis.read_into, []

        def spoilt(sample):
            read_into(sample)
            calls.append(0)
            if len(calls) > 1500:
                sample.position = wrong

        bench.axis.read_into = spoilt
        return bench

    folder = tmp_path / "run"
    summary = run(silicone("duration_s=3"), folder, spoiling)
    assert summary["safety"]["fault"]["name"] == "position_invalid"
    printed = io.StringIO()
    print_summary(Console(file=printed, width=1000), summary, silicone().rig.units)
    (ran,) = [line for line in printed.getvalue().splitlines() if " ran " in line]
    assert " of 3 s on the simulated clock" in ran
    assert ran.startswith("!")
    slave = read_topics(folder / RECORDING, ["/slave"])["/slave"]
    spoilt = ~np.isfinite(slave["position"])
    assert spoilt.any()
    assert not slave["valid"][spoilt].any()


def test_a_muted_sensor_holds_then_stops_within_the_stated_ticks(tmp_path):
    rigs = []

    def with_rig(trial, now_ns):
        axis, rig = opening.open_lock_step(trial.rig, trial.plant, now_ns, trial.seed)
        rigs.append(rig)
        return Bench(axis, rig.truth)

    hardware = silicone("rig.realtime.late={hold_ms: 5, stop_ms: 20, stop_share: 0.2}")
    trial = LockstepTrial(hardware, SILICONE.parent, with_rig, tmp_path)
    trial.slave.configure()
    while trial.slave.safety.state != State.RUN:
        trial.step()
    for _ in range(300):
        trial.step()
    rigs[0].inject("mute", "force sensor")
    states = []
    for _ in range(60):
        trial.step()
        states.append(trial.slave.safety.state)
    assert State.HOLD in states[:6]
    stopped = next(i for i, state in enumerate(states) if state >= State.SAFE_STOP)
    assert stopped <= 25
    assert trial.slave.safety.fault.name == "samples_lost"
    assert not rigs[0].drive.enabled


@pytest.mark.skipif("TELEOP_RT_DATA" not in os.environ, reason="TELEOP_RT_DATA is not set")
def test_the_measured_spring_runs_from_samples_to_rendered_torque(tmp_path):
    trial = load(MEASURED_SPRING)
    summary = run(trial, tmp_path / "run")
    assert summary["contact"]["surface_found"] is None
    assert "never leaves contact" in summary["contact"]["reason"]
    parameters = estimator(summary, "kelvin-voigt")["parameters"]
    assert parameters["k"]["unit"] == "Nm/rad"
    assert 2 < parameters["k"]["value"] < 5
    assert math.isfinite(parameters["offset"]["value"])
    assert parameters["b"]["std"] is not None
    assert parameters["b"]["identified"] is False
    topics = read_topics(tmp_path / "run" / "recording.mcap", ["/slave", "/master"])
    assert topics["/slave"]["tick"].size > 9_700
    assert np.ptp(topics["/master"]["rendered_force"]) > 0.05


def test_each_value_of_a_slave_s_row_stands_under_its_own_name(default_run):
    """The row is one list in the order of the table; neighbours of a kind are easily exchanged."""
    folder, _ = default_run
    rows = read_topics(folder / "recording.mcap", ["/slave"])["/slave"]
    assert np.all(np.diff(rows["tick"]) == 1)
    assert np.all(rows["sample_stamp_ns"] < rows["stamp_ns"])
    bends = [np.max(np.abs(np.diff(rows[name], 2))) for name in ("target", "command")]
    assert bends[1] < 60.1e-6 < bends[0]  # only the command is held to 60 m/s2
    assert rows["packets_received"][-1] > 10 * rows["packets_lost"][-1] > 0
    assert not np.any(rows["packets_rejected"])
    assert np.max(rows["followings"]) == 1
    assert not np.any(rows["holds"])
    assert set(rows["state"].tolist()) <= {float(state) for state in State}


def test_a_run_far_away_and_its_diagnosis_agree_that_nothing_is_missing(tmp_path):
    trial = silicone(
        "seed=12", "duration_s=8.0", "link={round_trip_ms: 400, jitter_ms: 20, loss: 0.05}"
    )
    agree_that_nothing_is_missing(tmp_path / "run", run(trial, tmp_path / "run"))


def test_the_default_run_and_its_diagnosis_agree_that_nothing_is_missing(default_run):
    agree_that_nothing_is_missing(*default_run)


def agree_that_nothing_is_missing(folder, summary):
    recording = load_any(folder / RECORDING, Table({}, {}, None))
    assert not summary["adequacy"]["raised"]
    answer = diagnose(recording).answer
    assert (answer["verdict"], answer["effects"]) == ("no_missing_effect", [])
    found = [[n for n in one["notes"] if "steps" in n] for one in (summary, answer)]
    assert found == [[STEPS_OF_MOTION], [STEPS_OF_MOTION]]


class RaisesAt:
    """The axis of a trial, with one method that raises once its work is done."""

    def __init__(self, axis, call):
        self._axis, self._call, self.heard = axis, call, []

    def __getattr__(self, name):
        method = getattr(self._axis, name)
        if name not in {"configure", "arm", "stop", "close"}:
            return method

        def called():
            method()
            self.heard.append(name)
            if name == self._call:
                raise AxisError(f"{name} failed; correct the driver")

        return called


@pytest.mark.parametrize("call", ["configure", "arm", "stop", "close"])
def test_a_driver_that_raises_between_ticks_leaves_nothing_open(tmp_path, call):
    axes = []

    def bench_of(trial, now_ns):
        bench = open_bench(trial, now_ns)
        axes.append(RaisesAt(bench.axis, call))
        return replace(bench, axis=axes[0])

    with pytest.raises(AxisError, match=f"{call} failed"):
        run_lockstep(load(SILICONE, "duration_s=0.3"), SILICONE, bench_of, tmp_path, silent)
    assert axes[0].heard[-2:] == ["stop", "close"]
    assert (tmp_path / "truth.json").is_file()
    if call in {"stop", "close"}:
        assert read_topics(tmp_path / RECORDING, ["/slave"])["/slave"]["tick"].size > 0


def test_a_touch_that_the_force_limit_ends_is_no_recording_without_contact(tmp_path):
    trial = silicone("plant.environment.stiffness_N_per_m=3.6e7")
    summary = run(trial, tmp_path / "run")
    assert summary["safety"]["fault"]["name"] == "force_limit"
    reason, brief = summary["contact"]["reason"], summary["contact"]["brief_touch_ms"]
    assert reason.startswith("the force rose to 260.3 N, and was above contact.onset_force 0.4 N")
    assert "begins after 3 ms (contact.onset_samples); force_limit stopped the run" in reason
    assert 1.0 <= brief < 3.0
    shown = io.StringIO()
    print_summary(Console(file=shown, width=400), summary, trial.rig.units)
    said = shown.getvalue()
    assert f"no contact, but a touch of {brief:g} ms" in said
    assert said.count(reason) == 1
    assert "by hand" not in said
    assert "raise limits.stiffness_max" in summary["safety"]["fault"]["next_step"]
    log = [json.loads(line) for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    (fault,) = (one for one in log if one["event"] == "fault")
    assert fault["next_step"] == summary["safety"]["fault"]["next_step"]
