"""One estimator, sample by sample, for a control loop outside this program."""

from __future__ import annotations

import math
from typing import Literal, TypedDict, Unpack

import numpy as np

from teleop_rt.api.values import Parameter, named
from teleop_rt.contact.effect import Vector
from teleop_rt.errors import ExpectedError
from teleop_rt.estimation.layout import ESTIMATED, HELD, STATUS_NAMES
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.rows import rows_for
from teleop_rt.offline.no_contact import ONSET_NOISES
from teleop_rt.offline.replay import RELEASE_NOISES


class Options(TypedDict, total=False):
    """Options of an `Estimator`.

    `surface`: its position where it is known, else it is found from the force's onset. `regression`
    is `direct` or `algebraic`, `solver` one of rls, sprls, ni-sprls, gn-vff-rls, iec.
    `forgetting_factor` below 1 follows parameters that vary. `force_lag_s` > 0: the force comes
    later than the position that it belongs to. `units` are ("m", "N") or ("rad", "Nm").
    """

    surface: float | None
    regression: Literal["direct", "algebraic"]
    solver: Literal["rls", "sprls", "ni-sprls", "gn-vff-rls", "iec"]
    forgetting_factor: float
    force_lag_s: float
    units: tuple[str, str]


class Estimator:
    """A contact model's parameters, sample by sample, in memory that does not grow.

    `model` is a model's id; `period_s` the time from call to call; `force_noise` the standard
    deviation of the force's noise, `position_step` the encoder's resolution [rig units]. Further
    `options`: see `Options`. The first one compiles for seconds, so make it before the loop.
    Raises ExpectedError.

    >>> import teleop_rt
    >>> one = teleop_rt.Estimator("kelvin-voigt", 1e-3, force_noise=0.02, position_step=1e-6)
    >>> one.names
    ('k', 'b')
    >>> one.update(0.0, 0.0)
    array([nan, nan])
    """

    def __init__(
        self, model: str, period_s: float, force_noise: float, position_step: float,
        **options: Unpack[Options],
    ) -> None:  # fmt: skip
        for name, value in (("period_s", period_s), ("force_noise", force_noise),
                            ("position_step", position_step)):  # fmt: skip
            if not (math.isfinite(value) and value > 0.0):
                raise ExpectedError(f"Estimator: {name} {value!r}: a number above 0 is needed")
        regression, solver = options.get("regression", "direct"), options.get("solver", "rls")
        try:
            (row,) = rows_for([model], [regression], [solver])
            settings = PipelineSettings(
                period_s=period_s,
                position_resolution=position_step,
                force_noise=force_noise,
                onset_force=ONSET_NOISES * force_noise,
                release_force=RELEASE_NOISES * force_noise,
                surface=options.get("surface"),
                forgetting_factor=options.get("forgetting_factor", 1.0),
                force_lag_s=options.get("force_lag_s", 0.0),
            )
            self._pipeline = Pipeline([row], settings)
        except ValueError as error:
            raise ExpectedError(f"Estimator: {error}") from None
        position, force = options.get("units", ("m", "N"))
        self.names = tuple(parameter.name for parameter in row.parameters)
        self._units = [
            parameter.unit.replace("{x}", position).replace("{f}", force)
            for parameter in row.parameters
        ]
        room = len(self._pipeline.estimate(0)[0]) + 1  # a linear model may add an offset
        room = max(room, len(row.parameters) + 1) if row.linear else len(row.parameters)
        self._values, self._deviations = np.full(room, math.nan), np.full(room, math.nan)
        self._parameters = self._values[: len(self.names)]
        self._shown = self._parameters.view()
        self._shown.flags.writeable = False
        self._status = self._pipeline.bank.status
        self.update(0.0, 0.0)  # compiled and loaded now, not in the loop
        self.reset()

    def update(self, x: float, f: float) -> Vector:
        """Take a sample, and return the parameters in the order of `names`.

        x: position, f: force, in the rig's units; not a number counts as a missing sample. The
        array is the same at every call and read-only: copy values that are to be kept. Its values
        are not a number until the model is estimated.
        """
        self._pipeline.update(x, f, valid=True)
        self._pipeline.write_estimate(0, self._values, self._deviations)
        if self._status.item(0) not in _KNOWN:
            self._values[:] = math.nan
            self._deviations[:] = math.nan
        return self._shown

    def reset(self) -> None:
        """Forget everything."""
        self._pipeline.reset()
        self._values[:] = self._deviations[:] = math.nan

    @property
    def status(self) -> str:
        """One of `warming up`, `estimated`, `held`, `restarted`."""
        return STATUS_NAMES[int(self._status[0])]

    @property
    def in_contact(self) -> bool:
        """Whether the tool touches the environment."""
        return self._pipeline.contact.in_contact

    @property
    def surface(self) -> float | None:
        """Where the surface lies, None while unknown."""
        found = self._pipeline.contact.surface
        return found if math.isfinite(found) else None

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The parameters with deviations and units, as of the last sample."""
        columns = zip(self.names, self._values, self._deviations, self._units, strict=False)
        return {
            name: Parameter(_known(value), _known(deviation), unit)
            for name, value, deviation, unit in columns
        }

    def __repr__(self) -> str:
        return (
            f"<Estimator: {self._pipeline.rows[0].model}, {self.status}; {named(self.parameters)}>"
        )


_KNOWN = (float(ESTIMATED), float(HELD))


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
