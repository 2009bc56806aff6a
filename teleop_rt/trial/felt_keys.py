"""The keys of summary.json on the rendered force."""

from __future__ import annotations

from typing import Literal, NotRequired

from teleop_rt.json_schema import Keys
from teleop_rt.master.outcome_keys import Rendering
from teleop_rt.trial.loop_keys import LoopLateness


class TruePort(Keys):
    """True felt force of a simulated hand, against the environment's in converged contact."""

    motor_nrmse: float | None
    """Error of the motor's force as a share, like `nrmse` below [1]; null where not defined."""
    motor_lag_ms: float | None
    """Lag of the motor's force [ms]; null where no lag within the search fits best."""
    hand_nrmse: float | None
    """Error of the hand's force as a share, like `nrmse` below [1]; null where not defined."""
    hand_lag_ms: float | None
    """Lag of the hand's force [ms]; null where no lag within the search fits best."""


class WorstFelt(Keys):
    """The worst of the rendered force since the first touch, before convergence and after."""

    phantom_force: float | None
    """Largest force where the true environment answers the same motion with none [N or Nm]."""
    phantom_s: float | None
    """Time of it, from the slave's first tick [s]."""
    force_error: float | None
    """Largest error of the force, against one that the slave has met [N or Nm]."""
    force_error_s: float | None
    """Time of it, from the slave's first tick [s]."""
    force_range: float | None
    """Range of the true force that the slave has met, by which both are graded [N or Nm]."""


class WallOffset(Keys):
    """How far from its true place the wall is felt, since the first touch, in the rig's unit.

    The master puts the wall where the hand is when the first model comes, and brings it back
    while the hand moves out of contact, at most at master.offset_speed.
    """

    largest: float
    """Largest offset, as its size [m or rad]."""
    largest_s: float
    """First time of it, from the slave's first tick [s]."""
    at_end: float
    """Offset at the end, as its size [m or rad]."""


class Unfelt(Keys):
    """The moment of converged contact in which the tool most exceeded the felt force."""

    pressed: float
    """Force that the slave reported, in its own scale [N or Nm]."""
    felt: float
    """Largest force on the operator in the round trip before, in the hand's scale [N or Nm]."""
    share: float
    """The felt force in the slave's scale, over the one that the tool pressed with."""
    at_s: float
    """Time of it, from the slave's first tick [s]."""
    tracking_hz: float
    """The trial's `contact.surface_tracking_hz` [Hz]."""
    cause: Literal["bound", "model", "other"] | None
    """Why it was not felt: the device's passivity bound, or a model that had not followed the body;
    null where tool or wall are not known."""
    tool: float | None
    """Position of the tool at that moment [rig's unit]; null like `cause`."""
    surface: float | None
    """Rendered surface when the felt force was largest [rig's unit]; null like `cause`."""
    modelled: float | None
    """Largest force that the wall, unbounded, has at the tool's place [N or Nm]; null like
    `cause`."""


class FeltForce(Keys):
    """The rendered force of the master, against the true environment in converged contact."""

    nrmse: float | None
    """Error of the rendered force as a share of the true one's range, or of its largest value where
    that is larger [1]; null without a reference."""
    lag_ms: float | None
    """Lag of the rendered force [ms]; null without a reference, or where no lag within the search
    fits best: the motion repeats itself, or the force hardly moves."""
    direct_reflection_lag_ms: float | None
    """Lag that the slave's force reflected directly would have had [ms]; null like lag_ms."""
    worst: WorstFelt | None
    """The worst since the first touch; null without a reference or a touch."""
    offset: WallOffset | None
    """How far from its true place the wall is felt; null without a touch."""
    largest_force_step: float | None
    """Largest step of the rendered force between ticks, by the hand's motion or by a new model
    [N or Nm]; null where none was recorded. `rendering.adoption` has that of new models alone."""
    unfelt: Unfelt | None
    """When the tool most exceeded the felt force; null without converged contact."""
    reason: NotRequired[str]
    """Why a figure is null; absent where none is."""
    rendering: Rendering | None
    """The master's own report; null if its process ended before it could report."""
    late: LoopLateness | None
    """Lateness of the master's loop; null where it is not known."""
    true_port: TruePort | None
    """The true felt force of a simulated hand; null without one, or without converged contact."""
