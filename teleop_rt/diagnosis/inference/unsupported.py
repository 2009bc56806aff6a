"""Names that a fitted law does not support: a shape at a bound, or a property without evidence."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Shape
from teleop_rt.contact.effects.sensor import range_of
from teleop_rt.contact.effects.stiffening import SPRING_POWER
from teleop_rt.diagnosis.criteria import SAME_SHARE, SIGMAS
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.model import bounds, in_units
from teleop_rt.diagnosis.noise.structure import at_bounds
from teleop_rt.recordings.rows import force_noise

_SPRINGS_OWN = 0.5  # of a law's gain, that it keeps with the power of the base's spring
BEYOND = 1.05  # times half the range of a saturation; one reading in a hundred may exceed it


def unsupported(problem: Problem, base: Fit, fit: Fit) -> frozenset[str]:
    """Return the effects whose names the data do not support, although their laws predict."""
    return at_wrong_bound(problem, fit) | lacks_named_property(problem, base, fit)


def lacks_named_property(problem: Problem, base: Fit, fit: Fit) -> frozenset[str]:
    """Return the effects whose laws fit as well without the property in their names.

    They do if a shape at its neutral value costs less than `SAME_SHARE` of the gain: a damping by
    direction with equal directions, or an attraction never observed beyond the surface. A force
    measured beyond a saturation level is not saturated. A share of the base's spring, or of a
    linear one, rises no more steeply than that: otherwise it is a spring of its own.
    """
    found = _read_beyond_range(problem, fit)
    for place, coordinate in enumerate(fit.model.coordinates):
        shape = coordinate.shape
        if isinstance(shape, Shape) and shape.neutral is not None:
            neutral = in_units(shape.neutral, shape, problem.motion.scales)
            if _lost(problem, fit, place, neutral) < SAME_SHARE * (base.chi2 - fit.chi2):
                found |= {fit.names[coordinate.owner]}
        if shape is SPRING_POWER and fit.zeta[place] > fit.zeta[0]:
            lost = _lost(problem, fit, place, float(fit.zeta[0]))
            if lost > (1.0 - _SPRINGS_OWN) * (base.chi2 - fit.chi2):
                found |= {fit.names[coordinate.owner]}
    return found


def _lost(problem: Problem, fit: Fit, place: int, value: float) -> float:
    """Return the rise of chi-square where a nonlinear parameter has another value."""
    zeta = fit.zeta.copy()
    zeta[place] = value
    return problem.solve(fit.model, zeta, fit.theta).chi2 - fit.chi2


def at_wrong_bound(problem: Problem, fit: Fit) -> frozenset[str]:
    """Return the effects of which a shape lies at a bound that is not its ideal one."""
    found = frozenset[str]()
    limits = [bounds(c.shape, problem.motion.scales) for c in fit.model.coordinates]
    at_bound = at_bounds(problem, fit)
    for c, value, (low, high), bound in zip(
        fit.model.coordinates, fit.zeta, limits, at_bound, strict=True
    ):
        end = "lower" if value - low < high - value else "upper"
        ideal = isinstance(c.shape, Shape) and c.shape.ideal == end
        if bound and c.owner >= 0 and not ideal:
            found |= {fit.names[c.owner]}
    return found


def _read_beyond_range(problem: Problem, fit: Fit) -> frozenset[str]:
    """Return the effects that limit the force to a range which the measured one exceeds."""
    course = Course.of(fit.model, problem.motion, fit.zeta)
    ranges = {
        effect.name: range_of(effect, eta)
        for effect, (_, eta) in zip(fit.model.effects, course.parameters, strict=True)
        if effect.acts == "limits_force"
    }
    force = problem.force[problem.whitener.mask > 0.0]
    noise = SIGMAS * force_noise(problem.force, problem.force_step) if ranges else 0.0
    return frozenset(
        name
        for name, (middle, half) in ranges.items()
        if float(np.quantile(np.abs(force - middle), 0.99)) - noise > BEYOND * half
    )
