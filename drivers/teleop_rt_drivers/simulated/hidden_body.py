"""Effects of the body that a simulated rig presses on, which the estimators do not know."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from teleop_rt.config.section import Force, Position, Quantity, Section, Stiffness, Velocity
from teleop_rt_drivers.simulated import hidden

Constants = dict[str, int]
"""Column of the kernel's constants for each field, by name."""


class HiddenEffect(Section):
    """Common keys of all hidden effects."""

    columns: ClassVar[Constants] = {}

    def constants(self) -> dict[int, float]:
        """Return the effect's constants by their column."""
        return {column: float(getattr(self, name)) for name, column in self.columns.items()}


class NonlinearStiffening(HiddenEffect):
    """A foam whose cells lock: k x^2 / (L - x)."""

    effect: Literal["nonlinear_stiffening"] = Field(
        description="A foam whose cells lock: k x^2 / (L - x)."
    )
    stiffness: Stiffness = Field(gt=0, description="Stiffness k of the locking law.")
    locking_depth: Position = Field(
        gt=0, description="Penetration L at which the foam would be solid."
    )
    columns: ClassVar[Constants] = {"stiffness": hidden.FOAM, "locking_depth": hidden.LOCKING_DEPTH}


class SecondLayer(HiddenEffect):
    """A harder layer below, met over a graded boundary: k w ln(1 + exp((x - d)/w))."""

    effect: Literal["second_layer"] = Field(
        description="A harder layer below: k w ln(1 + exp((x - d)/w))."
    )
    stiffness: Stiffness = Field(
        gt=0, description="Stiffness k that the layer adds once it is reached."
    )
    depth: Position = Field(gt=0, description="Penetration d at which the layer begins.")
    blend: Position = Field(
        2e-4, gt=0, description="Width w over which the layer's stiffness grows."
    )
    columns: ClassVar[Constants] = {
        "stiffness": hidden.LAYER, "depth": hidden.LAYER_DEPTH, "blend": hidden.LAYER_BLEND,
    }  # fmt: skip


class Arm(Section):
    """A spring and a dashpot in series."""

    stiffness: Stiffness = Field(gt=0, description="Stiffness of the arm's spring.")
    time_constant_s: float = Field(
        ge=1e-3,
        le=86_400,
        description="Time in which the arm relaxes: its damping over its stiffness.",
    )


class StressRelaxation(HiddenEffect):
    """Maxwell arms beside the body."""

    effect: Literal["stress_relaxation"] = Field(
        description="Maxwell arms beside the body, whose force relaxes with time."
    )
    arms: tuple[Arm, ...] = Field(
        min_length=1,
        max_length=hidden.ARMS,
        description="The arms, each a spring and a dashpot in series; three at most.",
    )

    def constants(self) -> dict[int, float]:
        """Return stiffness and time constant of each arm by their column."""
        return {
            column: value
            for i, arm in enumerate(self.arms)
            for column, value in (
                (hidden.ARM + i, arm.stiffness), (hidden.ARM_TIME + i, arm.time_constant_s)
            )
        }  # fmt: skip


class Hysteresis(HiddenEffect):
    """Bouc-Wen: z' = v/d (1 - |z|^n (beta sgn(v z) + gamma)), force F z."""

    effect: Literal["hysteresis"] = Field(
        description=(
            "Bouc-Wen hysteresis: z' = v/d (1 - |z|^n (beta sgn(v z) + gamma)), force F z."
        )
    )
    yield_force: Force = Field(gt=0, description="Force F at which the hysteresis saturates.")
    yield_travel: Position = Field(gt=0, description="Travel d over which it builds up.")
    beta: float = Field(
        0.6, ge=0, le=10, description="Share of the loop that depends on the direction of motion."
    )
    gamma: float = Field(
        0.4,
        ge=0,
        le=10,
        description="Share of the loop that does not depend on the direction of motion.",
    )
    sharpness: float = Field(
        1.5, ge=1, le=100, description="Exponent n; larger makes a sharper knee."
    )
    columns: ClassVar[Constants] = {
        "yield_force": hidden.YIELD_FORCE, "yield_travel": hidden.YIELD_TRAVEL, "beta": hidden.BETA,
        "gamma": hidden.GAMMA, "sharpness": hidden.SHARPNESS,
    }  # fmt: skip


class QuadraticDamping(HiddenEffect):
    """A fluid in the body: c v |v|, from the first wetted tenth of a millimetre on."""

    effect: Literal["quadratic_damping"] = Field(description="A fluid in the body: c v |v|.")
    damping: Annotated[float, Quantity("{f}_s2_per_{x}2")] = Field(
        gt=0, description="Coefficient c of the quadratic damping."
    )
    columns: ClassVar[Constants] = {"damping": hidden.QUADRATIC}


class Adhesion(HiddenEffect):
    """A bond that grows in contact and pulls with exp(-(x/r)^2/2) until it breaks at 3 r."""

    effect: Literal["adhesion"] = Field(
        description="A bond that grows in contact and pulls the tool back when it leaves."
    )
    pull_off_force: Force = Field(gt=0, description="Largest pull of a bond that has fully grown.")
    range: Position = Field(
        gt=0, description="Length r of the bond; it breaks at 3 r above the surface."
    )
    columns: ClassVar[Constants] = {"pull_off_force": hidden.PULL_OFF, "range": hidden.BOND_RANGE}


class Softening(HiddenEffect):
    """A body that loses a share s of its stiffness with time: 1 - s t/(t + T)."""

    effect: Literal["softening"] = Field(
        description="A body that loses stiffness with time: 1 - s t/(t + T)."
    )
    share: float = Field(
        gt=0, lt=1, description="Share s of the stiffness that is lost in the end."
    )
    time_constant_s: float = Field(
        gt=0, le=86_400, description="Time T after which half of that is lost."
    )
    columns: ClassVar[Constants] = {
        "share": hidden.SOFTENED,
        "time_constant_s": hidden.SOFTENING_TIME,
    }


class MullinsSoftening(HiddenEffect):
    """Damage below the deepest past penetration m: the stiffness falls by s (1 - exp((x-m)/w))."""

    effect: Literal["mullins_softening"] = Field(
        description="A body that is softer below the deepest penetration so far."
    )
    share: float = Field(
        gt=0,
        lt=1,
        description=(
            "Share s of the stiffness that is lost far below the deepest penetration m: s (1 - "
            "exp((x - m)/w))."
        ),
    )
    width: Position = Field(
        gt=0, description="Distance w below the deepest penetration over which the loss builds up."
    )
    columns: ClassVar[Constants] = {"share": hidden.DAMAGE, "width": hidden.DAMAGE_WIDTH}


class PermanentSet(HiddenEffect):
    """A surface that creeps down to a share of the deepest penetration."""

    effect: Literal["permanent_set"] = Field(
        description=(
            "A surface that creeps down to a share of the deepest penetration and stays there."
        )
    )
    share: float = Field(gt=0, lt=1, description="Share of the deepest penetration that remains.")
    time_constant_s: float = Field(
        0.02, ge=1e-3, le=86_400, description="Time constant of the creep."
    )
    columns: ClassVar[Constants] = {"share": hidden.SET, "time_constant_s": hidden.SET_TIME}


class MovingSurface(HiddenEffect):
    """A surface that recedes, swings, or both."""

    effect: Literal["moving_surface"] = Field(
        description="A surface that recedes, swings, or both."
    )
    velocity: Velocity = Field(0.0, description="Speed at which the surface recedes from the tool.")
    swing: Position = Field(0.0, ge=0, description="Amplitude of the surface's swing; 0 for none.")
    swing_hz: float = Field(0.5, gt=0, le=20, description="Frequency of the swing.")
    columns: ClassVar[Constants] = {
        "velocity": hidden.SURFACE_VELOCITY, "swing": hidden.SWING, "swing_hz": hidden.SWING_HZ,
    }  # fmt: skip

    @model_validator(mode="after")
    def _moves(self) -> MovingSurface:
        if self.velocity == 0.0 and self.swing == 0.0:
            raise ValueError("velocity and swing are 0, so that nothing moves: give one of them")
        return self
