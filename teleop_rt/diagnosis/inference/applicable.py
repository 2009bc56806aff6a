"""The effects that are possible on a rig and with a base."""

from __future__ import annotations

from teleop_rt.contact.effect import OF_THE_SPRING, Effect
from teleop_rt.contact.effects.disturbance import SEEN_IN_AIR, WITH_HARMONICS
from teleop_rt.contact.effects.friction import UNDER_LOAD
from teleop_rt.contact.effects.joints import BEFORE_A_SPRING, BEYOND_THE_MASS
from teleop_rt.contact.effects.return_spring import BESIDE_A_BODY, RETURN_SPRING
from teleop_rt.contact.effects.sensor import AT_TWO_ENDS
from teleop_rt.contact.effects.swinging import ON_ITS_SPRING
from teleop_rt.contact.effects.tool import LINKAGE_BESIDE_A_SPRING, THROUGH_A_LINKAGE
from teleop_rt.diagnosis.models.base import Base
from teleop_rt.diagnosis.samples.outliers import OUTLIERS
from teleop_rt.diagnosis.samples.range_end import reads_an_end
from teleop_rt.recordings.recording import Recording

_BY_DIRECTION = "backward_ratio"  # shape of friction by direction
_SURFACE_SHIFTS = {
    ("contact_offset", ""),
    ("backlash", "from the loading flank"),
    ("backlash", "from the unloading flank"),
}
_IN_AIR = (BESIDE_A_BODY, THROUGH_A_LINKAGE)


def applicable(
    effects: tuple[Effect, ...], recording: Recording, base: Base, *, pressed: bool = False
) -> tuple[Effect, ...]:
    """Return the effects that are possible on this rig and with this base.

    Outliers are tested separately. A body that is `pressed` all along shows no free air, without
    which a tone as slow as the motion is not distinguished from friction.
    """
    rotary = recording.units[0] == "rad"
    at_end = reads_an_end(recording)
    laws = {(effect.name, effect.law) for effect in effects}

    def possible(effect: Effect) -> bool:
        if effect.name == OUTLIERS or (effect.law == AT_TWO_ENDS and not at_end):
            return False
        if (effect.name, SEEN_IN_AIR) in laws:
            return _shows_tone(effect, base, in_air=not pressed)
        if effect.name in {"gravity_torque", RETURN_SPRING}:
            return _pulls_the_axis(effect, base, rotary=rotary, in_air=not pressed)
        if _is_in_base(effect, base, pressed) or _is_of_another_spring(effect, base, laws):
            return False
        if effect.without_contact:
            held = base.has_spring or not _is_of_a_spring(effect)
            return held and not base.touches
        material = effect.belongs_to == "environment" or effect.only_in_contact
        loaded = effect.acts == "deflects" or effect.law.endswith(UNDER_LOAD)
        return base.touches or not (material or loaded)

    return tuple(effect for effect in effects if possible(effect))


def _shows_tone(effect: Effect, base: Base, *, in_air: bool) -> bool:
    """Return whether a law of a tone is possible; one as slow as the motion shows `in_air` alone.

    Without contact the harmonics of a periodic motion would take the forces of other effects.
    """
    seen = effect.law.startswith(SEEN_IN_AIR) == (base.touches and in_air)
    return seen and (base.touches or not effect.law.endswith(WITH_HARMONICS))


def _is_of_another_spring(effect: Effect, base: Base, laws: set[tuple[str, str]]) -> bool:
    """Return whether the effect follows a spring that the base does not have.

    `laws` are the names and laws of all effects. The elastic force of a base with a power is that
    power of the depth, of any other base the depth itself.
    """
    if effect.law.endswith(OF_THE_SPRING):
        return not base.has_power
    return base.has_power and (effect.name, f"{effect.law} {OF_THE_SPRING}".lstrip()) in laws


def _is_in_base(effect: Effect, base: Base, pressed: bool) -> bool:
    """Return whether a parameter of the base covers the effect.

    An estimated surface covers an offset and the flank of a play. Friction by direction equals
    symmetric friction and a bias (only a rest separates them); so does the surface of a body that
    is `pressed` all along. A base with a power has a damping that grows with the depth. Without a
    mass, a play beyond it is any play.
    """
    if base.finds_surface and (effect.name, effect.law) in _SURFACE_SHIFTS:
        return True
    if base.has_power and effect.name == "hunt_crossley":
        return True
    if effect.name == "tool_inertia" and effect.law != ON_ITS_SPRING:
        return base.moves_mass
    if effect.law == BEYOND_THE_MASS and not base.has_mass:
        return True
    shifts = base.has_bias or (pressed and base.finds_surface and not base.has_power)
    return shifts and any(shape.name == _BY_DIRECTION for shape in effect.shapes)


def _is_of_a_spring(effect: Effect) -> bool:
    of_material = effect.family in {"relaxation", "stiffening"} or effect.name == "softening"
    return of_material or effect.law == BEFORE_A_SPRING


def _pulls_the_axis(effect: Effect, base: Base, *, rotary: bool, in_air: bool) -> bool:
    """Return whether a weight or a spring that pulls the axis itself is possible.

    Gravity of a lever needs a rotary rig. Beside a body that is touched, `in_air` shows both.
    Without contact they need a drive that has a bias, for which they would stand in, and no
    spring, but for a weight on a linkage that turns far: between them the data choose.
    """
    if effect.name == "gravity_torque" and rotary == effect.law.startswith(THROUGH_A_LINKAGE):
        return False
    if effect.name == "gravity_torque" and rotary:
        return True
    beside_a_spring = effect.law == LINKAGE_BESIDE_A_SPRING
    if base.touches:
        return in_air and effect.law.startswith(_IN_AIR) and not beside_a_spring
    if not base.has_bias or effect.law.startswith(BESIDE_A_BODY):
        return False
    return beside_a_spring == base.has_spring
