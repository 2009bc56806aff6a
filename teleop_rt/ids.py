"""Ids that commands and files accept, without importing the slow modules behind them."""

from __future__ import annotations

from typing import Literal, get_args

RegressionId = Literal["direct", "algebraic"]
SolverId = Literal["rls", "sprls", "ni-sprls", "gn-vff-rls", "iec"]
REGRESSIONS: tuple[RegressionId, ...] = get_args(RegressionId)
SOLVERS: tuple[SolverId, ...] = get_args(SolverId)
MODEL_IDS = (
    "mass",
    "mass-damper",
    "kelvin-voigt",
    "kelvin-voigt-unilateral",
    "mass-spring-damper",
    "hunt-crossley",
)
TERM_IDS = (
    "stiffness",
    "damping",
    "unilateral-damping",
    "contact-mass",
    "power-stiffness",
    "power-damping",
    "spring",
    "mass",
    "viscous",
    "bias",
)
"""Terms of which a base model for diagnosis can be put together."""
