import json
import re
from functools import cache
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
import yaml
from jsonschema import Draft202012Validator
from schema_checks import mutations, plain, properties, unbounded

from teleop_rt.cli.schema import SchemaName, schema
from teleop_rt.cli.schemas import as_text, schema_named
from teleop_rt.config.loader import load_rig, load_trial
from teleop_rt.config.value_words import PATTERNS
from teleop_rt.config.yaml_file import ConfigError, read_yaml
from teleop_rt_drivers import registry

ROOT = Path(__file__).parents[1]
TRIALS = sorted((ROOT / "config" / "trials").glob("*.yaml"))
RIGS = sorted((ROOT / "config" / "rigs").glob("*.yaml"))
FORMATS = sorted((ROOT / "drivers" / "teleop_rt_drivers" / "formats").glob("*.yaml"))
SHIPPED = [*TRIALS, *RIGS, *FORMATS]
MODELINE = re.compile(r"# yaml-language-server: \$schema=(\S+)")
MUTATIONS_OF_A_FILE = 15
BY_ONE_KEY = re.compile(
    r"is required and missing|there is no key|lacks its unit"
    r"|must be (?:greater|less|a |an |text|true|'|\d)|must have at (?:least|most)|there is no '"
    r"|must (?:not be empty|consist of)"
    r"|names no "
)
"""The loader's rules for single keys, which JSON Schema can express; other rules join keys."""


current_text = cache(as_text)


@pytest.fixture(scope="module")
def validators():
    schemas = {name: schema_named(name) for name in SchemaName}
    for one in schemas.values():
        Draft202012Validator.check_schema(one)
    return {name: Draft202012Validator(one) for name, one in schemas.items()}


def kind_of(path):
    kinds = {"trials": SchemaName.TRIAL, "rigs": SchemaName.RIG, "formats": SchemaName.FORMAT}
    return kinds[path.parent.name]


@pytest.mark.parametrize("name", SchemaName)
def test_every_key_of_every_schema_has_a_description(name):
    found = dict(properties(schema_named(name)))
    assert len(found) > 5
    missing = [path for path, body in found.items() if not body.get("description")]
    assert missing == []


def test_every_pattern_of_a_text_field_has_words():
    of_numbers_and_bytes = {
        "^0[xX][0-9A-Fa-f]+$",
        r"^[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?$",
        r"^\s*([0-9A-Fa-f]{2}\s*)*$",
    }
    text = "".join(as_text(name) for name in SchemaName)
    found = {json.loads(one) for one in re.findall(r'"pattern": ("[^\n]*")', text)}
    assert found - of_numbers_and_bytes == set(PATTERNS)


OF_FILES = [SchemaName.TRIAL, SchemaName.RIG, SchemaName.FORMAT, SchemaName.COLUMNS]


@pytest.mark.parametrize("name", OF_FILES)
def test_every_number_of_a_file_has_bounds_of_sense(name):
    schema = schema_named(name)
    assert len(list(unbounded({"type": ["number", "null"], "minimum": 0}))) == 1
    assert list(unbounded(schema)) == []


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("limits.force_max_N", 1e7),
        ("limits.position_max_m", 1001),
        ("limits.velocity_max_m_per_s", 2000),
        ("supervision.load_N", -2e6),
        ("axis.force.scale_N_per_count", 1e5),
        ("axis.drive.setup.0x6007", 2**64),
        ("recording.part_MB", 1e9),
    ],
)
def test_a_number_that_can_only_be_a_slip_is_refused_in_words(key, value, tmp_path):
    data = plain(read_yaml(ROOT / "config" / "rigs" / "simulated_canopen.yaml").data)
    *holders, name = key.split(".")
    holder = data
    for each in holders:
        holder = holder.setdefault(each, {})
    holder[name] = value
    file = tmp_path / "rig.yaml"
    file.write_text(yaml.safe_dump(data))
    problems = loader_problems(file, SchemaName.RIG)
    assert any(f"{name}: must be" in problem for problem in problems), problems


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_a_shipped_file_follows_the_schema_that_it_names_and_that_is_current(path, validators):
    modeline = MODELINE.match(path.read_text().splitlines()[0])
    named = (path.parent / modeline[1]).resolve()
    assert named.read_text() == current_text(kind_of(path)), "run scripts/schemas"
    problems = list(validators[kind_of(path)].iter_errors(plain(read_yaml(path).data)))
    assert problems == []


def test_the_checked_in_schema_of_columns_is_current():
    text = (ROOT / "config" / "schema" / "columns.schema.json").read_text()
    assert text == as_text(SchemaName.COLUMNS), "run scripts/schemas"


def loader_problems(path, kind):
    try:
        if kind is SchemaName.RIG:
            load_rig(path, registry.AXIS_SCHEMAS)
        else:
            load_trial(path, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS)
    except ConfigError as error:
        return [str(problem) for problem in error.problems]
    return []


def whole(path):
    """Return a trial with its rigs in it, and with every section that may be left out."""
    data = plain(read_yaml(path).data)
    if kind_of(path) is SchemaName.TRIAL:
        holders = [data]
        if data["operator"]["kind"] == "device":
            holders.append(data["operator"])
        for holder in holders:
            holder["rig"] = plain(read_yaml(path.parent / holder["rig"]).data)
    return data


@pytest.mark.parametrize("path", [*TRIALS, *RIGS], ids=lambda path: path.name)
def test_schema_and_loader_refuse_the_same_changes_of_a_file(path, validators, tmp_path):
    kind, validator = kind_of(path), validators[kind_of(path)]
    changed = list(mutations(whole(path)))
    order = np.random.default_rng(crc32(path.name.encode())).permutation(len(changed))
    chosen = [changed[place] for place in order[:MUTATIONS_OF_A_FILE]]
    file = tmp_path / "changed.yaml"
    refused = 0
    for what, make in chosen:
        data = make()
        file.write_text(yaml.dump(data, Dumper=yaml.CSafeDumper))
        by_schema = not validator.is_valid(data)
        problems = loader_problems(file, kind)
        if by_schema:
            assert problems, f"{what}: the schema refuses it, the loader takes it"
        if any(BY_ONE_KEY.search(problem) for problem in problems):
            assert by_schema, f"{what}: the loader refuses it, the schema takes it: {problems}"
        refused += by_schema
    assert refused >= 5


def test_a_rotary_rig_is_refused_keys_of_a_linear_one(validators):
    data = plain(read_yaml(ROOT / "config" / "rigs" / "measured_spring.yaml").data)
    assert validators[SchemaName.RIG].is_valid(data)
    data["limits"]["force_max_N"] = data["limits"].pop("force_max_Nm")
    assert not validators[SchemaName.RIG].is_valid(data)


def test_the_command_prints_the_schema(capsys):
    schema(SchemaName.RIG)
    assert json.loads(capsys.readouterr().out)["title"] == "RigConfig"
