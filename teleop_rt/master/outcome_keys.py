"""The keys of the master's account of a trial, as `outcome` makes it."""

from __future__ import annotations

from typing import Literal

from teleop_rt.json_schema import Keys


class Engagements(Keys):
    """How often master and slave were coupled and parted."""

    engagements: int
    """How often the master engaged."""
    freezes: int
    """How often silence on the link froze the master's target."""
    declutches: int
    """How often the master let the force fade after a longer silence."""


class TrueAndRendered(Keys):
    """A property of the wall, as estimated and as rendered."""

    true: float
    """As estimated, in the hand's units."""
    rendered: float
    """As rendered, in the hand's units."""


class Passivity(Keys):
    """Limits of the passivity bound, and the energy observed at the hand's port."""

    stiffness: TrueAndRendered
    """Largest local stiffness [N/m or Nm/rad]."""
    damping: TrueAndRendered
    """Largest local damping [N s/m or Nm s/rad]."""
    stiffness_max: float
    """Largest stiffness that the device renders passively [N/m or Nm/rad]."""
    required_damping: float
    """Damping that the device must have for the wall [N s/m or Nm s/rad]."""
    reduced: bool
    """Whether the wall was rendered softer or less damped than it is."""
    energy_min_J: float
    """Least energy that had flowed in through the port [J]."""
    epsilon_J: float
    """Energy that sampling alone may make [J]."""
    missing_J: float
    """Energy that a contact gave the hand beyond the tank's [J]."""
    injected_J: float
    """Energy that the rendering injected [J]."""
    surface_J: float
    """Work that a surface that moves by itself did on the hand [J]."""


class AdoptionCost(Keys):
    """Cost of changes of the rendered model."""

    largest_force_step: float
    """Largest step of force at a change, at the hand [N or Nm]."""
    energy_J: float
    """Energy that changes injected, at the hand [J]."""
    tank_J: float
    """Energy left for further changes, at the hand [J]."""


class DeviceFault(Keys):
    """The fault of the operator's device."""

    code: int
    """Number of the fault, 0 for none."""
    name: str
    """Name of the fault, `none` without one."""
    cause: str
    """Its cause, as a sentence."""
    next_step: str
    """The next step, as a sentence."""


class HandleActions(Keys):
    """Actions of leash, watch and safety chain of the operator's device."""

    fault: DeviceFault
    """The fault in which the device ended."""
    unsafe: list[str]
    """Protections that the device lacks, in sentences; shown in red."""
    boundings: int
    """Number of times that energy was bounded because swings grew or lasted."""
    softenings: int
    """How often walls were made softer because the device oscillated."""
    longest_lead: float
    """How far the hand led the slave at most [rig's position unit]."""
    leash_slipped: bool
    """Whether the hand pushed through the leash."""
    largest_leash_force: float
    """Largest force with which the leash held the hand back [N or Nm]; 0 where it never did."""
    withheld_at_ends: float
    """Motion near the ends of the device's travel that the slave did not get [rig's unit]."""


class Mass(Keys):
    """The environment's mass, which is not rendered."""

    estimated: float
    """As estimated [N s^2/m or Nm s^2/rad]."""
    rendered: float
    """As rendered [N s^2/m or Nm s^2/rad]."""
    reason: str
    """Why it is rendered as it is."""


class Rendering(Keys):
    """The master's own account of its rendering."""

    state: Literal["WAITING", "ENGAGED", "FROZEN", "DECLUTCHED"]
    """How the master was coupled at the end."""
    engagement: Engagements
    """How often the coupling began, froze and ended."""
    passivity: Passivity
    """Limits of the passivity bound, and the energy observed."""
    adoption: AdoptionCost
    """Force steps and energy at changes of the rendered model."""
    handle: HandleActions
    """Events of the operator's device."""
    mass: Mass | None
    """The environment's mass; null where no model was rendered."""
    refused_models: dict[str, int]
    """How many streamed models were refused, by reason."""
    clamped_damping: int
    """How many models had a damping below 0, or an exponent outside of 1 to 5, moved there."""
    refused_walls: int
    """How many walls were refused."""
    withdrawn_walls: int
    """How many walls were withdrawn."""
