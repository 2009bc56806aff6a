"""The rows of the bank: every allowed model x regression x solver, described by data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.models import MODELS, ContactModel, DeclaredParameter
from teleop_rt.estimation.layout import WHOLE, Whole
from teleop_rt.ids import REGRESSIONS, SOLVERS

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
FROZEN_LABEL = "-with-frozen-effects"
OFFSET = DeclaredParameter("offset", "{f}")


@dataclass(frozen=True, slots=True)
class RowSpec:
    """One estimator: its model, its regression, its solver.

    `effects` are additive terms beyond the model, estimated in multiples of `scales` (1 unless
    given), so that their regressors are forces; `parameters` names the estimated ones, the model's
    own first; a free `offset` joins the linear models while the surface is unknown. `frozen`
    effects keep their initial values instead of being estimated, so that a row is ready before
    the data can distinguish an effect from the model.
    """

    model: str
    regression: str
    solver: str
    effects: tuple[Effect, ...] = ()
    scales: tuple[float, ...] = ()
    frozen: bool = False

    @property
    def declared(self) -> ContactModel:
        """The model's declaration."""
        return MODELS[self.model]

    @property
    def parameters(self) -> tuple[DeclaredParameter, ...]:
        """Names and units of the parameters, the model's own first, then the effects'."""
        effects = () if self.frozen else self.effects
        added = tuple(DeclaredParameter(e.name, e.amplitude.unit) for e in effects)
        return self.declared.parameters + added

    @property
    def effects_are(self) -> str | None:
        """How the row takes effects: `estimated`, `frozen`, or None without any."""
        if not self.effects:
            return None
        return "frozen" if self.frozen else "estimated"

    @property
    def label(self) -> tuple[str, str, str]:
        """Model, regression and solver, which identify the row in a recording."""
        solver = self.solver + (FROZEN_LABEL if self.frozen else "")
        return self.model, self.regression, solver

    def scale_of_effect(self, name: str) -> float | None:
        """Return the scale of an effect of this row by its name, None for a parameter."""
        for index, effect in enumerate(self.effects):
            if effect.name == name:
                return self.scales[index] if self.scales else 1.0
        return None

    @property
    def linear(self) -> bool:
        """Whether the parameters enter the regression linearly, so that terms can be added."""
        return self.declared.linear


def allowed(model: str, regression: str) -> bool:
    """Return whether a model has this regression.

    Unilateral damping has no closed algebraic form; the report gives none for a mass-damper.
    """
    return regression == "direct" or model not in {"kelvin-voigt-unilateral", "mass-damper"}


def whole_for(rows: Iterable[RowSpec]) -> Whole:
    """Return the parts of the kernels that a bank of these rows needs: see `layout.Whole`."""
    plain = all(
        row.regression == "direct" and row.solver == "rls" and not row.effects for row in rows
    )
    return None if plain else WHOLE


def _meant(name: str, known: Iterable[str]) -> str:
    """Return the name that was probably meant, else all that there are."""
    names = list(known)
    near = get_close_matches(name, names, n=1)
    return f"did you mean {near[0]!r}?" if near else f"one of: {', '.join(names)}"


def rows_for(
    models: Iterable[str],
    regressions: Iterable[str] = REGRESSIONS,
    solvers: Iterable[str] = SOLVERS,
    effects: tuple[Effect, ...] = (),
    scales: tuple[float, ...] = (),
) -> list[RowSpec]:
    """Return every allowed combination, in the order given.

    Raises ValueError for unknown names, each on a line, or when nothing allowed is left.
    """
    unknown = []
    chosen = (tuple(models), tuple(regressions), tuple(solvers))
    for names, known, kind in zip(
        chosen,
        (tuple(MODELS), REGRESSIONS, SOLVERS),
        ("model", "regression", "solver"),
        strict=True,
    ):
        unknown += [
            f"unknown {kind} {name!r}; {_meant(name, known)}" for name in names if name not in known
        ]
    if unknown:
        raise ValueError("\n".join(unknown))
    rows = [
        RowSpec(model, regression, solver, effects, scales)
        for model in chosen[0]
        for regression in chosen[1]
        if allowed(model, regression)
        for solver in chosen[2]
    ]
    if not rows:
        raise ValueError("no allowed combination of model, regression and solver is left")
    return rows
