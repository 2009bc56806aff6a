"""Invalid configs: bombs of aliases, of depth, of size."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from teleop_rt.config.yaml_file import MOST_BYTES, MOST_NODES, ConfigError, read_yaml


def bomb(levels: int, width: int = 9) -> str:
    values = ["x", *(f"*a{level}" for level in range(levels - 1))]
    return "\n".join(
        f"a{level}: &a{level} [{', '.join([value] * width)}]" for level, value in enumerate(values)
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (bomb(9), "more than"),
        (bomb(60, 2), "more than"),
        ("&a [*a]", "nested deeper"),
        ("a: &a {b: *a}", "nested deeper"),
        ("[" * 60 + "]" * 60, "nested deeper"),
        ("[" * 200_000, "nested deeper"),
        ("{a: " * 50_000, "nested deeper"),
        ("- " * 50_000, "cannot be read|more than"),
        ("- x\n" * MOST_NODES, "more than"),
        ("#" * (MOST_BYTES + 1), "larger than"),
        ("a: " + "9" * 5000, "no value of its tag"),
        ('a: "\\e[2J"', "control character"),
        ('a: "\\x9b31m"', "control character"),
        ('"\\e]0;b": 1', "a key contains a control character"),
    ],
)
def test_a_bomb_is_refused_in_a_sentence(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "trial.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_yaml(path)


@pytest.mark.parametrize(
    "tag", ["!!python/object:os.system", "!!set", "!!omap", "!!binary", "!mine"]
)
@pytest.mark.parametrize("value", ["{time: t_s}", "[a]", "aGk="])
def test_a_tag_beyond_the_core_of_yaml_is_refused_wherever_it_stands(tmp_path, tag, value):
    path = tmp_path / "run.columns.yaml"
    path.write_text(f"columns: {tag} {value}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"columns.yaml:1: the tag .* is not understood"):
        read_yaml(path)


@pytest.mark.parametrize(
    "value", ["!!bool maybe", "!!int x1", "!!float x.y", "!!int 0x", '!!int ""', "!!float 1:x"]
)
def test_a_value_that_is_not_what_its_tag_says_is_refused_with_its_line(tmp_path, value):
    path = tmp_path / "trial.yaml"
    path.write_text(f"name: x\nduration_s: {value}\n")
    with pytest.raises(ConfigError, match=r"trial\.yaml:2: .* is no value of its tag"):
        read_yaml(path)


def test_anchors_of_a_plain_file_are_read(tmp_path: Path) -> None:
    path = tmp_path / "trial.yaml"
    path.write_text("a: &limits {low: 1, high: 2}\nb: *limits\n", encoding="utf-8")
    assert read_yaml(path).data == {"a": {"low": 1, "high": 2}, "b": {"low": 1, "high": 2}}


def test_a_pipe_or_a_device_is_refused_and_never_waited_for(tmp_path):
    """Also where it takes the file's place after a check has found the file in order."""
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "device.yaml").symlink_to("/dev/zero")
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    for name in ("pipe", "device"):
        with pytest.raises(ConfigError, match="is a pipe or a device"):
            read_yaml(tmp_path / f"{name}.yaml")
    with pytest.raises(ConfigError, match="cannot be read"):
        read_yaml(tmp_path / "loop.yaml")
