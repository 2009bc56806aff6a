"""The statements of section 4.2 on the silicone cube, compared with the simulated cubes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from teleop_rt.batch.workers import Result
from teleop_rt.study.chapter4_statements import (
    ALGEBRAIC,
    IEC,
    NAMES,
    RLS,
    SMALL_ERROR,
    Method,
    Statement,
    method_of,
    verdict_of,
)

STEADY = 0.02
"""A parameter is constant when it stays within this share of its value."""


def silicone_statements(rig: Result, curved: Result) -> Iterator[Statement]:
    """Judge section 4.2 on the rig's cube; the curved one shows the effect of the material."""
    yield _silicone_values(rig)
    yield _steadiest(rig)
    yield _quick(rig)
    yield _wanders(rig, curved)
    yield _tracks_better(rig, curved)
    yield _bad_at_turning(rig, curved)


def _linear(cube: Result, method: Method) -> dict[str, Any]:
    return method_of(cube, method, "kelvin-voigt")


def _silicone_values(rig: Result) -> Statement:
    found = {m: _linear(rig, m)["final"] for m in NAMES}
    close = [
        abs(one["k"] / 3600.0 - 1.0) <= 0.05 and abs(one["b"] / 20.0 - 1.0) <= 0.15
        for one in found.values()
    ]
    listing = ", ".join(f"{NAMES[m]} k {p['k']:.4g}, b {p['b']:.3g}" for m, p in found.items())
    why = (
        "the simulated cube has these parameters, and every byte of encoder and force sensor "
        "brings them through"
        if all(close)
        else "not all methods come within 5 % of k and 15 % of b"
    )
    return Statement(
        "silicone-values", "4.2.1", "The silicone cube has k ≈ 3600 and b ≈ 20; the algebraic "
        "approach is a feasible option, too.", verdict_of(close), listing, why,
    )  # fmt: skip


def _wander(one: dict[str, Any]) -> float:
    """Return the largest relative wander of a method's parameters; infinite if never estimated."""
    values = list(one["wander"].values())
    return max(math.inf if value is None else float(value) for value in values)


def _steadiest(rig: Result) -> Statement:
    wander = {m: _wander(_linear(rig, m)) for m in NAMES}
    least = min(wander.values())
    holds = wander[RLS] <= 1.05 * least
    listing = ", ".join(f"{NAMES[m]} {100 * w:.2g} %" for m, w in wander.items())
    beaten = wander[ALGEBRAIC] / wander[RLS] if wander[RLS] > 0.0 else math.inf
    why = (
        f"the algebraic rows see integrated noise, and wander {beaten:.2g} times as far; "
        "the integral criterion solves the same normal equations as RLS without forgetting"
        if holds
        else "another method wanders less"
    )
    return Statement(
        "rls-steadiest", "4.2.1", "RLS is the steadiest on Kelvin-Voigt.",
        verdict_of([holds]), f"largest wander of a converged parameter: {listing}", why,
    )  # fmt: skip


def _quick(rig: Result) -> Statement:
    time = _linear(rig, RLS)["convergence_s"]
    holds = time is not None and time <= 1.5
    settled = "never" if time is None else f"after {time:.2g} s of contact"
    why = (
        "that is the approach, which excites only k, and the first swing, which excites b"
        if holds
        else "k leaves the band of 2 % around its end again later"
    )
    return Statement(
        "about-a-second", "4.2.3", "Kelvin-Voigt converges in about one second.",
        verdict_of([holds]), f"RLS: k within 2 % {settled}", why,
    )  # fmt: skip


def _wanders(rig: Result, curved: Result) -> Statement:
    cubes = {"rig": rig, "curved": curved}
    wander = {
        name: {m: _wander(method_of(cube, m, "hunt-crossley")) for m in NAMES}
        for name, cube in cubes.items()
    }
    own = wander["rig"]
    restless = all(own[m] > STEADY for m in (RLS, IEC))
    settles = own[ALGEBRAIC] < min(own[RLS], own[IEC])
    listing = "; ".join(
        f"{name}: " + ", ".join(f"{NAMES[m]} {100 * w:.2g} %" for m, w in one.items())
        for name, one in wander.items()
    )
    why = f"a parameter within {100 * STEADY:g} % counts as constant; "
    why += "b, the last to be identified, wanders most; " if restless else ""
    why += (
        "the algebraic window keeps it steadier"
        if settles
        else "the algebraic rows wander further than RLS: their noise is integrated, so it grows"
    )
    return Statement(
        "hunt-crossley-wanders", "4.2.2", "No method converges to a constant on Hunt-Crossley; "
        "the algebraic one alone seems to settle.",
        verdict_of([restless, settles]), f"largest wander: {listing}", why,
    )  # fmt: skip


def _ratio(cube: Result) -> float:
    """Return the force error of Hunt-Crossley over that of Kelvin-Voigt, by RLS."""
    errors = [method_of(cube, RLS, model)["nrmse"] for model in ("hunt-crossley", "kelvin-voigt")]
    if any(error is None for error in errors):
        return math.nan
    return float(errors[0] / errors[1])


def _tracks_better(rig: Result, curved: Result) -> Statement:
    own, other = _ratio(rig), _ratio(curved)
    holds = own < 1.0
    if holds:
        why = "this cube is curved, and its exponent takes that up"
    elif other < 1.0:
        why = (
            "the rig's simulated cube is linear, so Kelvin-Voigt is the truth and Hunt-Crossley "
            "has one parameter too many; on a curved cube the report is right, so it says "
            "something of the silicone"
        )
    else:
        why = "it tracks no better on a curved cube either"
    return Statement(
        "hunt-crossley-tracks", "4.2.3", "Hunt-Crossley tracks the force better.",
        verdict_of([holds, other < 1.0]),
        f"NRMSE of Hunt-Crossley over that of Kelvin-Voigt: rig {own:.2g}, curved {other:.2g}", why,
    )  # fmt: skip


def _bad_at_turning(rig: Result, curved: Result) -> Statement:
    listing = [
        {name: float(_linear(cube, RLS)[name] or 0.0) for name in ("turning", "nrmse")}
        for cube in (rig, curved)
    ]
    holds = [one["turning"] > 1.0 and one["nrmse"] > SMALL_ERROR for one in listing]
    why = f"bad is an NRMSE above {SMALL_ERROR:g} that is larger where the motion turns; "
    if holds[1] and not holds[0]:
        why += "a line through a curve misses most at its ends; the rig's cube has no curve to miss"
    elif all(holds):
        why += "both cubes show it"
    else:
        why += "a straight line is not worst at the turns here"
    return Statement(
        "bad-at-turning", "4.2.3",
        "Kelvin-Voigt tracks the force badly, above all where the direction changes.",
        verdict_of(holds),
        "; ".join(
            f"{name}: error at the turns {one['turning']:.2g} times that elsewhere, "
            f"NRMSE {one['nrmse']:.2g}"
            for name, one in zip(("rig", "curved"), listing, strict=True)
        ),
        why,
    )  # fmt: skip
