from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from teleop_rt.cli.wiring import load_trial_file, load_trial_for_run
from teleop_rt.config.loader import dump, load_rig, load_trial
from teleop_rt.config.rig import AxisConfig
from teleop_rt.config.section import Force, Units
from teleop_rt.config.trial import PlantConfig
from teleop_rt.config.yaml_file import ConfigError, parse_scalar
from teleop_rt_dev.paths import SILICONE, TRIALS


class BenchAxis(AxisConfig):
    port: str


class BenchPlant(PlantConfig):
    preload: Force = 0.0


AXES = {"bench": BenchAxis, "plain": AxisConfig}
PLANTS = {"bench": BenchPlant}

RIG = """\
name: bench
units: {position: m, force: N}
rate_hz: 1000
sensors: {position_resolution_m: 5.0e-6, force_noise_N: 0.05}
limits:
  position_min_m: -0.05
  position_max_m: 0.05
  velocity_max_m_per_s: 1
  acceleration_max_m_per_s2: 50
  force_max_N: 120
axis: {driver: bench, port: a}
unsafe_i_know: [watchdog, force_comparison, position_comparison]
"""
TRIAL = """\
name: press
rig: rig.yaml
duration_s: 5
operator:
  kind: profile
  approach_speed_m_per_s: 0.04
  mean_m: 0.012
  amplitude_m: 0.008
  frequency_hz: 3
  felt_force_N: 0.5
  lift_off_height_m: 0.005
contact: {onset_force_N: 0.4, release_force_N: 0.2}
slave: {force_cap_N: 90, retreat_speed_m_per_s: 0.1}
master:
  force_max_N: 100
  force_step_N: 0.5
  device_damping_N_s_per_m: 5
  offset_speed_m_per_s: 0.02
plant: {preload_N: 1e-1}
"""


def write(folder: Path, trial: str = TRIAL, rig: str = RIG) -> Path:
    (folder / "rig.yaml").write_text(rig)
    (folder / "trial.yaml").write_text(trial)
    return folder / "trial.yaml"


def problems_of(folder: Path, trial: str = TRIAL, rig: str = RIG, overrides=()) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load_trial(write(folder, trial, rig), AXES, PLANTS, overrides)
    return [str(problem).replace(f"{folder}/", "") for problem in caught.value.problems]


def test_a_rig_of_an_override_is_found_from_where_one_is(tmp_path, monkeypatch):
    trial = write(tmp_path)
    here = tmp_path / "here"
    here.mkdir()
    (here / "own.yaml").write_text(RIG.replace("name: bench", "name: own"))
    monkeypatch.chdir(here)
    assert load_trial(trial, AXES, PLANTS, ["rig=own.yaml"]).rig.name == "own"
    assert load_trial(trial, AXES, PLANTS, ["rig=rig.yaml"]).rig.name == "bench"
    (here / "rig.yaml").write_text(RIG)
    assert load_trial(trial, AXES, PLANTS).rig.name == "bench", "the trial's own means its folder"
    (found,) = problems_of(tmp_path, overrides=["rig=rig.yaml"])
    both = "rig: both rig.yaml and here/rig.yaml: give the whole path of one"
    assert found == f"--set rig=rig.yaml: {both}"
    (found,) = problems_of(tmp_path, overrides=["rig=none.yaml"])
    assert "relative to the trial file, or to the folder where you are" in found


def test_a_recording_of_an_override_is_found_from_where_one_is(tmp_path, monkeypatch):
    trial = write(tmp_path)
    here = tmp_path / "here"
    here.mkdir()
    (here / "hand.csv").write_text("t_s,x\n")
    monkeypatch.chdir(here)
    by_section = "operator={kind: recorded, file: hand.csv, position_column: x}"
    assert load_trial(trial, AXES, PLANTS, [by_section]).operator.file == str(here / "hand.csv")
    by_key = ["operator={kind: recorded, position_column: x}", "operator.file=hand.csv"]
    assert load_trial(trial, AXES, PLANTS, by_key).operator.file == str(here / "hand.csv")
    (tmp_path / "hand.csv").write_text("t_s,x\n")
    (found,) = problems_of(tmp_path, overrides=[by_section])
    assert "operator.file: both hand.csv and here/hand.csv: give the whole path of one" in found


def test_a_scale_below_0_is_refused_with_the_sign_to_write():
    below = "rig.axis.position.scale_m_per_unit=-0.5e-6"
    with pytest.raises(ConfigError, match="for the other direction write sign: -1 beside 5e-07"):
        load_trial_file(SILICONE, ["rig=simulated_serial", below])


def test_a_kind_of_an_override_is_reported_as_the_override(tmp_path):
    (found,) = problems_of(tmp_path, overrides=["operator.kind=dog"])
    assert found.startswith("--set operator.kind=dog: operator: kind: there is no 'dog'")


def test_a_trial_is_loaded_with_its_rig_and_driver_sections(tmp_path):
    trial = load_trial(write(tmp_path), AXES, PLANTS)
    assert trial.rig.limits.position_max == 0.05
    assert isinstance(trial.rig.axis, BenchAxis)
    assert isinstance(trial.plant, BenchPlant)
    assert trial.plant.preload == 0.1
    assert trial.rig.period_ns == 1_000_000


def test_all_problems_of_both_files_are_reported_at_once_with_file_line_and_key(tmp_path):
    found = problems_of(
        tmp_path,
        trial=TRIAL.replace("frequency_hz: 3", "frequency_hz: 80")
        .replace("duration_s: 5", "duration_s: -1")
        .replace("preload_N: 1e-1", "preload_m: 1"),
        rig=RIG.replace("force_max_N: 120", "force_max_N: -3").replace("port: a", "prot: a"),
    )
    text = "\n".join(found)
    assert "trial.yaml:3: duration_s: must be greater than or equal to 0.01 (it is -1)" in text
    assert "trial.yaml:9: operator.frequency_hz: must be less than or equal to 50" in text
    assert "rig.yaml:10: rig.limits.force_max_N: must be greater than 0" in text
    assert "rig.yaml:11: rig.axis.prot: unknown key; did you mean 'port'?" in text
    assert "plant.preload_m: unknown key; did you mean 'preload_N'?" in text
    assert len(found) == 5


def test_a_required_key_that_is_misspelt_is_reported_once(tmp_path):
    for wrong in ("duration", "durations_s"):
        [found] = problems_of(tmp_path, trial=TRIAL.replace("duration_s", wrong))
        assert found == f"trial.yaml:3: {wrong}: unknown key; did you mean 'duration_s'?"
    missing, unknown = problems_of(tmp_path, trial=TRIAL.replace("duration_s", "xyz"))
    assert missing.endswith("duration_s: is required and missing")
    assert "xyz: unknown key" in unknown


def test_units_that_are_none_are_the_only_problem_reported(tmp_path):
    [found] = problems_of(tmp_path, overrides=["rig.units=metres"])
    assert found.startswith("--set rig.units=metres: rig.units: must be a section")


def test_a_value_where_a_section_is_needed_is_refused_with_the_keys_of_the_section(tmp_path):
    [found] = problems_of(tmp_path, overrides=["contact=soft"])
    assert "contact: must be a section, with keys of " in found
    assert "onset_force_N" in found


def test_a_key_without_its_unit_is_reported_the_key_to_write(tmp_path):
    found = problems_of(tmp_path, rig=RIG.replace("position_max_m:", "position_max:"))
    assert found == [
        "rig.yaml:7: rig.limits.position_max: the key lacks its unit: write position_max_m"
    ]


def test_a_unit_of_the_other_kind_of_rig_is_refused(tmp_path):
    found = problems_of(tmp_path, rig=RIG.replace("force_max_N:", "force_max_Nm:"))
    problem = "unknown key; did you mean 'force_max_N'? Its value is in N: convert it"
    assert f"rig.yaml:10: rig.limits.force_max_Nm: {problem}" in found


@pytest.mark.parametrize(
    ("given", "hint"),
    [
        ("mean_mm: 5", "did you mean 'mean_m'? Its value is in m: convert it"),
        ("maen_m: 5", "did you mean 'mean_m'?"),
    ],
)
def test_a_key_in_another_unit_is_refused_with_the_unit_of_its_value(tmp_path, given, hint):
    found = problems_of(tmp_path, trial=TRIAL.replace("mean_m: 0.012", given))
    assert any(problem.endswith(hint) for problem in found), found


def test_an_override_below_a_section_of_no_file_is_reported_as_the_override(tmp_path):
    (found,) = problems_of(tmp_path, overrides=["foo.bar=1"])
    assert found.startswith("--set foo.bar=1: foo: unknown key")


def test_an_override_without_its_unit_says_nothing_of_the_right_key_in_the_file(tmp_path):
    for override in ("slave.force_cap=90", "rig.limits.force_max=90"):
        [found] = problems_of(tmp_path, overrides=[override])
        assert "the key lacks its unit" in found
        assert found.startswith(f"--set {override}")


def test_a_decimal_comma_is_refused_with_the_point_that_is_meant(tmp_path):
    found = problems_of(tmp_path, overrides=["duration_s=20,5"])
    assert found[0].endswith("must be a number (it is '20,5'): use a point for decimals, 20.5")


def test_a_number_with_its_unit_is_refused_with_what_to_write(tmp_path):
    found = problems_of(tmp_path, overrides=["duration_s=20 s"])
    assert found[0].endswith("(it is '20 s'): write the number alone, without its unit")


def test_a_name_that_is_nearly_right_is_refused_with_the_one_that_is_meant(tmp_path):
    found = problems_of(tmp_path, overrides=["estimation.models=[kelvin-voigd]"])
    assert found[0].endswith("(it is 'kelvin-voigd'): did you mean 'kelvin-voigt'?")


KINDS = "must be a section with the key kind, one of: profile, recorded, hand, device"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("estimation.models=[]", "must have at least 1 item (it is [])"),
        ("link.accepted_rates_hz=[1,2,3]", "must have at most 2 items (it is [1, 2, 3])"),
        ("name=", "must be text (it is empty)"),
        ("name=a/b", "must consist of letters, digits, _ and - alone (it is 'a/b')"),
        ("rig.name=''", "must not be empty: write at least 1 character"),
        ("rig.realtime.awake=3", "must be true or false (it is 3)"),
        ("operator.mean_m=[1,2]", "must be a number (it is [1, 2])"),
        ("operator=3", f"{KINDS} (it is 3)"),
    ],
)
def test_a_value_of_another_form_is_refused_in_plain_words(tmp_path, override, message):
    [found] = problems_of(tmp_path, overrides=[override])
    assert found == f"--set {override}: {override.partition('=')[0]}: {message}"


def test_a_file_of_another_kind_is_named_for_what_it_is(tmp_path):
    [rig] = problems_of(tmp_path, trial=RIG)
    assert "trial.yaml: is a rig: name a trial, whose key `rig` names this file" in rig
    for text, kind in (("t_s,x\n0,1\n", "text"), ("- 1\n- 2\n", "a list"), ("", "nothing")):
        [found] = problems_of(tmp_path, trial=text)
        assert f"must contain keys and values (it contains {kind}): name a trial or rig" in found


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e3", 1000.0),
        ("1.5E-2", 0.015),
        ("on", "on"),
        ("yes", "yes"),
        ("12:30", "12:30"),
        ("0o17", "0o17"),
        ("0x1A", 26),
        ("010", 10),
        ("true", True),
        ("~", None),
        ("2026-11-21", "2026-11-21"),
    ],
)
def test_scalars_are_read_as_people_mean_them(text, value):
    assert parse_scalar(text) == value
    assert type(parse_scalar(text)) is type(value)


def test_text_is_no_number(tmp_path):
    found = problems_of(tmp_path, trial=TRIAL.replace("duration_s: 5", "duration_s: 12:30"))
    assert found == ["trial.yaml:3: duration_s: must be a number (it is '12:30')"]


def test_a_key_given_twice_is_an_error(tmp_path):
    found = problems_of(tmp_path, trial=TRIAL + "name: again\n")
    assert found == ["trial.yaml:20: key 'name' is given twice: keep one"]


def test_a_tag_is_refused_with_its_line(tmp_path):
    found = problems_of(tmp_path, trial=TRIAL.replace("name: press", "name: !press {a: 1}"))
    assert found == ["trial.yaml:1: the tag !press is not understood: remove it"]


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("operator.mean_m=5", "5.008 m of penetration, and rig.limits leave a range of 0.1"),
        ("operator.start_m=0.2", "start 0.2 m is outside of rig.limits -0.05 to 0.05 m: set"),
        ("contact.onset_force_N=95", "onset_force_N: 95.0 is not below slave.force_cap_N 90"),
        ("rig.sensors.force_noise_N=1", "noise would be taken for contact"),
        ("rig.rate_hz=100", "cutoff_hz: 60 is not below a third of rig.rate_hz 100"),
        (
            "slave.force_cap_N=500",
            "slave.force_cap_N: 500.0 is above rig.limits.force_max_N 120.0",
        ),
        ("slave.retreat_after_ms=20", "retreat_after_ms must not be below hold_after_ms"),
        ("master.freeze_after_ms=3000", "declutch_after_ms must be above freeze_after_ms"),
    ],
)
def test_values_that_cannot_go_together_are_refused(tmp_path, override, message):
    [found] = problems_of(tmp_path, overrides=[override])
    assert found.startswith(f"--set {override}")
    assert message in found
    assert "(it is" not in found


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "estimation.models=[kelvin-voigt,hunt-crossley,kelvin-voigt]",
            "kelvin-voigt is listed twice: list each once",
        ),
        ("estimation.solvers=[rls,rls]", "rls is listed twice"),
        ("estimation.regressions=[direct,direct]", "direct is listed twice"),
        ("rig.unsafe_i_know=[watchdog,watchdog]", "watchdog is listed twice: list each once"),
        ("rig.placeholders=[axis.port,axis.port]", "axis.port is listed twice"),
        ("link.host=999.1.1.1", "999.1.1.1 is no IPv4 address"),
        ("link.bind_host=10.0.1", "10.0.1 is no IPv4 address"),
        ("link.host=::1", "::1 is an IPv6 address or has a port, and the link uses IPv4 alone"),
        ("link.bind_host='::'", "and the link uses IPv4 alone: give the IPv4 address"),
        ("link.host=slave:9000", "ports as slave_port and master_port"),
        ("link.host=a b", "'a b' is no name of a machine: give its name of letters, digits"),
        ("link.host=''", "'' is no name of a machine"),
        ("link.bind_host=a..b", "'a..b' is no name of a machine"),
        ("link.host=224.0.0.1", "224.0.0.1 is the address of many machines: give that of one"),
        ("link.host=0.0.0.0", "0.0.0.0 is to listen on (bind_host)"),
        ("link.blackouts_s=[[1,2],[3,3]]", "[3, 3] does not end after its start"),
    ],
)
def test_a_name_listed_twice_and_what_is_no_address_or_interval_are_refused(
    tmp_path, override, message
):
    [found] = problems_of(tmp_path, overrides=[override])
    assert found.startswith(f"--set {override}")
    assert message in found


@pytest.mark.parametrize("host", ["localhost", "rig-4.lab.example.", "slave_1", "192.168.1.7"])
def test_names_and_numbers_of_machines_are_accepted(tmp_path, host):
    changed = load_trial(write(tmp_path), AXES, PLANTS, [f"link.host={host}"])
    assert changed.link.host == host


def test_a_trial_in_the_place_of_a_rig_is_named_as_such(tmp_path):
    [found] = problems_of(tmp_path, overrides=[f"rig={tmp_path / 'trial.yaml'}"])
    assert "is a trial, no rig: name the file that its key `rig` names" in found


def test_a_key_that_others_of_a_section_contradict_is_reported_with_both_places(tmp_path):
    path = tmp_path / "trial.yaml"
    [found] = problems_of(tmp_path, overrides=["rig.limits.force_max_N=80", "duration_s=4"])
    line = next(n for n, text in enumerate(TRIAL.splitlines(), 1) if "force_cap_N" in text)
    assert found.startswith(
        f"--set rig.limits.force_max_N=80 (with {path.name}:{line}): slave.force_cap_N: 90"
    )


def test_each_contradiction_is_reported_at_the_line_of_its_own_key(tmp_path):
    text = TRIAL.replace("onset_force_N: 0.4", "onset_force_N: 600.0")
    cap, onset = problems_of(tmp_path, trial=text.replace("force_cap_N: 90", "force_cap_N: 500"))
    lines = [
        next(n for n, line in enumerate(text.splitlines(), 1) if key in line)
        for key in ("force_cap_N", "onset_force_N")
    ]
    assert 1 not in lines
    assert cap.startswith(
        f"trial.yaml:{lines[0]}: slave.force_cap_N: 500.0 is above rig.limits.force_max_N"
    )
    said = f"trial.yaml:{lines[1]}: contact.onset_force_N: 600.0 is not below slave.force_cap_N 500"
    assert onset.startswith(said)


def test_an_override_reaches_trial_and_rig_and_is_validated_alike(tmp_path):
    path = write(tmp_path)
    trial = load_trial(path, AXES, PLANTS, ["link.round_trip_ms=1e3", "rig.rate_hz=500"])
    assert trial.link.round_trip_ms == 1000
    assert trial.rig.rate_hz == 500
    found = problems_of(tmp_path, overrides=["link.round_trip=1"])
    assert found == [
        "--set link.round_trip=1: link.round_trip: unknown key; did you mean 'round_trip_ms'?"
    ]
    assert problems_of(tmp_path, overrides=["name=4057"]) == [
        "--set name=4057: name: must be text (it is 4057): put it in quotes"
    ]
    assert load_trial(path, AXES, PLANTS, ['name="4057"']).name == "4057"
    assert problems_of(tmp_path, overrides=["link"]) == ["--set link: write key.path=value"]


@pytest.mark.parametrize(
    "override",
    [
        "operator.hand.damping_N_s_per_m=-5",
        "operator.hand.tremor_N=-0.5",
        "operator.hand.stiffness_N_per_m=-1",
        "operator.rig.device.damping_N_s_per_m=-8",
    ],
)
def test_what_must_not_be_negative_is_refused_beside_the_range_of_its_unit(override):
    """The range of the unit once replaced the field's own bound, and a damping of -5 ran."""
    with pytest.raises(ConfigError, match="must be greater than or equal to 0"):
        load_trial_file(TRIALS / "handle.yaml", [override])


def test_a_hand_without_a_spring_only_carries_its_mass():
    trial = load_trial_file(TRIALS / "handle.yaml", ["operator.hand.stiffness_N_per_m=0"])
    assert trial.operator.hand.stiffness == 0.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("rig: rig.yaml", f"rig: {'a' * 5000}"), "no file"),
        (("rig: rig.yaml", 'rig: "a\\0b"'), "control character"),
        (("duration_s: 5", f"duration_s: 0x{'f' * 5000}"), "thousands of digits"),
    ],
)
def test_a_path_or_number_that_cannot_be_is_refused_in_a_sentence(tmp_path, change, said):
    assert change[0] in TRIAL
    with pytest.raises(ConfigError, match=said):
        load_trial(write(tmp_path, trial=TRIAL.replace(*change)), AXES, PLANTS)


def test_a_missing_rig_an_unknown_driver_and_broken_yaml_each_get_one_message(tmp_path):
    (missing,) = problems_of(tmp_path, trial=TRIAL.replace("rig.yaml", "none.yaml"))
    assert missing.startswith("trial.yaml:2: rig: no file")
    unknown = problems_of(tmp_path, rig=RIG.replace("driver: bench", "driver: magic"))
    assert unknown == ["rig.yaml:11: rig.axis.driver: 'magic' is not one of: bench, plain"]
    (broken,) = problems_of(tmp_path, trial="a: [1, 2\nb: 3\n")
    assert broken.startswith("trial.yaml:2: YAML syntax")
    assert broken.endswith(
        "; check blanks after colons, brackets, quotes and indentation in this line and those above"
    )
    (empty,) = problems_of(tmp_path, trial="")
    assert "must contain keys and values" in empty


def test_a_plant_on_a_rig_that_simulates_nothing_is_refused(tmp_path):
    rig = RIG.replace("{driver: bench, port: a}", "{driver: plain}")
    (found,) = problems_of(tmp_path, rig=rig)
    assert (
        found == "trial.yaml:19: plant: the driver 'plain' simulates nothing: remove this section"
    )


def test_a_dumped_trial_loads_to_the_same_trial(tmp_path):
    trial = load_trial(write(tmp_path), AXES, PLANTS)
    again = tmp_path / "again.yaml"
    again.write_text(yaml.safe_dump(dump(trial, trial.rig.units), sort_keys=False))
    assert load_trial(again, AXES, PLANTS) == trial


def test_units_of_position_and_force_belong_together():
    with pytest.raises(ValueError, match="rad with force in Nm"):
        Units(position="rad", force="N")


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_any_mutated_yaml_is_valid_or_refused_with_a_reason(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("mutated")
    text = TRIAL
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        cut = data.draw(st.integers(0, 12))
        text = text[:at] + data.draw(st.text(max_size=4)) + text[at + cut :]
    try:
        path = write(folder, trial=text)
    except UnicodeEncodeError:
        return
    try:
        load_trial(path, AXES, PLANTS)
    except ConfigError as error:
        assert error.problems
        assert all(problem.message for problem in error.problems)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["speed_m_per_s=1.6"], "homing.speed must not be above limits.velocity_max"),
        (
            ["to=touch", "touch_force_N=120.0"],
            "homing.touch_force must be below limits.force_max",
        ),
    ],
)
def test_homing_is_held_to_the_limits_of_the_rig(changes, words):
    overrides = [f"rig.reference.homing.{change}" for change in changes]
    with pytest.raises(ConfigError, match=words):
        load_trial_file(SILICONE, ["rig=../rigs/simulated_unreferenced.yaml", *overrides])
    load_trial_file(SILICONE, ["rig=../rigs/simulated_unreferenced.yaml"])


def test_a_config_of_another_version_gets_one_message(tmp_path):
    for name, text in (("trial.yaml", "format: 2\nwhatever: 1\n"), ("rig.yaml", "format: new\n")):
        path = tmp_path / name
        path.write_text(text)
        with pytest.raises(ConfigError) as raised:
            load_rig(path, {}) if name == "rig.yaml" else load_trial(path, {}, {})
        (problem,) = raised.value.problems
        assert f"{name}:1: format: this file is of format" in str(problem)
        assert "reads format 1" in str(problem)


def test_a_trial_may_name_a_rig_that_ships():
    by_name = load_trial_file(SILICONE, ["rig=simulated_serial"])
    by_path = load_trial_file(SILICONE, ["rig=../rigs/simulated_serial.yaml"])
    assert by_name == by_path
    with pytest.raises(ConfigError, match=r"rig: no file .*simulated_parallel"):
        load_trial_file(SILICONE, ["rig=simulated_parallel"])


@pytest.mark.parametrize("rig", ["simulated_serial", "simulated_canopen"])
def test_a_run_keeps_the_lines_and_buses_of_real_devices(rig):
    on_hardware = [f"rig={rig}", "plant=null"]
    assert (
        load_trial_for_run(SILICONE, on_hardware).rig == load_trial_file(SILICONE, on_hardware).rig
    )
    assert (
        load_trial_for_run(SILICONE, on_hardware[:1]).rig.axis
        != load_trial_file(SILICONE, on_hardware).rig.axis
    )


@pytest.mark.parametrize(
    ("before", "after", "problem"),
    [
        ("duration_s: 5", "duration_s: 1e-9", "duration_s: must be greater than or equal to 0.01"),
        ("name: press", f"name: {101 * 'a'}", "name: must have at most 100 characters"),
    ],
)
def test_a_trial_that_no_run_could_carry_out_is_refused(tmp_path, before, after, problem):
    assert before in TRIAL
    [found] = problems_of(tmp_path, trial=TRIAL.replace(before, after))
    assert problem in found
