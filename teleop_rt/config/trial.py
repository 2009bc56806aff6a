"""The schema of trials: bounds beside each field, unknown keys refused.

Rigs are in `rig.py`, operators in `operator.py`, the master's side in `master.py`, the link in
`link.py`, the rules between sections in `contradictions.py`. `yaml_file.py` reads files and
`loader.py` turns them into these models.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, SerializeAsAny, field_validator, model_validator

from teleop_rt.config.contradictions import ContradictionError, contradictions
from teleop_rt.config.extended import ExtendedModelConfig
from teleop_rt.config.link import LinkConfig
from teleop_rt.config.master import CouplingConfig, MasterConfig, Mode
from teleop_rt.config.operator import OperatorConfig
from teleop_rt.config.rig import RigConfig
from teleop_rt.config.section import Force, Section, Velocity, each_once
from teleop_rt.ids import RegressionId, SolverId

ModelId = Literal[
    "mass", "kelvin-voigt", "kelvin-voigt-unilateral", "mass-spring-damper", "hunt-crossley"
]


class ContactConfig(Section):
    """Detection of contact by force with hysteresis, and of the surface."""

    onset_force: Force = Field(
        gt=0,
        description=(
            "Force above which contact begins; at least three times sensors.force_noise and below "
            "slave.force_cap."
        ),
    )
    release_force: Force = Field(
        gt=0,
        description=(
            "Force below which contact ends and air counts as free; below onset_force, half of it "
            "is usual."
        ),
    )
    onset_samples: int = Field(
        3, ge=1, le=100, description="Samples in a row above onset_force that begin a contact."
    )
    release_samples: int = Field(
        5, ge=1, le=1000, description="Samples in a row below release_force that end a contact."
    )
    free_air_ms: float = Field(
        20.0,
        ge=1,
        le=10_000,
        description=(
            "Shortest time below release_force, since the last contact, before an onset that "
            "places the surface."
        ),
    )
    surface_tracking_hz: float = Field(
        0.0,
        ge=0,
        le=4,
        description=(
            "Bandwidth with which a moving surface, such as breathing tissue, is tracked; 0 for "
            "a stationary surface, 3 for breath."
        ),
    )

    @model_validator(mode="after")
    def _hysteresis(self) -> ContactConfig:
        if self.release_force >= self.onset_force:
            raise ValueError("release_force must be below onset_force")
        return self


class Differentiator(Section):
    """How velocity and acceleration are had from position."""

    kind: Literal["svf", "kalman", "foaw"] = Field(
        "svf",
        description=(
            "How velocity and acceleration are found: svf (state variable filter), kalman "
            "(steady-state Kalman filter) or foaw (first-order adaptive windowing)."
        ),
    )
    cutoff_hz: float = Field(
        60.0,
        gt=0,
        le=1000,
        description=(
            "Bandwidth of the differentiator, below a third of the rig's rate_hz; lower is "
            "smoother and slower."
        ),
    )


class EstimationConfig(Section):
    """The estimators to run: every combination of model, regression and solver that is defined."""

    models: tuple[ModelId, ...] = Field(
        ("kelvin-voigt", "mass-spring-damper", "hunt-crossley"),
        min_length=1,
        max_length=8,
        description=(
            "Contact models that are estimated; the one that predicts best is streamed to the "
            "master."
        ),
    )
    regressions: tuple[RegressionId, ...] = Field(
        ("direct",),
        min_length=1,
        max_length=8,
        description=(
            "How a model is turned into linear equations: direct (from the differentiator's "
            "signals) or algebraic (by integration over windows, without derivatives)."
        ),
    )
    solvers: tuple[SolverId, ...] = Field(
        ("rls",),
        min_length=1,
        max_length=8,
        description=(
            "Recursive solvers: rls, sprls, ni-sprls, gn-vff-rls or iec; every model runs with "
            "every regression and solver."
        ),
    )
    differentiator: Differentiator = Field(
        Differentiator(), description="How velocity and acceleration are found from position."
    )
    forgetting_factor: float = Field(
        1.0,
        gt=0.9,
        le=1,
        description=(
            "Factor per sample by which old data lose weight; 1 forgets nothing, 0.998 at 1 kHz "
            "remembers about half a second. gn-vff-rls takes it as its upper bound."
        ),
    )

    _once = field_validator("models", "regressions", "solvers")(each_once)


class SlaveConfig(Section):
    """How the slave guards itself and the environment."""

    force_cap: Force = Field(
        gt=0,
        description=(
            "Force to which the slave limits its pressing on any contact; between "
            "contact.onset_force and limits.force_max."
        ),
    )
    retreat_speed: Velocity = Field(
        gt=0, description="Speed at which the slave draws back to the surface."
    )
    hold_after_ms: float = Field(
        100,
        gt=0,
        le=10_000,
        description="Silence of the master after which the slave holds its place; older motion is"
        " not followed.",
    )
    retreat_after_ms: float = Field(
        500,
        gt=0,
        le=60_000,
        description=(
            "Silence of the master, or time without its lead (it declutched), after which the "
            "slave draws back to the surface; not below hold_after_ms. From a master whose device "
            "was let go for a fault it draws back at once."
        ),
    )

    @model_validator(mode="after")
    def _holds_first(self) -> SlaveConfig:
        if self.retreat_after_ms < self.hold_after_ms:
            raise ValueError("retreat_after_ms must not be below hold_after_ms")
        return self


class PlantConfig(Section):
    """Settings of a simulated plant; its driver extends them, and only the plant reads them."""


class TrialConfig(Section):
    """A trial: one rig, one operator, one link, for some time."""

    format: Literal[1] = Field(1, description="Version of the file format; this program reads 1.")
    name: str = Field(
        min_length=1,
        max_length=100,
        pattern=r"^[A-Za-z0-9_-]+$",
        description="Name of the trial, in the run's folder and report: letters, digits, _ and -.",
    )
    rig: RigConfig = Field(description="The rig; in the file also its path, relative to the trial.")
    duration_s: float = Field(
        ge=0.01,
        le=86400,
        description=(
            "Length of a run, and of a slave with --arm; a master alone runs until it is stopped."
        ),
    )
    seed: int = Field(
        0,
        ge=0,
        lt=2**63,
        description=(
            "Seed of all random numbers; the same seed on the simulated clock gives the same bytes."
        ),
    )
    mode: Mode = Field(
        "model-mediated",
        description=(
            "What the operator feels: the estimated model (model-mediated), or one of the "
            "baselines without a model."
        ),
    )
    coupling: CouplingConfig = Field(
        CouplingConfig(), description="Gains of the modes without a model."
    )
    operator: OperatorConfig = Field(description="Source of the master's motion.")
    contact: ContactConfig = Field(description="How contact and surface are detected.")
    estimation: EstimationConfig = Field(EstimationConfig(), description="Which estimators run.")
    extended_model: ExtendedModelConfig | None = Field(
        None,
        description=(
            "Model with the effects that diagnosis found; in the file also its path, relative to "
            "the trial."
        ),
    )
    effects_file: str | None = Field(
        None, description="Python file with effects of your own, relative to the trial."
    )
    slave: SlaveConfig = Field(
        description="Limits by which the slave protects itself and the environment."
    )
    master: MasterConfig = Field(description="The operator's device, and how force is rendered.")
    link: LinkConfig = Field(
        LinkConfig(),
        description="The link between slave and master, and the network that is simulated on it.",
    )
    plant: SerializeAsAny[PlantConfig] | None = Field(
        None, description="Settings of the simulated plant; remove this section on real hardware."
    )

    @model_validator(mode="after")
    def _possible(self) -> TrialConfig:
        if problems := contradictions(self):
            raise ContradictionError(problems)
        return self
