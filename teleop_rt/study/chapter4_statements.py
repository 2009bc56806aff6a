"""What chapter 4 states, held against what was found: verdict and reason follow the numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from teleop_rt.study.chapter4 import REPORTED, SETTLED
from teleop_rt.study.chapter4_plant import TRUTH
from teleop_rt.study.sweep import Result

Verdict = Literal["agrees", "in part", "disagrees"]
Method = tuple[str, str]
RLS, IEC, ALGEBRAIC = ("direct", "rls"), ("direct", "iec"), ("algebraic", "rls")
NAMES = {RLS: "RLS", IEC: "integral error", ALGEBRAIC: "algebraic"}
SMALL_ERROR = 0.01
"""NRMSE below which the force error counts as the same at every frequency."""
STEADY = 0.02
"""A parameter is constant when it stays within this share of its value."""
BLIND = 1e8
"""Condition number from which a motion does not excite a model."""


@dataclass(frozen=True, slots=True)
class Statement:
    """A statement of the report, with verdict, what was found, and why."""

    name: str
    section: str
    text: str
    verdict: Verdict
    found: str
    why: str

    def plain(self) -> dict[str, Any]:
        """Return it JSON-ready."""
        return asdict(self)


def verdict_of(holds: Sequence[bool]) -> Verdict:
    """Return whether all of a statement's parts hold, some, or none."""
    if all(holds):
        return "agrees"
    return "in part" if any(holds) else "disagrees"


def _method(result: Result, method: Method, model: str = "") -> dict[str, Any]:
    found: dict[str, Any] = next(
        one
        for one in result["methods"]
        if (one["regression"], one["solver"]) == method and (not model or one["model"] == model)
    )
    return found


def _named(method: Method) -> str:
    return NAMES.get(method, f"{method[1]}".upper())


def _errors(cases: Sequence[Result], model: str, method: Method) -> dict[str, float]:
    """Return the largest relative error of each final parameter over all frequencies."""
    truth = TRUTH[model]
    return {
        name: max(abs(_method(one, method)["final"][name] / truth[name] - 1.0) for one in cases)
        for name in truth
    }


def simulation_statements(
    simulated: Sequence[Result], conditions: Sequence[Result], noisy: Result
) -> Iterator[Statement]:
    """Judge section 4.1; see `chapter4.simulate`, `excitation.evaluate`, `noise.hidden_damping`."""
    linear = [one for one in simulated if one["model"] == "kelvin-voigt"]
    curved = [one for one in simulated if one["model"] == "hunt-crossley"]
    yield _converges(linear)
    yield _integral_is_fastest(linear)
    yield _frequency("frequency-kelvin-voigt", linear, (RLS, ALGEBRAIC), "k")
    yield _all_but_integral_damping(curved, noisy)
    yield _frequency("frequency-hunt-crossley", curved, REPORTED["hunt-crossley"], "b")
    yield _error_is_constant(simulated)
    yield _one_frequency(conditions)


def _converges(cases: Sequence[Result]) -> Statement:
    worst = {
        method: max(_errors(cases, "kelvin-voigt", method).values())
        for method in REPORTED["kelvin-voigt"]
    }
    told = ", ".join(f"{_named(m)} {100 * e:.2g} %" for m, e in worst.items())
    holds = [error <= SETTLED for error in worst.values()]
    why = (
        "without noise the regression is exact, and the motion excites both parameters"
        if all(holds)
        else "not every method ends within 2 % of the truth"
    )
    return Statement(
        "converges-kelvin-voigt", "4.1.1", "The three methods converge to the real parameters.",
        verdict_of(holds), f"largest error of a final parameter: {told}", why,
    )  # fmt: skip


def _settling(case: Result, method: Method, name: str) -> float:
    value = _method(case, method)["settling_s"][name]
    return math.inf if value is None else float(value)


def _integral_is_fastest(cases: Sequence[Result]) -> Statement:
    times = {m: [_settling(one, m, "k") for one in cases] for m in REPORTED["kelvin-voigt"]}
    fastest = all(
        min(times[m][i] for m in times if m != IEC) > times[IEC][i] for i in range(len(cases))
    )
    overshoot = {m: max(max(_method(one, m)["overshoot"].values()) for one in cases) for m in times}
    told = "; ".join(
        f"{_named(m)}: k within 2 % after at most {max(times[m]):.3g} s, "
        f"overshoot {100 * overshoot[m]:.2g} %"
        for m in times
    )
    calm = overshoot[IEC] <= SETTLED
    why = (
        "two samples determine two parameters, and the criterion has no prior to forget; "
        f"RLS starts from P = 1e6 I, which holds k back until it has data ({max(times[RLS]):.3g} s)"
        if fastest
        else "another method settles as soon"
    )
    return Statement(
        "integral-fastest", "4.1.1",
        "The integral error criterion converges fastest, without overshoot.",
        verdict_of([fastest, calm]), told, why,
    )  # fmt: skip


def _frequency(name: str, cases: Sequence[Result], methods: Sequence[Method], by: str) -> Statement:
    """Judge that convergence is quicker the higher the frequency."""
    ordered = sorted(cases, key=lambda one: one["frequency_hz"])
    f = np.array([one["frequency_hz"] for one in ordered])
    holds, told, exceptions = [], [], []
    for method in methods:
        times = [_settling(one, method, by) for one in ordered]
        falls = times == sorted(times, reverse=True) and times[0] > times[-1]
        holds.append(falls)
        if not falls:
            exceptions.append(_named(method))
        slope = float("nan")
        if all(0.0 < one < math.inf for one in times):
            slope = float(np.polyfit(np.log(f), np.log(times), 1)[0])
        listed = " / ".join(f"{one:.3g}" for one in times)
        told.append(f"{_named(method)}: {by} after {listed} s (exponent {slope:.2f})")
    why = "velocity, which tells b from k, grows with the frequency"
    if exceptions:
        why += f"; the times of {', '.join(exceptions)} do not fall at every step"
        free = max(_settling(one, ("algebraic", "iec"), by) for one in ordered)
        if _named(ALGEBRAIC) in exceptions and free < 0.1 * _settling(ordered[-1], ALGEBRAIC, by):
            why += (
                f": the same integrals by the integral criterion, which has no prior, settle after "
                f"at most {free:.2g} s, so it is P = 1e6 I that holds algebraic + RLS back while "
                "its regressors grow from zero, not the motion"
            )
    frequencies = ", ".join(f"{one:g}" for one in f)
    return Statement(
        name, "4.1.1" if "kelvin" in name else "4.1.2",
        "The higher the frequency, the shorter the convergence time"
        + (" (RLS and algebraic)." if "kelvin" in name else " (in general)."),
        verdict_of(holds), f"at {frequencies} Hz, " + "; ".join(told), why,
    )  # fmt: skip


def _all_but_integral_damping(cases: Sequence[Result], noisy: Result) -> Statement:
    errors = {m: _errors(cases, "hunt-crossley", m) for m in REPORTED["hunt-crossley"]}
    others = all(max(e.values()) <= SETTLED for m, e in errors.items() if m != IEC)
    missed = errors[IEC]["b"] > SETTLED
    told = ", ".join(f"{_named(m)} b {100 * e['b']:.2g} %" for m, e in errors.items())
    spread = f"{noisy['low']:.3g} to {noisy['high']:.3g}"
    if missed:
        why = "the criterion does not find b here either"
    else:
        why = (
            "least squares on [1, ẋ, ln x] returns b where there is no noise, so the miss is not "
            f"the criterion's; at 5 ± 2 mm |bẋ/k| is at most {noisy['ratio']:.2g}, and noise of "
            f"{noisy['sigma_N']:g} N spreads b over {spread} in {noisy['seeds']} seeds: "
            "noise, or rounding, hides b"
        )
    return Statement(
        "integral-misses-damping", "4.1.2",
        "All five methods converge, except for b by the integral error criterion.",
        verdict_of([others, missed]), f"largest error of the final b: {told}", why,
    )  # fmt: skip


def _error_is_constant(simulated: Sequence[Result]) -> Statement:
    holds, told = [], []
    for model in TRUTH:
        cases = [one for one in simulated if one["model"] == model]
        for method in (RLS, IEC, ALGEBRAIC):
            errors = [_method(one, method)["nrmse"] for one in cases]
            holds.append(max(errors) - min(errors) <= SMALL_ERROR)
            told.append(f"{model} {_named(method)} {min(errors):.2g} to {max(errors):.2g}")
    start = [one["nrmse_online"] for case in simulated for one in case["methods"]]
    why = (
        "once converged the force is right at every frequency; what is left is the trapezoid's "
        "error and the prior's, small beside the range of the force"
        if all(holds)
        else f"somewhere it changes by more than {SMALL_ERROR:g} of the range of the force"
    )
    why += (
        f"; with the parameters of each moment, the start included, it is {min(start):.2g} to "
        f"{max(start):.2g} (figure 4.4): that tells how long a method takes to converge"
    )
    return Statement(
        "error-constant", "4.1.3", "The NRMSE of the force hardly depends on the frequency.",
        verdict_of(holds), "; ".join(told), why,
    )  # fmt: skip


def _one_frequency(conditions: Sequence[Result]) -> Statement:
    """Judge it on one sinusoid about zero and about an offset, each with and without a bias."""
    listed = []
    for one in conditions:
        value = one["condition"]
        number = "infinite" if value is None else f"{value:.2g}"
        where = f"{1e3 * one['mean_m']:g} mm" + (" with bias" if one["bias"] else "")
        listed.append((one["model"], where, number, value is not None and value < BLIND))
    blind = [f"{model} at {where}" for model, where, _, fine in listed if not fine]
    why = (
        f"the motion does not excite {'; '.join(blind)}: there a mass and a spring, or an offset "
        "and a bias, are one and the same number"
        if blind
        else "every model is excited"
    )
    found = ", ".join(f"{model} at {where} {number}" for model, where, number, _ in listed)
    return Statement(
        "one-frequency", "4",
        "All models are of order one, so one non-zero frequency excites them.",
        verdict_of([fine for *_, fine in listed]), f"condition numbers: {found}", why,
    )  # fmt: skip


def silicone_statements(rig: Result, curved: Result) -> Iterator[Statement]:
    """Judge section 4.2 on the rig's cube; the curved one tells what is the material's doing."""
    yield _silicone_values(rig)
    yield _steadiest(rig)
    yield _quick(rig)
    yield _wanders(rig, curved)
    yield _tracks_better(rig, curved)
    yield _bad_at_turning(rig, curved)


def _linear(cube: Result, method: Method) -> dict[str, Any]:
    return _method(cube, method, "kelvin-voigt")


def _silicone_values(rig: Result) -> Statement:
    found = {m: _linear(rig, m)["final"] for m in NAMES}
    close = [
        abs(one["k"] / 3600.0 - 1.0) <= 0.05 and abs(one["b"] / 20.0 - 1.0) <= 0.15
        for one in found.values()
    ]
    told = ", ".join(f"{NAMES[m]} k {p['k']:.4g}, b {p['b']:.3g}" for m, p in found.items())
    why = (
        "the simulated cube has these parameters, and every byte of encoder and force sensor "
        "brings them through"
        if all(close)
        else "not all methods come within 5 % of k and 15 % of b"
    )
    return Statement(
        "silicone-values", "4.2.1", "The silicone cube has k ≈ 3600 and b ≈ 20; the algebraic "
        "approach is a feasible option, too.", verdict_of(close), told, why,
    )  # fmt: skip


def _wander(one: dict[str, Any]) -> float:
    """Return the largest relative wander of a method's parameters; infinite if never estimated."""
    values = list(one["wander"].values())
    return max(math.inf if value is None else float(value) for value in values)


def _steadiest(rig: Result) -> Statement:
    wander = {m: _wander(_linear(rig, m)) for m in NAMES}
    least = min(wander.values())
    holds = wander[RLS] <= 1.05 * least
    told = ", ".join(f"{NAMES[m]} {100 * w:.2g} %" for m, w in wander.items())
    beaten = wander[ALGEBRAIC] / wander[RLS] if wander[RLS] > 0.0 else math.inf
    why = (
        f"the algebraic window is short and restarts, so it wanders {beaten:.2g} times as far; "
        "the integral criterion solves the same normal equations as RLS without forgetting"
        if holds
        else "another method wanders less"
    )
    return Statement(
        "rls-steadiest", "4.2.1", "RLS is the steadiest on Kelvin-Voigt.",
        verdict_of([holds]), f"largest wander of a converged parameter: {told}", why,
    )  # fmt: skip


def _quick(rig: Result) -> Statement:
    time = _linear(rig, RLS)["convergence_s"]
    holds = time is not None and time <= 1.5
    told = "never" if time is None else f"after {time:.2g} s of contact"
    why = (
        "that is the approach, while only k speaks, and the first swing, which tells b"
        if holds
        else "k leaves the band of 2 % around its end again later"
    )
    return Statement(
        "about-a-second", "4.2.3", "Kelvin-Voigt converges in about one second.",
        verdict_of([holds]), f"RLS: k within 2 % {told}", why,
    )  # fmt: skip


def _wanders(rig: Result, curved: Result) -> Statement:
    cubes = {"rig": rig, "curved": curved}
    wander = {
        name: {m: _wander(_method(cube, m, "hunt-crossley")) for m in NAMES}
        for name, cube in cubes.items()
    }
    own = wander["rig"]
    restless = all(own[m] > STEADY for m in (RLS, IEC))
    settles = own[ALGEBRAIC] < min(own[RLS], own[IEC])
    told = "; ".join(
        f"{name}: " + ", ".join(f"{NAMES[m]} {100 * w:.2g} %" for m, w in one.items())
        for name, one in wander.items()
    )
    why = f"a parameter within {100 * STEADY:g} % counts as constant; "
    why += "b, the last to be told, wanders most; " if restless else ""
    why += (
        "the algebraic window keeps it steadier"
        if settles
        else "the algebraic rows wander further than RLS: their windows restart, and their noise "
        "is integrated"
    )
    return Statement(
        "hunt-crossley-wanders", "4.2.2", "No method converges to a constant on Hunt-Crossley; "
        "the algebraic one alone seems to settle.",
        verdict_of([restless, settles]), f"largest wander: {told}", why,
    )  # fmt: skip


def _ratio(cube: Result) -> float:
    """Return the force error of Hunt-Crossley over that of Kelvin-Voigt, by RLS."""
    errors = [_method(cube, RLS, model)["nrmse"] for model in ("hunt-crossley", "kelvin-voigt")]
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
    told = [
        {name: float(_linear(cube, RLS)[name] or 0.0) for name in ("turning", "nrmse")}
        for cube in (rig, curved)
    ]
    holds = [one["turning"] > 1.0 and one["nrmse"] > SMALL_ERROR for one in told]
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
            for name, one in zip(("rig", "curved"), told, strict=True)
        ),
        why,
    )  # fmt: skip
