"""Another base that predicts as well with fewer effects: the stated one may be the wrong one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from teleop_rt.diagnosis.criteria import LEAST_GAIN
from teleop_rt.diagnosis.inference.inner_blocks import blind_energy
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.inference.search import fit_base, with_other_clamp
from teleop_rt.diagnosis.models.base import MODELS, Base, base_of
from teleop_rt.diagnosis.models.fit import Fit, Problem


def other_base(found: Diagnosis) -> str | None:
    """Return a note on a base with as many parameters that needs fewer effects, if there is one.

    Its energy on inner blocks is at most that of the stated base with all effects. A damping that
    acts in both directions looks like several effects beside a base that damps only in one.
    """
    problem, best = found.problem, found.predicts
    if not best.names:
        return None
    most = blind_energy(problem, best) / (1.0 - LEAST_GAIN)
    for other in _as_simple(best.model.base):
        for fit in _with_fewer(problem, best, other):
            if blind_energy(problem, fit) <= most:
                beside = f"with {fit.names[0]}" if fit.names else "without any effect"
                return (
                    f"the base {other.name} {beside} predicts this force as well as"
                    f" {best.model.base.name} with {', '.join(best.names)}: if that base describes"
                    f" the object, repeat with --base {other.name}"
                )
    return None


def _as_simple(base: Base) -> Iterator[Base]:
    """Yield the other declared bases of contact with as many parameters."""
    for name in MODELS:
        other = replace(base_of(name), finds_surface=base.finds_surface)
        alike = (other.touches, other.has_power, len(other.terms)) == (
            base.touches, base.has_power, len(base.terms)
        )  # fmt: skip
        if base.touches and alike and other.terms != base.terms:
            yield other


def _with_fewer(problem: Problem, best: Fit, other: Base) -> Iterator[Fit]:
    """Yield fits of another base alone, then with each effect of a set of several."""
    alone = fit_base(problem, other)
    yield alone
    for member, effect in enumerate(best.model.effects if len(best.names) > 1 else ()):
        model = replace(best.model, base=other, effects=(effect,), past="none")
        kept = [i for i, c in enumerate(best.model.coordinates) if c.owner in {-1, member}]
        yield with_other_clamp(problem, problem.refine(model, best.zeta[kept]))
