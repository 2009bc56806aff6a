"""The rows of the bank: every allowed model x regression x solver, described by data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.models import MODELS, Model, Parameter

REGRESSIONS = ("direct", "algebraic")
SOLVERS = ("rls", "sprls", "ni-sprls", "gn-vff-rls", "iec")
# The codes that kernels know the models by.
MASS, MASS_DAMPER, KELVIN_VOIGT, UNILATERAL, MASS_SPRING_DAMPER, HUNT_CROSSLEY = range(6)
# The row beside Hunt-Crossley's that fits additive effects at a fixed exponent.
COMPANION = 6
MODEL_CODES = {
    "mass": MASS,
    "mass-damper": MASS_DAMPER,
    "kelvin-voigt": KELVIN_VOIGT,
    "kelvin-voigt-unilateral": UNILATERAL,
    "mass-spring-damper": MASS_SPRING_DAMPER,
    "hunt-crossley": HUNT_CROSSLEY,
}
OFFSET = Parameter("offset", "{f}")


@dataclass(frozen=True, slots=True)
class RowSpec:
    """One estimator: what it fits, on which regression, by which solver.

    `effects` are additive terms beyond the model; `parameters` names what is estimated, the
    model's own first; a free `offset` joins the linear models while the surface is unknown.
    """

    model: str
    regression: str
    solver: str
    effects: tuple[Effect, ...] = ()

    @property
    def declared(self) -> Model:
        """The model's declaration."""
        return MODELS[self.model]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Names and units of the parameters, the model's own first, then the effects'."""
        added = tuple(Parameter(e.name, e.amplitude.unit) for e in self.effects)
        return self.declared.parameters + added

    @property
    def linear(self) -> bool:
        """Whether the parameters enter the regression linearly, so that terms can be added."""
        return self.declared.linear


def allowed(model: str, regression: str) -> bool:
    """Tell whether a model has this regression.

    Unilateral damping has no closed algebraic form; the report gives none for a mass-damper.
    """
    return regression == "direct" or model not in {"kelvin-voigt-unilateral", "mass-damper"}


def rows_for(
    models: Iterable[str],
    regressions: Iterable[str] = REGRESSIONS,
    solvers: Iterable[str] = SOLVERS,
    effects: tuple[Effect, ...] = (),
) -> list[RowSpec]:
    """Return every allowed combination, in the order given.

    Raises ValueError for an unknown name, or when nothing allowed is left.
    """
    chosen = (tuple(models), tuple(regressions), tuple(solvers))
    for names, known, kind in zip(
        chosen,
        (tuple(MODELS), REGRESSIONS, SOLVERS),
        ("model", "regression", "solver"),
        strict=True,
    ):
        for name in names:
            if name not in known:
                raise ValueError(f"unknown {kind} {name!r}; one of: {', '.join(known)}")
    rows = [
        RowSpec(model, regression, solver, effects)
        for model in chosen[0]
        for regression in chosen[1]
        if allowed(model, regression)
        for solver in chosen[2]
    ]
    if not rows:
        raise ValueError("no allowed combination of model, regression and solver is left")
    return rows
