"""The page `which adapter, which drive`, made from the rigs that ship."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import yaml

from teleop_rt_dev.paths import RIGS

HEADER = ("rig file", "drive", "sensors", "bus of the simulation", "rate", "what it is")
TEXT = """# Which adapter, which drive

Generated from the rigs that ship (`config/rigs`). Start from the one whose drive and sensors are
nearest to yours: `teleop-rt new mine --trial silicone_cube` copies a trial with its rig. On
hardware the same rig names another bus: `socketcan` for CAN adapters that Linux knows, `slcan` and
`gs_usb` for those on USB, a serial port by its path. [Adapters](../howto/adapters.md) compares
adapters on sale; `teleop-rt doctor` measures how a bus really behaves.

"""


def rows() -> Iterator[tuple[str, ...]]:
    """Give a row for each rig that ships."""
    for path in sorted(RIGS.glob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        rig = yaml.safe_load(text)
        axis = rig["axis"]
        parts = axis.get("parts", {})
        drive = (parts.get("drive") or parts.get("bus") or axis)["driver"]
        sensors = [f"{name}: {one['driver']}" for name, one in parts.items() if name == "sensor"]
        buses = sorted({_bus(one) for one in (axis, *parts.values())} - {""})
        yield (
            f"`{path.name}`",
            f"`{drive}`",
            ", ".join(sensors) or "of the same driver",
            ", ".join(buses) or "none",
            f"{rig['rate_hz']} Hz",
            _about(text),
        )


def _bus(part: dict[str, Any]) -> str:
    bus = part.get("bus") or {}
    if "interface" in bus:
        return f"CAN, {bus['interface']}"
    return "serial" if "port" in part or "port" in bus else ""


def _about(text: str) -> str:
    """Return the comment that a rig file begins with, its how-to as a link."""
    lines = [line[1:].strip() for line in text.splitlines() if line.startswith("#")]
    words = " ".join(line for line in lines if not line.startswith("yaml-language-server"))
    return re.sub(r"docs/howto/(\w+)\.md", r"[\1](../howto/\1.md)", words)
