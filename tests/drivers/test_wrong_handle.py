"""A rig that no force drives, as an operator's device."""

from types import SimpleNamespace

from teleop_rt.config.rig import AxisConfig
from teleop_rt_drivers.device_check import check_device


def test_a_driver_that_takes_no_forces_is_refused_with_its_key_once_and_a_way():
    axis = AxisConfig.model_construct(driver="myhand")
    operator = SimpleNamespace(rig=SimpleNamespace(axis=axis))
    [finding] = check_device(SimpleNamespace(), operator)
    assert finding.where == "operator.rig.axis"
    assert finding.what == "'myhand' is not driven by force"
    assert finding.next_step.startswith("name the rig of a handle (canopen_device, serial_device,")
