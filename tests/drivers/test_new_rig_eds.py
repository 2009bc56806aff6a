"""`new-rig --eds`: a rig for a drive that is known by its maker's EDS alone."""

from __future__ import annotations

import re
from importlib import resources

import pytest
from framed_bench import FramedBench

from teleop_rt.config.loader import load_rig
from teleop_rt_drivers import registry
from teleop_rt_drivers.new_rig import with_eds, with_found, write_rig
from teleop_rt_drivers.rig_text import rig_text
from teleop_rt_drivers.scanning.found import Found

SHIPPED = resources.files("teleop_rt_drivers") / "eds"
VENDOR, PRODUCT = 0xFB, 0x6350_0000
CANOPEN = ("--drive", "canopen", "--adapter", "unix", "--sensor", "wrench", "--position", "drive")


def other_drive() -> str:
    """The EDS of a drive of another maker: its first TPDO has a fixed mapping."""
    text = (SHIPPED / "drive_cia402.eds").read_text()
    text = with_key(text, "1018sub1", "DefaultValue", f"0x{VENDOR:X}")
    text = with_key(text, "1018sub2", "DefaultValue", f"0x{PRODUCT:X}")
    return with_key(text, "1A00sub0", "AccessType", "ro")


def with_key(text: str, section: str, key: str, value: str) -> str:
    """The text with a key of a section set, there or not."""
    begin = text.index(f"[{section}]\n") + len(section) + 3
    end = text.find("\n[", begin) % (len(text) + 1)
    body = re.sub(rf"^{key}=.*\n?", "", text[begin:end], flags=re.MULTILINE)
    return f"{text[:begin]}{key}={value}\n{body}{text[end:]}"


def without(text: str, *sections: str) -> str:
    """The text without sections, and without their places in the lists of objects."""
    for section in sections:
        text = re.sub(
            rf"^\[{section}(sub\w+)?\]\n(?:[^\[]*\n)*?(?=\[|\Z)", "", text, flags=re.MULTILINE
        )
        text = re.sub(rf"^\d+=0x{section}\n", "", text, flags=re.MULTILINE)
    return text


def test_identity_and_mappings_are_the_eds_s_and_the_rig_runs(tmp_path, call):
    (tmp_path / "other.eds").write_text(other_drive())
    file = tmp_path / "rig.yaml"
    code, out, err = call("new-rig", file, *CANOPEN, "--eds", tmp_path / "other.eds")
    assert code == 0, err
    assert "0x607F (largest speed" in out
    rig = load_rig(file, registry.AXIS_SCHEMAS)
    drive = registry.parts_of(rig.axis)["bus"].drive
    assert (drive.identity.vendor, drive.identity.product) == (VENDOR, PRODUCT)
    assert (drive.rpdo.number, drive.tpdo.number) == (1, 2), "the first TPDO cannot be mapped"
    FramedBench(rig).armed(60)


def test_a_maker_s_analog_input_is_found_by_its_name(tmp_path, call):
    text = without(other_drive(), "6401").replace("0x64010110", "0")
    text = text.replace("[ManufacturerObjects]\nSupportedObjects=0\n", OF_THE_MAKER)
    (tmp_path / "other.eds").write_text(text)
    file = tmp_path / "rig.yaml"
    options = ("--drive", "canopen", "--adapter", "unix", "--sensor", "drive-input")
    code, out, err = call("new-rig", file, *options, "--eds", tmp_path / "other.eds")
    assert code == 0, err
    assert "0x3160:1 (Analog input properties: Analog input 1 voltage) is taken" in out
    assert "others are 0x3160:2" in out
    wired = load_rig(file, registry.AXIS_SCHEMAS).axis.drive.force_input
    assert (wired.force, wired.tpdo.objects, wired.tpdo.number) == ("0x3160:1", ("0x3160:1",), 3)
    (tmp_path / "none.eds").write_text(without(other_drive(), "6401").replace("0x64010110", "0"))
    code, _, err = call("new-rig", tmp_path / "r.yaml", *options, "--eds", tmp_path / "none.eds")
    assert code == 2
    assert "no object with an analog input in its name" in err


OF_THE_MAKER = """\
[ManufacturerObjects]
SupportedObjects=1
1=0x3160

[3160]
ParameterName=Analog input properties
ObjectType=0x9
SubNumber=3

[3160sub0]
ParameterName=Highest sub-index supported
ObjectType=0x7
DataType=0x0005
AccessType=const
DefaultValue=2
PDOMapping=0

[3160sub1]
ParameterName=Analog input 1 voltage
ObjectType=0x7
DataType=0x0003
AccessType=ro
PDOMapping=1

[3160sub2]
ParameterName=Analog input 2 voltage
ObjectType=0x7
DataType=0x0003
AccessType=ro
PDOMapping=1
"""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: without(text, "60C2"), r"lacks 0x60C2:1, 0x60C2:2, which the daemon needs"),
        (lambda text: with_key(text, "6077", "PDOMapping", "0"), r"0x6077 cannot be mapped"),
        (lambda text: with_key(text, "6502", "DefaultValue", "0x01"), "no cyclic synchronous"),
        (lambda text: with_key(text, "1000", "DefaultValue", "0x60191"), "of CiA 401, not of a"),
        (lambda text: with_key(text, "1600sub0", "AccessType", "const"), "no RPDO has a mapping"),
        (lambda text: text[:200], "is missing|is neither a section nor a key"),
        (lambda _: (SHIPPED / "encoder_cia406.eds").read_text(), "of CiA 406, not of a drive"),
        (lambda _: "\0\1\2", "is no EDS|is missing|neither a section"),
    ],
)
def test_an_eds_that_is_of_no_such_drive_is_refused_and_nothing_is_written(
    change, words, tmp_path, call
):
    (tmp_path / "other.eds").write_text(change(other_drive()))
    code, _, err = call("new-rig", tmp_path / "rig.yaml", *CANOPEN, "--eds", tmp_path / "other.eds")
    assert code == 2
    assert re.search(words, err), err
    assert not (tmp_path / "rig.yaml").exists()


def test_an_eds_for_a_drive_that_is_no_canopen_drive_is_refused(tmp_path, call):
    odrive = ("--drive", "odrive", "--adapter", "unix", "--sensor", "wrench")
    code, _, err = call("new-rig", tmp_path / "r.yaml", *odrive, "--eds", tmp_path / "none.eds")
    assert code == 2
    assert "--eds is for --drive canopen" in err
    code, _, err = call("new-rig", tmp_path / "r.yaml", *CANOPEN, "--eds", tmp_path / "none.eds")
    assert code == 2
    assert "none.eds" in err


def test_what_a_drive_lacks_is_left_out_and_its_limits_are_kept(tmp_path, call):
    text = with_key(without(other_drive(), "605A"), "6085", "HighLimit", "1000")
    (tmp_path / "other.eds").write_text(text)
    file = tmp_path / "rig.yaml"
    code, out, err = call("new-rig", file, *CANOPEN, "--eds", tmp_path / "other.eds")
    assert code == 0, err
    assert "0x605A is left out: this drive has no such entry" in out
    assert "0x6085 is its largest, 1000" in out
    drive = registry.parts_of(load_rig(file, registry.AXIS_SCHEMAS).axis)["bus"].drive
    assert drive.setup == {"0x6007": 3, "0x6085": 1000}


def test_a_drive_that_goes_on_without_the_daemon_is_refused(tmp_path, call):
    (tmp_path / "other.eds").write_text(without(other_drive(), "6007"))
    file = tmp_path / "rig.yaml"
    code, _, err = call("new-rig", file, *CANOPEN, "--eds", tmp_path / "other.eds")
    assert code == 2
    assert "drive.setup does not set 0x" in err
    assert not file.exists()


def test_a_scan_takes_a_drive_whose_eds_was_given(tmp_path):

    (tmp_path / "other.eds").write_text(other_drive())
    text = rig_text("canopen", "unix", "wrench", None, "drive")
    text = with_eds(text, tmp_path / "other.eds", lambda _: None)
    values = {("drive", "node_id"): 9, ("drive", "identity", "vendor"): VENDOR}
    epos = Found(9, values | {("drive", "identity", "product"): PRODUCT}, "node 9, CiA 402")
    write_rig(tmp_path / "rig.yaml", with_found(text, "canopen", [epos], None))
    axis = load_rig(tmp_path / "rig.yaml", registry.AXIS_SCHEMAS).axis
    assert axis.parts["bus"].drive.node_id == 9
