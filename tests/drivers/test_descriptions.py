"""A wrong EDS or DBC is refused with file, line and key; a frame format likewise elsewhere."""

from __future__ import annotations

from importlib import resources

import pytest
from rig_bench import canopen_rig, changed

from teleop_rt.axis import AxisError
from teleop_rt_drivers.canopen import eds
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.framed.dbc import load_dbc
from teleop_rt_drivers.recording import recording_path
from teleop_rt_drivers.replayed_bus import ReplayBus

PACKAGE = resources.files("teleop_rt_drivers")


def line_of(text: str, wanted: str) -> int:
    """The line that holds some text, counted without the reader's help."""
    return text[: text.index(wanted)].count("\n") + 1


def edited_eds(tmp_path, old: str, new: str):
    """The encoder's EDS with its first `old` after [6004] replaced, and the line of that."""
    text = (PACKAGE / "eds" / "encoder_cia406.eds").read_text()
    head, section, tail = text.partition("[6004]\n")
    assert old in tail
    file = tmp_path / "edited.eds"
    file.write_text(head + section + tail.replace(old, new, 1))
    return file, line_of(head + section, "[6004]") + (section + tail).split(old)[0].count("\n")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("DataType=0x0004", "DataType=long", "[6004] DataType: 'long' is no number"),
        ("DataType=0x0004\n", "", "[6004] DataType: is missing"),
        ("ParameterName=Position value\n", "", "[6004] ParameterName: is missing"),
        ("AccessType=ro", "AccessType=readable", "[6004] AccessType: 'readable' is not one of ro,"),
        ("DefaultValue=0", "DefaultValue=none", "[6004] DefaultValue: 'none' is no number"),
        ("DefaultValue=0", "DefaultValue=0x1FFFFFFFF", "0x1FFFFFFFF does not fit into 32 bits"),
        ("PDOMapping=1", "PDOMapping=yes", "[6004] PDOMapping: 'yes' is no number"),
        (
            "ObjectType=0x7",
            "ObjectType=0x7\nObjectType=0x8",
            "ObjectType: is listed twice",
        ),
        ("ObjectType=0x7", "what is this", "is neither a section nor a key"),
    ],
)
def test_a_wrong_eds_is_refused_with_line_and_key_before_anything_is_opened(
    old, new, said, tmp_path
):
    file, line = edited_eds(tmp_path, old, new)
    line = line_of(file.read_text(), "[6004]") if "missing" in said else line
    line += "twice" in said
    rig = changed(canopen_rig(), encoder={"eds": str(file)})
    (found,) = (finding for finding in check_rig(rig) if finding.severity == "error")
    assert f"{file}:{line}: " in found.what
    assert said in found.what


def test_an_eds_without_its_mandatory_section_is_refused_without_a_warning(tmp_path):
    text = (PACKAGE / "eds" / "encoder_cia406.eds").read_text()
    file = tmp_path / "edited.eds"
    file.write_text(text.replace("[DeviceInfo]", "[DeviceInf]"))
    with pytest.raises(AxisError, match=r"edited\.eds:1: the section \[DeviceInfo\] is missing"):
        eds.load(str(file), 0x10)


def test_a_list_that_names_an_object_without_a_section_is_refused(tmp_path):
    text = (PACKAGE / "eds" / "encoder_cia406.eds").read_text()
    file = tmp_path / "edited.eds"
    file.write_text(text.replace("=0x6004\n", "=0x6044\n"))
    line = line_of(file.read_text(), "=0x6044\n")
    with pytest.raises(AxisError, match=rf"edited\.eds:{line}: \[Opt.*no section for 0x6044"):
        eds.load(str(file), 0x10)


def test_another_revision_or_identity_than_the_eds_says_is_refused_before_anything_is_opened():
    rig = canopen_rig()
    for key, value in (("vendor", 0x999), ("product", 0x999), ("revision", 0x999)):
        identity = rig.axis.encoder.identity.model_copy(update={key: value})
        findings = check_rig(changed(rig, encoder={"identity": identity}))
        (found,) = (finding for finding in findings if finding.severity == "error")
        assert "the rig's config says 0x999" in found.what


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("SG_ COUNTER : 32|4@1+", "SG_ COUNTER : 32|4@1x", "Invalid syntax"),
        ("SG_ POSITION : 0|32", "SG_ POSITION : 60|32", "POSITION does not fit in message ENCODER"),
        ("SG_ STATUS : 39|8", "SG_ STATUS : 30|8", "overlapping in message FORCE"),
    ],
)
def test_a_wrong_dbc_is_refused_with_its_line(old, new, said, tmp_path):
    text = (PACKAGE / "dbc" / "simulated_rig.dbc").read_text()
    file = tmp_path / "edited.dbc"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(AxisError, match=said) as refused:
        load_dbc(str(file))
    assert str(refused.value).startswith(f"{file}:{line_of(file.read_text(), new)}: ")


def huge(folder, name: str) -> str:
    """A file of 6 GB that takes no room on the disk."""
    file = folder / name
    with file.open("wb") as opened:
        opened.truncate(6 << 30)
    return str(file)


def test_what_would_fill_the_memory_is_refused_unread(tmp_path):
    with pytest.raises(AxisError, match="more than 8 MB describe no device"):
        eds.load(huge(tmp_path, "huge.eds"), 1)
    with pytest.raises(AxisError, match="more than 8 MB describe no device"):
        load_dbc(huge(tmp_path, "huge.dbc"))
    with pytest.raises(AxisError, match="more than 256 MB"):
        ReplayBus(huge(tmp_path, "huge.asc"), bool, bool)
    with pytest.raises(AxisError, match="more than 256 MB"):
        recording_path(huge(tmp_path, "huge.csv"), ())


def test_a_description_that_cannot_be_read_says_which_and_why():
    with pytest.raises(AxisError, match="EDS file '/proc/self/mem' cannot be read: Input/output"):
        eds.load("/proc/self/mem", 1)
    with pytest.raises(AxisError, match="DBC '/proc/self/mem' cannot be read: Input/output"):
        load_dbc("/proc/self/mem")


def test_a_description_with_the_ends_of_lines_of_another_system_is_the_same(tmp_path):
    for name, end in (("old.eds", "\r"), ("other.eds", "\r\n")):
        text = (PACKAGE / "eds" / "encoder_cia406.eds").read_text()
        (tmp_path / name).write_bytes(text.replace("\n", end).encode())
        ours = eds.load("encoder_cia406.eds", 1)
        assert sorted(eds.load(str(tmp_path / name), 1)) == sorted(ours)
    text = (PACKAGE / "dbc" / "simulated_rig.dbc").read_text()
    other = tmp_path / "other.dbc"
    other.write_bytes(text.replace("\n", "\r\n").encode("cp1252"))
    assert sorted(load_dbc(str(other))) == sorted(load_dbc("simulated_rig.dbc"))
