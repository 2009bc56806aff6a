"""The results of a calibration as people read them: in words, with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from teleop_rt.config.parameter_words import shown_unit
from teleop_rt.config.section import Units

WORDS = {
    "factor": ("correction factor for the scale in the file", ""),
    "offset": ("offset", "{f}"),
    "noise": ("noise", "{f}"),
    "drift_per_s": ("drift", "{f}/s"),
    "largest_error": ("largest error of a weight", "{f}"),
    "span": ("span of the weights", "{f}"),
    "linearity": ("largest error as a share of the span", ""),
    "lag_ms": ("lag", "ms"),
    "torque_lag_ms": ("lag of the torque", "ms"),
    "deviation_ms": ("standard deviation of the lag", "ms"),
    "stiffness": ("stiffness", "{f}/{x}"),
    "mass": ("mass", "{f} s^2/{x}"),
    "damping": ("damping", "{f} s/{x}"),
    "coulomb_friction": ("dry friction", "{f}"),
    "latency_s": ("latency", "s"),
    "mass_deviation": ("standard deviation of the mass", "{f} s^2/{x}"),
    "damping_deviation": ("standard deviation of the damping", "{f} s/{x}"),
    "friction_deviation": ("standard deviation of the friction", "{f}"),
    "latency_deviation_s": ("standard deviation of the latency", "s"),
    "left_share": ("share of the push left unexplained", ""),
}
"""Words and unit of each result; `unit` itself is in all of them."""
OF_DEVICE = (
    "two values in the rig's file differ from these: its damping is the least that the motion"
    " allows, because the passivity bound relies on it, and its latency is that of the device"
    " alone, because the driver adds that of bus and frames"
)


def lines(
    results: Mapping[str, Any], units: Units, own_units: Mapping[str, str] | None = None
) -> Iterator[str]:
    """Give a line per result, in columns; `own_units` are those of results without words here."""
    own = own_units or {}
    shown = {
        name: WORDS.get(name, (name.replace("_", " ").replace(".", ": "), own.get(name, "")))
        for name in results
        if name != "unit"
    }
    width = max(len(words) for words, _ in shown.values())
    for name, (words, unit) in shown.items():
        value = results[name]
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        in_units = unit.replace("{f}", units.force).replace("{x}", units.position)
        yield f"{words:{width}}  {text} {shown_unit(in_units)}".removesuffix(" 1").rstrip()
