"""Whether a fitted law shows what its name says, or fits as well without."""

from __future__ import annotations

from teleop_rt.contact.effect import Shape
from teleop_rt.diagnosis.inference.verdict import SAME_SHARE
from teleop_rt.diagnosis.models.fit import Fit, Problem


def hollow(problem: Problem, base: Fit, fit: Fit) -> bool:
    """Return whether a shape at its neutral value costs less than what is worth a distinction.

    So a damping of equal directions, and an attraction that is seen nowhere beyond the surface.
    """
    for place, coordinate in enumerate(fit.model.coordinates):
        shape = coordinate.shape
        if isinstance(shape, Shape) and shape.neutral is not None:
            zeta = fit.zeta.copy()
            zeta[place] = shape.neutral * problem.motion.scales[shape.relative_to]
            lost = problem.solve(fit.model, zeta, fit.theta).chi2 - fit.chi2
            if lost < SAME_SHARE * (base.chi2 - fit.chi2):
                return True
    return False
