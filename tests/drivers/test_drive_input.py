"""A force sensor at an analog input of a CANopen drive: values, range, silence, config, scale."""

from __future__ import annotations

import struct

import pytest
from pydantic import ValidationError
from rig_bench import MS, Bench, path, plant_config

from teleop_rt.config.loader import load_rig
from teleop_rt.shipped import EXAMPLES
from teleop_rt.signals import TRUTH, columns
from teleop_rt_drivers.calibration.force import force_keys
from teleop_rt_drivers.calibration.weights import ForceFit
from teleop_rt_drivers.canopen.config import CanopenConfig
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.doctor import frame_names
from teleop_rt_drivers.registry import AXIS_SCHEMAS
from teleop_rt_drivers.simulated.synchronous_bus import as_sent

RIG = load_rig(EXAMPLES / "rigs" / "simulated_canopen_input.yaml", AXIS_SCHEMAS)
INPUT_ID = 0x280 + 0x30
"""COB-ID of the second TPDO of node 30h (CiA 301, predefined connection set)."""
STEP = 0.025 * 10_000 / 2048
"""Force of one step of 12 bits over -10 to 10 V, of 0.025 N/mV."""
COLUMN = columns(TRUTH)


def bench(**sensors: float) -> Bench:
    quiet = {"force_noise": 0.0, "force_lag_jitter_us": 0.0, **sensors}
    return Bench(axis_rig=RIG, plant=plant_config(sensors=quiet))


def replaced(one: Bench, *given: bytes) -> None:
    """The input's frames carry other bytes from now on, one after the other; then none come."""
    deliver, left = one.daemon_end.deliver, iter(given)

    def changed(message):
        if as_sent(message)[0] != INPUT_ID:
            deliver(message)
        elif (data := next(left, None)) is not None:
            deliver((INPUT_ID, data))

    one.daemon_end.deliver = changed


def test_the_force_is_that_of_the_same_sync_as_the_position_within_a_step():
    one, truths, deepest = bench().armed(), {}, 0.0
    for k in range(400):
        sample = one.cycle(path(k))
        row = one.simulated.truth_row
        truths[int(row[COLUMN["stamp_ns"]])] = row[COLUMN["force"]]
        if k > 2:
            assert sample.valid
            assert sample.force_stamp_ns == sample.position_stamp_ns
            # The simulated sensor lags by 1 ms.
            force = truths[sample.force_stamp_ns - MS]
            assert sample.force == pytest.approx(force, abs=STEP / 2 + 0.0126)
            deepest = max(deepest, force)
    assert deepest > 30.0


@pytest.mark.parametrize("offset", [-300.0, 300.0])
def test_a_saturated_input_gives_no_force(offset):
    one = bench(force_offset=offset)
    one.axis.configure()
    one.cycles(20)
    assert not one.sample.valid
    assert one.sample.stale == "drive input: no new value"
    assert one.axis.counters["out_of_range"] > 10


def test_an_input_that_falls_silent_is_named_while_the_drive_answers_on():
    one = bench().armed()
    replaced(one)
    one.cycles(5)
    assert one.sample.enabled
    assert (one.sample.valid, one.sample.stale) == (False, "drive input: no new value")
    assert one.sample.missing == 4, "the answer to the SYNC before was there"


def test_every_pair_of_bytes_is_a_force_within_the_range_or_none():
    one = bench()
    one.axis.configure()
    one.cycles(5)
    counts = range(-32768, 32768, 33)
    replaced(one, *(struct.pack("<h", count) for count in counts))
    one.cycle()
    for count in counts:
        sample = one.cycle()
        assert sample.valid == (-9900 <= count <= 9900)
        if sample.valid:
            assert sample.force == pytest.approx(0.025 * count)


def test_half_a_frame_is_counted_and_gives_no_force():
    one = bench()
    one.axis.configure()
    one.cycles(5)
    replaced(one, b"\x01", b"\x02\x03\x04")
    one.cycles(3)
    assert not one.sample.valid
    assert one.axis.counters["wrong_length"] >= 2


def axis_with(force: object = "from drive input", **drive: object) -> CanopenConfig:
    """The rig's axis with another force, and other keys of its drive."""
    whole = RIG.axis.model_dump(exclude_unset=True)
    return CanopenConfig.model_validate(
        {**whole, "force": force, "drive": {**whole["drive"], **drive}}
    )


WIRED = RIG.axis.drive.force_input.model_dump(exclude_unset=True)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"force_input": None}, "force: from drive input needs drive.force_input"),
        ({"force": "from drive"}, "drive.force_input is only for force: from drive input"),
        ({"force_input": {**WIRED, "lowest": 9900}}, "lowest must be below highest"),
        (
            {"force_input": {**WIRED, "tpdo": {**WIRED["tpdo"], "number": 1}}},
            "the numbers of tpdo and force_input.tpdo must differ",
        ),
        (
            {"force_input": {**WIRED, "tpdo": {**WIRED["tpdo"], "transmission_type": 255}}},
            "drive: a sample must answer a SYNC: transmission_type of TPDO 2 is 1",
        ),
    ],
)
def test_an_input_that_cannot_be_is_refused(changes, words):
    axis_with()
    with pytest.raises(ValidationError, match=words):
        axis_with(**changes)


def test_check_refuses_an_input_that_cannot_see_the_largest_force():
    def findings(highest):
        wired = RIG.axis.drive.force_input.model_copy(update={"highest": highest})
        drive = RIG.axis.drive.model_copy(update={"force_input": wired})
        rig = RIG.model_copy(update={"axis": RIG.axis.model_copy(update={"drive": drive})})
        return [one for one in check_rig(rig) if one.where == "axis.drive.force_input"]

    (fits,), (ends_early,) = findings(4800), findings(4790)
    assert fits.severity == "ok"
    assert ends_early.severity == "error"
    assert "measures -247.5 to 119.75 N, and force_max is 120 N" in ends_early.what


def test_the_load_of_the_bus_and_the_doctor_know_the_input_s_frame():
    assert frame_names(RIG.axis)[INPUT_ID] == "TPDO2 of the drive"
    (load,) = (one.what for one in check_rig(RIG) if one.where == "axis.bus")
    without = RIG.axis.model_copy(
        update={"drive": RIG.axis.drive.model_copy(update={"force_input": None})}
    )
    (less,) = (
        one.what
        for one in check_rig(RIG.model_copy(update={"axis": without}))
        if one.where == "axis.bus"
    )
    # A frame of two bytes is 75 bits at worst, 7.5 % of 1 Mbit/s at 1 kHz.
    assert int(load.split(" %")[0]) - int(less.split(" %")[0]) in {7, 8}


def test_weights_change_the_scale_of_the_input():
    fit = ForceFit(
        factor=1.1, offset=-0.5, noise=0.06, drift_per_s=0.0, largest_error=0.0, span=10.0
    )
    section = ("axis", "drive", "force_input")
    assert force_keys(RIG, fit) == {
        (*section, "scale_N_per_count"): pytest.approx(0.0275),
        (*section, "offset_N"): pytest.approx(-0.5),
        ("sensors", "force_noise_N"): 0.06,
    }
