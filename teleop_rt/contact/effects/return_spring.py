"""Springs that pull the axis itself, also in free air: a spring, a cable, a hose, a gas column."""

from __future__ import annotations

from dataclasses import replace

from teleop_rt.contact.effect import Amplitude, Effect, Shape, Vector
from teleop_rt.kernels.jit import kernel

_COLUMN = 0.1  # rig unit; length of a gas column at which its stiffness is stated


@kernel
def _place(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return x


@kernel
def _beside_rest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(x - eta[0])


@kernel
def _taut_beyond(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(max(x - eta[0], 0.0))


@kernel
def _taut_before(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(min(x - eta[0], 0.0))


@kernel
def _gas_ahead(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Push back with gas of a column that ends at eta[0]; it is compressed forwards."""
    length = max((eta[0] - x) / _COLUMN, 1e-9)
    return float(_COLUMN / eta[1] * length ** -eta[1])


@kernel
def _gas_behind(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Push on with gas of a column that ends at eta[0]; it is compressed backwards."""
    length = max((x - eta[0]) / _COLUMN, 1e-9)
    return float(-_COLUMN / eta[1] * length ** -eta[1])


BESIDE_A_BODY = "about its rest"  # law of the same where a body is touched
RETURN_SPRING = "return_spring"  # effect of a drive alone
_ABOUT_ITS_REST = Effect(
    name=RETURN_SPRING,
    law=BESIDE_A_BODY,
    family="elastic",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("spring_stiffness", "{f}/{x}", nonnegative=True),
    shapes=(Shape("rest", "{x}", -3.0, 3.0, 0.0, relative_to="place", points=8),),
    step=_beside_rest,
    sentence="A spring, cable or hose pulls the axis to {rest} with {spring_stiffness}.",
    compensation="subtract_force",
    only_in_contact=False,
    like=("force_bias",),
)
# The column of a gas ends beyond the stroke, and is hardly longer than a few of them.
_COLUMN_END = Shape("column_end", "{x}", 0.55, 5.0, 1.5, relative_to="place",
                    points=6)  # fmt: skip
# From slow to quick compression: isothermal, adiabatic of a diatomic gas, of a noble gas.
_EXPONENT = Shape("exponent", "1", 1.0, 1.67, 1.25, points=1)
_GAS_SPRING = Effect(
    name=RETURN_SPRING,
    law="of gas, compressed forwards",
    family="elastic",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("spring_stiffness", "{f}/{x}", nonnegative=True),
    shapes=(_COLUMN_END, _EXPONENT),
    step=_gas_ahead,
    sentence=(
        "A gas spring, of {spring_stiffness} where its column is 0.1 long, pushes with a column"
        " that ends at {column_end}."
    ),
    compensation="subtract_force",
    only_in_contact=False,
)
# A cable that is taut from a place inside the body on is the force of a second layer.
_REST_IN_AIR = Shape("rest", "{x}", -5.0, 0.0, -1.0, relative_to="travel", points=8)

EFFECTS = (
    Effect(
        name=RETURN_SPRING,
        family="elastic",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("spring_stiffness", "{f}/{x}", nonnegative=True),
        step=_place,
        sentence="A spring, cable or hose pulls the axis back with {spring_stiffness}.",
        compensation="subtract_force",
        only_in_contact=False,
    ),
    _ABOUT_ITS_REST,
    *(
        replace(
            _ABOUT_ITS_REST,
            law=f"{BESIDE_A_BODY}, slack {side} it",
            shapes=(shape,),
            step=step,
            sentence=f"A cable, slack {side} {{rest}}, pulls the axis with {{spring_stiffness}}.",
            like=(),
        )
        for side, step, shape in (
            ("before", _taut_beyond, _REST_IN_AIR),
            ("beyond", _taut_before, _ABOUT_ITS_REST.shapes[0]),
        )
    ),
    _GAS_SPRING,
    replace(
        _GAS_SPRING,
        law="of gas, compressed backwards",
        shapes=(replace(_COLUMN_END, lower=-5.0, upper=-0.55, start=-1.5), _EXPONENT),
        step=_gas_behind,
    ),
)
