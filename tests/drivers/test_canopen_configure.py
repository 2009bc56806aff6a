from __future__ import annotations

from importlib import resources

import can
import pytest
from rig_bench import Bench, canopen_rig, changed, plant_config

from teleop_rt.axis import AxisError
from teleop_rt_drivers.simulated.device import Nmt


def test_configure_leaves_all_nodes_operational_with_the_rigs_values():
    bench = Bench()
    bench.axis.configure()
    devices = bench.simulated.devices
    assert all(device.state is Nmt.OPERATIONAL for device in devices.values())
    assert all(device.value(0x1017) == 20 for device in devices.values())
    drive = devices["drive"]
    assert drive.value(0x6060) == 8
    assert drive.value(0x1016, 1) == 127 << 16 | 60
    assert (drive.value(0x607D, 1), drive.value(0x607D, 2)) == (-60_000, 60_000)
    assert drive.value(0x607F) == 1_500_000
    assert (drive.value(0x60C2, 1), drive.value(0x60C2, 2)) == (1, -3)
    assert drive.value(0x6007) == 3


def test_a_drive_with_its_own_unit_of_speed_is_limited_in_that():
    # 60A9h of an EPOS4 is rpm as delivered: 25 um/s each at a lead of 1.5 mm.
    bench = Bench(axis_rig=changed(canopen_rig(), drive={"speed_count": 25e-6}))
    bench.axis.configure()
    assert bench.simulated.devices["drive"].value(0x607F) == 60_000


def test_configure_moves_nothing_and_enables_nothing():
    bench = Bench()
    bench.axis.configure()
    assert not bench.simulated.drive.powered
    assert not bench.cycles(20, 0.01).enabled
    assert bench.simulated.plant.position == 0.0


def test_configure_disables_pdos_that_the_rig_does_not_name():
    bench = Bench()
    bench.axis.configure()
    assert bench.simulated.devices["encoder"].value(0x1800, 1) >> 31 == 1
    assert bench.simulated.devices["encoder"].value(0x1801, 1) == 0x290


def test_configure_may_be_repeated():
    bench = Bench()
    bench.axis.configure()
    bench.cycles(5)
    bench.axis.configure()
    assert bench.cycles(3).valid


def test_a_rig_that_was_closed_in_good_order_serves_the_next_daemon():
    bench = Bench().armed()
    bench.axis.close()
    bench.axis.configure()
    assert bench.cycles(3).valid


def test_a_device_that_somebody_has_stopped_is_called_back():
    bench = Bench()
    for device in bench.simulated.devices.values():
        device.receive_nmt(0x02)
    bench.axis.configure()
    assert bench.cycles(3).valid


def test_a_mapping_in_another_order_is_configured_and_understood():
    rig = canopen_rig()
    tpdo = rig.axis.encoder.tpdo.model_copy(
        update={"objects": ("0x6503", "0x6004"), "cob_id": 0x2A5}
    )
    bench = Bench(axis_rig=changed(rig, encoder={"tpdo": tpdo, "speed": None}), plant=at(0.005))
    bench.axis.configure()
    assert bench.cycles(3).valid
    assert bench.sample.position == pytest.approx(0.005)


def at(start: float):
    return plant_config(start=start)


def other_device(tmp_path, subindex: int, old: str, new: str) -> str:
    """The EDS of a force sensor with another identity."""
    text = (resources.files("teleop_rt_drivers") / "eds" / "force_cia404.eds").read_text()
    section = f"[1018sub{subindex}]"
    head, tail = text.split(section)
    assert old in tail
    file = tmp_path / "other.eds"
    file.write_text(head + section + tail.replace(old, new, 1))
    return str(file)


@pytest.mark.parametrize(
    ("subindex", "old", "new", "both"),
    [
        (1, "0x00000543", "0x00000777", r"0x777.*0x543"),
        (2, "0x00000404", "0x00000405", r"0x405.*0x404"),
    ],
)
def test_a_device_of_another_identity_is_refused_with_both_values(
    tmp_path, subindex, old, new, both
):
    rig = canopen_rig()
    devices = changed(rig, force={"eds": other_device(tmp_path, subindex, old, new)})
    bench = Bench(axis_rig=rig, device_rig=devices)
    with pytest.raises(AxisError, match=rf"node 0x20 \(force sensor\).*{both}"):
        bench.axis.configure()
    assert all(d.state is Nmt.PRE_OPERATIONAL for d in bench.simulated.devices.values())


def test_an_eds_of_another_device_is_refused_with_both_values():
    rig = canopen_rig()
    identity = rig.axis.force.identity.model_copy(update={"product": 0x999})
    with pytest.raises(AxisError, match=r"0x404.*0x999"):
        Bench(axis_rig=changed(rig, force={"identity": identity})).axis.configure()


def test_another_revision_is_refused_where_the_rig_names_one():
    rig = canopen_rig()
    identity = rig.axis.force.identity.model_copy(update={"revision": 0x20000})
    with pytest.raises(AxisError, match=r"0x10000.*0x20000"):
        Bench(axis_rig=changed(rig, force={"identity": identity})).axis.configure()


def test_a_silent_device_is_named_with_what_to_check():
    bench = Bench()
    bench.simulated.inject("mute", "force sensor")
    with pytest.raises(AxisError, match=r"no answer from node 0x20 \(force sensor\).*wiring"):
        bench.axis.configure()


def test_a_measuring_step_other_than_the_scale_is_refused_with_both_values():
    bench = Bench(plant=plant_config(sensors={"encoder_resolution": 1e-6}))
    with pytest.raises(AxisError, match=r"1e-06 per count.*5e-06"):
        bench.axis.configure()


def test_another_unit_of_force_is_refused():
    rig = canopen_rig()
    bench = Bench(axis_rig=changed(rig, force={"expect": {"0x6131:1": 0x00560000}}))
    with pytest.raises(AxisError, match=r"0x6131:1.*0x210000.*0x560000"):
        bench.axis.configure()


def test_an_entry_that_the_device_refuses_to_write_is_named():
    rig = canopen_rig()
    bench = Bench(axis_rig=changed(rig, force={"setup": {"0x6131:1": 1}}))
    with pytest.raises(AxisError, match="refuses to write 1 to 0x6131:1"):
        bench.axis.configure()


@pytest.mark.parametrize(
    ("cob_id", "said"), [(0x000, "NMT"), (0x080, "SYNC"), (0x77F, "heartbeat")]
)
def test_a_network_of_another_master_is_left_alone(cob_id, said):
    bench = Bench()
    heard = []
    deliver = bench.device_end.deliver
    bench.device_end.deliver = lambda message: (heard.append(message), deliver(message))
    bench.daemon_end.deliver(can.Message(arbitration_id=cob_id, is_extended_id=False, data=b"\x05"))
    with pytest.raises(AxisError, match=f"another master.*{said}"):
        bench.axis.configure()
    bench.axis.close()
    assert heard == []


def test_a_drive_that_stays_in_fault_is_refused():
    bench = Bench()
    drive = bench.simulated.drive
    drive._obey = lambda control: None
    drive.fail(0x8611)
    with pytest.raises(AxisError, match="0x8611"):
        bench.axis.configure()
