"""The master's parts, sized by its config and the range of the axis."""

from __future__ import annotations

import math

from teleop_rt.config.master import MasterConfig
from teleop_rt.config.rig import Limits
from teleop_rt.master.adoption import Adoption
from teleop_rt.master.aim import Aim
from teleop_rt.master.device import HeldDevice
from teleop_rt.master.energy import PassivityObserver
from teleop_rt.master.leash import Leash
from teleop_rt.master.passivity import Port
from teleop_rt.master.provisional import Provisional
from teleop_rt.master.registration import PhantomWatch, Registration
from teleop_rt.master.rendered_effects import RenderedEffects
from teleop_rt.master.screening import Screening
from teleop_rt.master.tank import Tank
from teleop_rt.master.travel import TravelEnds
from teleop_rt.master.wall_intake import WallIntake
from teleop_rt.master.wall_limiter import WallLimiter

REFERENCE_SHARE = 0.05
"""The depth at which models are compared, as a share of the axis range."""
CLEARANCE_SHARE = 0.005
"""How near to a wall a vanishing offset may bring the slave, as a share of the axis range."""
FARTHEST_RANGES = 100.0
"""A state with a position further away than so many axis ranges is refused."""
NOTICEABLE_SHARE = 0.02
"""The force, as a share of the largest, that a phantom wall must reach to be withdrawn."""

TOUCH_SHARE = 0.01
"""The rise of the slave's force from which a first touch has a slope, as a share of the largest."""


def range_of(limits: Limits) -> float:
    """Return the length of the slave's axis."""
    return limits.position_max - limits.position_min


def make_adoption(config: MasterConfig) -> Adoption:
    """Return the adoption of walls with its tank, before the hand's scaling."""
    scale = config.force_scale / config.position_scale
    tank = Tank(config.tank_capacity_mJ * 1e-3 / scale, config.tank_power_mW * 1e-3 / scale)
    force_max = config.force_max / config.force_scale
    return Adoption(force_max, config.force_step / config.force_scale, tank)


def make_registration(config: MasterConfig, limits: Limits) -> Registration:
    """Return the offset between hand and slave."""
    return Registration(config.offset_speed, CLEARANCE_SHARE * range_of(limits))


def make_aim(config: MasterConfig, limits: Limits, dt_s: float) -> Aim:
    """Return the target of the slave."""
    return Aim(config.offset_speed, CLEARANCE_SHARE * range_of(limits), dt_s)


def make_screening(limits: Limits) -> Screening:
    """Return the checks that refuse impossible models and states."""
    axis_range = range_of(limits)
    reach = max(abs(limits.position_min), abs(limits.position_max)) + axis_range
    return Screening(REFERENCE_SHARE * axis_range, FARTHEST_RANGES * axis_range, reach)


def make_observer(
    config: MasterConfig, port: Port, period_s: float, *, damps: bool
) -> PassivityObserver:
    """Return the observer of the hand's energy."""
    capacity_J, allowance_W = config.tank_capacity_mJ * 1e-3, config.tank_power_mW * 1e-3
    return PassivityObserver(port.delay_s, period_s, capacity_J, allowance_W, damps=damps)


def make_brakes(
    config: MasterConfig, device: HeldDevice | None, grip: tuple[float, float], period_s: float
) -> tuple[Leash, TravelEnds]:
    """Return the leash, and the brake at the ends of the device's travel."""
    brake, scale = config.leash_force / config.force_scale, config.position_scale
    low, high = (-math.inf, math.inf) if device is None else device.watch.travel
    step = config.force_step / config.force_scale
    leash = Leash(1e-3 * config.leash_mm, brake, grip, period_s, step)
    return leash, TravelEnds((scale * low, scale * high), brake, grip, period_s)


def make_intake(
    config: MasterConfig,
    limits: Limits,
    adoption: Adoption,
    registration: Registration,
    limiter: WallLimiter,
    screening: Screening,
    effects: RenderedEffects,
) -> WallIntake:
    """Return the intake of models, with the first model of a touch and the watch for phantoms."""
    force_max = config.force_max / config.force_scale
    return WallIntake(
        adoption,
        registration,
        limiter,
        screening,
        effects,
        Provisional(force_max / range_of(limits), TOUCH_SHARE * force_max),
        PhantomWatch(NOTICEABLE_SHARE * force_max),
        refuses=config.on_violation == "refuse",
    )
