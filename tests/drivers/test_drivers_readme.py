"""The worked example of drivers/README.md, as it is printed there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from framed_bench import MS, FramedBench, edited

from teleop_rt.axis import AxisError
from teleop_rt_drivers.simulated import serial_network

README = Path(__file__).parents[2] / "drivers" / "README.md"
FORMAT, RIG = re.findall(r"```yaml\n(.*?)```", README.read_text(), re.DOTALL)


def example(tmp_path, *changes):
    path = tmp_path / "my_cell.yaml"
    path.write_text(FORMAT)
    port, force = RIG.split("force:\n")
    cell = port.split("\n")[1].replace("my_cell.yaml", str(path))
    return edited(
        "serial",
        tmp_path,
        ("    wrench: {device: wrench, baud: 460800, format: wrench_crc16}", "  " + cell),
        ("    source: wrench\n", ""),
        ("    field: fz                    # already in newton\n", ""),
        ("    status: {field: status, good: 0}\n    clock: {field: stamp, tick_s: 1.0e-6}\n", ""),
        ("  force:\n", "  force:\n" + "".join(f"  {line}\n" for line in force.split("\n") if line)),
        *changes,
    )


def bench_with_cell(rig, monkeypatch) -> FramedBench:
    """A rig whose force sensor is a load cell that the simulator does not know."""

    def encoder(plant):
        return lambda _: f"ST,GS,{plant.force / 9.80665:+08.3f}kg\r\n".encode()

    device = serial_network._sensor("force sensor", encoder, b"\r\n")
    monkeypatch.setitem(serial_network.SIMULATED, rig.axis.ports["cell"].format, device)
    return FramedBench(rig)


def test_the_example_measures_force(tmp_path, monkeypatch):
    bench = bench_with_cell(example(tmp_path), monkeypatch).armed()
    for k in range(400):
        bench.cycle(min(k * 1e-4, 0.014))
    assert bench.sample.valid
    assert bench.simulated.plant.force > 10.0
    assert bench.sample.force == pytest.approx(bench.simulated.plant.force, abs=0.006)
    bench.simulated.inject("mute", "force sensor")
    assert bench.cycles(490).fault.name == "NONE"
    assert bench.cycles(30).fault.name == "DEVICE_LOST"
    assert bench.now > 400 * MS


def test_without_the_conversion_the_example_is_refused(tmp_path, monkeypatch):
    rig = example(tmp_path, ("    scale_N_per_unit: 9.80665\n", ""))
    with pytest.raises(AxisError, match=r"'kg', the rig in 'N': write force.scale_N_per_unit"):
        bench_with_cell(rig, monkeypatch)
