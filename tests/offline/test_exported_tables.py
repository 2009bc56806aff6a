"""A table that `export` wrote is read as the recording that it was made from."""

import math
from dataclasses import replace

import numpy as np
import pytest

from teleop_rt.errors import RecordingError
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.offline.load import load_any
from teleop_rt.offline.replay import Choice, online_of
from teleop_rt.offline.table import Table
from teleop_rt.realtime.export import export
from teleop_rt.realtime.reading import read_topics
from teleop_rt_dev.trial.closed_loop import run_into
from teleop_rt_dev.trial.files import SILICONE

AS_IT_IS = Table({}, {}, None)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "run"
    lag = ("rig.sensors.force_lag_ms=4.0", "rig.sensors.force_lag_deviation_ms=0.3")
    run_into(folder, "duration_s=3.0", *lag, file=SILICONE)
    return folder / "recording.mcap"


@pytest.mark.parametrize("suffix", ["csv", "npz", "mat"])
def test_samples_gaps_surface_and_the_forces_known_lag_are_carried_along(
    recording, tmp_path, suffix
):
    table = tmp_path / f"slave.{suffix}"
    export(recording, table, "/slave")
    read, own = load_any(table, AS_IT_IS), load_any(recording, AS_IT_IS)
    assert read.dt == pytest.approx(own.dt, rel=1e-9)
    assert (read.surface, read.units, read.missing) == (own.surface, own.units, own.missing)
    assert np.array_equal(read.mask, own.mask)
    assert read.position == pytest.approx(own.position, abs=1e-9)
    assert read.force == pytest.approx(own.force, abs=1e-6)
    (tmp_path / "slave.columns.yaml").unlink()
    late = load_any(table, AS_IT_IS).force
    assert np.max(np.abs(late[: own.force.size] - own.force)) > 0.1, "the lag is seen"


def test_deviations_contain_that_of_the_forces_lag_as_those_of_the_run(recording, tmp_path):
    table = tmp_path / "slave.csv"
    export(recording, table, "/slave")
    own = online_of(recording, Choice(), AS_IT_IS).settings.force_lag_deviation_s
    assert own >= 3e-4
    read = online_of(table, Choice(), AS_IT_IS).settings
    assert read.force_lag_deviation_s == pytest.approx(own, rel=1e-9)


def k_deviation(online):
    """Return the deviation of the stiffness that one estimator finds."""
    pipeline = Pipeline(online.rows, online.settings)
    pipeline.run(online.position, online.force, online.valid)
    names, _, deviations = pipeline.estimate(0)
    assert deviations is not None
    return float(deviations[names.index("k")])


def test_deviations_contain_that_of_the_surface_as_those_of_the_run(recording, tmp_path):
    """The surface of a table was known exactly: its k had 0.2 of the run's 1.0 N/m."""
    table = tmp_path / "slave.csv"
    export(recording, table, "/slave")
    recorded = read_topics(recording, ["/slave"])["/slave"]["surface_deviation"]
    own = recorded[np.isfinite(recorded)][-1]
    assert own > 1e-6
    choice = Choice(models=["kelvin-voigt"], regressions=["direct"], solvers=["rls"])
    read = online_of(table, choice, AS_IT_IS)
    assert read.settings.surface_deviation == pytest.approx(own, rel=1e-9)
    exact = replace(read, settings=replace(read.settings, surface_deviation=0.0))
    found, without = (k_deviation(one) for one in (read, exact))
    by_surface = math.sqrt(found**2 - without**2)
    assert by_surface == pytest.approx(300.0 * own / 1e-3, rel=0.5)
    stated = online_of(table, replace(choice, surface=0.0137), AS_IT_IS)
    assert stated.settings.surface_deviation == 0.0


def test_the_masters_table_is_read_without_naming_its_columns(recording, tmp_path):
    table = tmp_path / "master.csv"
    export(recording, table, "/master")
    read = load_any(table, AS_IT_IS)
    assert read.units == ("m", "N")
    assert np.ptp(read.force) > 1.0


def test_a_column_that_a_layout_names_and_the_table_lacks_is_reported(recording, tmp_path):
    table = tmp_path / "slave.csv"
    export(recording, table, "/slave")
    beside = tmp_path / "slave.columns.yaml"
    beside.write_text(beside.read_text().replace("valid: valid", "valid: sound"))
    with pytest.raises(RecordingError, match="no column 'sound'"):
        load_any(table, AS_IT_IS)
