"""`check` knows the interfaces that a bus can have."""

import pytest
from framed_bench import edited

from teleop_rt_drivers.check import check_rig


def errors_of(tmp_path, kind, interface):
    rig = edited(kind, tmp_path, ("interface: unix", f"interface: {interface}"))
    return [one for one in check_rig(rig) if one.severity == "error"]


@pytest.mark.parametrize(
    ("kind", "where"),
    [
        ("canopen", "axis.bus.interface"),
        ("raw_can", "axis.bus.interface"),
        ("odrive", "axis.parts.drive.bus.interface"),
    ],
)
def test_an_interface_that_does_not_exist_is_an_error_with_those_that_may_be_meant(
    kind, where, tmp_path
):
    (near,) = errors_of(tmp_path, kind, "soketcan")
    assert (near.where, near.next_step) == (where, "take socketcan")
    (far,) = errors_of(tmp_path, kind, "foo")
    assert far.next_step.startswith("take socketcan, ")


@pytest.mark.parametrize("interface", ["socketcan", "slcan", "fdcanusb", "pcan", "virtual"])
def test_an_interface_of_python_can_or_of_this_program_is_accepted(interface, tmp_path):
    assert errors_of(tmp_path, "canopen", interface) == []
