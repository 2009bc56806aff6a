"""The keys of a report of the estimators, as `report` makes it; see `teleop_rt.json_schema`."""

from __future__ import annotations

from typing import Literal, NotRequired

from teleop_rt.json_schema import Keys


class EstimatedParameter(Keys):
    """A parameter of an estimator."""

    value: float | None
    """The estimate, in `unit`; null before there is one."""
    std: float | None
    """Standard deviation of the estimate, in `unit`; null where the estimator gives none."""
    unit: str
    """Unit of value and std."""
    identified: NotRequired[bool]
    """Whether a stiffness, damping, mass or exponent is above zero by two standard deviations;
    absent where there is no standard deviation, unless it is negative."""
    at_depth: NotRequired[float]
    """Largest depth that was reached [m or rad]; beside the size of a law with x^n only."""
    value_at_depth: NotRequired[float]
    """The size times x^n there, in `unit_at_depth`: of a spring the force."""
    unit_at_depth: NotRequired[str]
    """Unit of value_at_depth."""


class SelectedEstimator(Keys):
    """The estimator that was selected to be rendered."""

    model: str
    """Contact model, for example kelvin-voigt."""
    regression: str
    """Form of the regression: direct, filtered or another."""
    solver: str
    """Solver of the regression, for example rls."""
    effects: Literal["estimated", "frozen"] | None
    """How the effects of an extended model are taken; null for a model without effects."""
    parameters: dict[str, EstimatedParameter]
    """Parameters by name."""


class EstimatorRow(SelectedEstimator):
    """Results of one estimator of the bank."""

    status: Literal["warming up", "estimated", "held", "restarted", "uncertain"]
    """Whether the parameters are estimated, held from an earlier contact, not known yet, or
    uncertain: their data were taken with a surface since found elsewhere, which widens std."""
    nrmse: float | None
    """Error of the predicted force as a share of its range [1]; null without a prediction."""
    convergence_s: float | None
    """Time in contact after which k (or m) stayed within 2 % of its last value [s]; or null."""
    restarts: int
    """Number of restarts of the estimator."""
    forgetting_factor: float | None
    """Weight of a sample against the one after it [1]; null where it is not finite."""
    condition: float | None
    """Condition number of the information matrix [1]; null where it is not finite."""
    reason: NotRequired[str]
    """Why nothing can be identified; absent where something can."""
    tracking_delay_s: float | None
    """Lag behind a stiffness that varies [s]; null where none varies or none is followed."""
