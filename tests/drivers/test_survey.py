"""`doctor` on a CANopen bus: who is there, and whether the data sheets are true."""

from __future__ import annotations

import can
from canopen.sdo.exceptions import SdoAbortedError
from framed_bench import FramedBench, load

from teleop_rt_drivers.canopen.survey import survey


def surveyed(rig, bench):
    return survey(rig.axis, bench.ends.bus_pair("")[0], lambda: bench.now)


def test_the_survey_names_every_node_and_finds_its_eds_true():
    rig = load("canopen")
    findings = surveyed(rig, FramedBench(rig))
    assert [finding.severity for finding in findings] == ["ok"] * 6
    said = [finding.what for finding in findings]
    assert said[0] == ("node 0x10 (encoder) answers: vendor 0x543, product 0x406, revision 0x10000")
    assert any("node 0x30 (drive) has all" in what for what in said)


def test_the_survey_finds_an_unlisted_and_a_silent_node():
    rig = load("canopen")
    moved = rig.axis.force.model_copy(update={"node_id": 0x22})
    elsewhere = rig.model_copy(update={"axis": rig.axis.model_copy(update={"force": moved})})
    findings = surveyed(rig, FramedBench(elsewhere))
    bad = {finding.what: finding for finding in findings if finding.severity != "ok"}
    assert "node 0x20 (force sensor) does not answer" in bad
    unlisted = "node 0x22 answers and is not one of the rig's: vendor 0x543, product 0x404"
    assert any(what.startswith(unlisted) for what in bad)
    assert all(finding.next_step for finding in bad.values())


def test_the_survey_finds_a_device_that_is_not_what_its_eds_says():
    rig = load("canopen")
    bench = FramedBench(rig)
    device = bench.simulated.devices["encoder"]
    read = device.get_data

    def other(index, subindex, check_readable=False):
        if index == 0x6503:
            raise SdoAbortedError(0x06020000)
        if (index, subindex) == (0x1018, 3):
            return b"\x02\0\0\0"
        return b"\0\0" if index == 0x6004 else read(index, subindex, check_readable)

    device.get_data = other
    (found,) = (f for f in surveyed(rig, bench) if f.severity == "error")
    assert "differs from its EDS in 3 of" in found.what
    for part in ("1018h:3 is 2, not 65536", "6004h:0 has 16 bits, not 32", "6503h:0 ("):
        assert part in found.what


def test_the_survey_asks_nothing_where_another_master_is():
    rig = load("canopen")
    bench = FramedBench(rig)
    daemon_end, device_end = bench.ends.bus_pair("")
    asked = []
    device_end.deliver = asked.append
    daemon_end.deliver(can.Message(arbitration_id=0x80, is_extended_id=False))
    (found,) = surveyed(rig, bench)
    assert "another master" in found.what
    assert asked == []
