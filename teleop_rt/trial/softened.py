"""A tool that presses harder than is felt, in one line: a softened wall, or one not followed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from teleop_rt.config.section import Units
from teleop_rt.trial.grades import PEAK, POOR_NRMSE

FELT_WELL = 1.0 - PEAK * POOR_NRMSE
"""Share of the tool's force [1] from which a model that did not follow is no news: the largest
error of a force that is not graded bad leaves so much."""


def softened(master: Mapping[str, Any], units: Units) -> str | None:
    """Return how much of a stiff wall was felt; None where the newest was rendered as it is.

    `master` is that part of a summary. The stiffness that the device must bear is that of a quick
    touch, which the damping adds to: the share of the force is that of the moment itself.
    """
    if (values := _reduced(master, "stiffness")) is None:
        return None
    soft, stiff = values
    unit = f"{units.force}/{units.position}"
    said = (
        f"this device can render at most {soft} {unit} of the wall's {stiff} {unit}, its damping"
        " included: a stiffer wall would not be passive on it"
    )
    return _with_share(said, master, units)


def calmed(master: Mapping[str, Any], units: Units) -> str | None:
    """Return how much of a wall's damping was felt; None where the newest was rendered as it is.

    `master` is that part of a summary. The share of the force stands with the stiffness if that is
    reduced as well.
    """
    if (values := _reduced(master, "damping")) is None:
        return None
    calm, damped = values
    unit = f"{units.force} s/{units.position}"
    said = (
        f"this device can render at most {calm} {unit} of the wall's damping of {damped} {unit}:"
        " with more, beside its stiffness, the wall would not be passive on it"
    )
    return said if _reduced(master, "stiffness") else _with_share(said, master, units)


def _reduced(master: Mapping[str, Any], which: str) -> tuple[str, str] | None:
    """Return a property of the newest wall as rendered and as it is; None if they are the same."""
    passivity = (master.get("rendering") or {}).get("passivity")
    if not passivity or not passivity["stiffness"]["rendered"] > 0.0:
        return None
    rendered, true = passivity[which]["rendered"], passivity[which]["true"]
    if not rendered < true:
        return None
    return f"{float(f'{rendered:.3g}'):g}", f"{float(f'{true:.3g}'):g}"


def _with_share(said: str, master: Mapping[str, Any], units: Units) -> str:
    """Return a sentence behind the felt share of the force, if the bound is its cause."""
    unfelt = master.get("unfelt")
    if unfelt is None or unfelt.get("cause") not in {None, "bound"}:
        return said
    return f"{_pressed_and_felt(unfelt, units)}; {said}"


def unfollowed(master: Mapping[str, Any], units: Units) -> str | None:
    """Return that the tool met the body where the rendered model had it not; None if it did not.

    `master` is that part of a summary.
    """
    unfelt = master.get("unfelt")
    if unfelt is None or unfelt.get("cause") != "model" or not unfelt["share"] < FELT_WELL:
        return None
    small = "mm" if units.position == "m" else "mrad"
    tool, surface = (f"{1e3 * unfelt[key]:.4g} {small}" for key in ("tool", "surface"))
    if unfelt["tool"] <= unfelt["surface"]:
        why = f"the tool met the body at {tool}, before the rendered surface at {surface}"
    else:
        why = f"the model rendered then has its surface at {surface}, and gives at most "
        why += f"{unfelt['modelled']:.3g} {units.force} at {tool}, where the tool was"
    why += ": if the surface moves, "
    if unfelt["tracking_hz"]:
        why += f"contact.surface_tracking_hz {unfelt['tracking_hz']:g} did not follow it"
    else:
        why += "set contact.surface_tracking_hz, for at 0 none is followed"
    return f"{_pressed_and_felt(unfelt, units)}; {why}"


def _pressed_and_felt(unfelt: Mapping[str, Any], units: Units) -> str:
    return (
        f"at {unfelt['at_s']:.1f} s the tool pressed with {unfelt['pressed']:.3g} {units.force} "
        f"and the hand felt {unfelt['felt']:.3g} {units.force}, {unfelt['share']:.0%} of it"
    )
