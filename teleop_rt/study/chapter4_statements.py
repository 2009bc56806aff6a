"""The statements of chapter 4, compared with the results: numbers decide verdict and reason."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from teleop_rt.batch.workers import Result
from teleop_rt.study.chapter4 import REPORTED, SETTLED
from teleop_rt.study.chapter4_plant import TRUTH

Agreement = Literal["agrees", "in part", "disagrees"]
Method = tuple[str, str]
RLS, IEC, ALGEBRAIC = ("direct", "rls"), ("direct", "iec"), ("algebraic", "rls")
NAMES = {RLS: "RLS", IEC: "integral error", ALGEBRAIC: "algebraic"}
SMALL_ERROR = 0.01
"""NRMSE below which the force error counts as the same at every frequency."""


@dataclass(frozen=True, slots=True)
class Statement:
    """A statement of the report, with verdict, evidence and reason."""

    name: str
    section: str
    text: str
    verdict: Agreement
    found: str
    why: str

    def plain(self) -> dict[str, Any]:
        """Return it JSON-ready."""
        return asdict(self)


def verdict_of(holds: Sequence[bool]) -> Agreement:
    """Return whether all of a statement's parts hold, some, or none."""
    if all(holds):
        return "agrees"
    return "in part" if any(holds) else "disagrees"


def method_of(result: Result, method: Method, model: str = "") -> dict[str, Any]:
    """Return the estimates of one method in a result; `model` where the result holds several."""
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
        name: max(abs(method_of(one, method)["final"][name] / truth[name] - 1.0) for one in cases)
        for name in truth
    }


def simulation_statements(
    simulated: Sequence[Result], conditions: Sequence[Result], noisy: Result
) -> Iterator[Statement]:
    """Judge the statements of section 4.1.

    The results are those of `chapter4.simulate`, `excitation.evaluate` and `noise.hidden_damping`.
    """
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
    listing = ", ".join(f"{_named(m)} {100 * e:.2g} %" for m, e in worst.items())
    holds = [error <= SETTLED for error in worst.values()]
    why = (
        "without noise the regression is exact, and the motion excites both parameters"
        if all(holds)
        else "not every method ends within 2 % of the truth"
    )
    return Statement(
        "converges-kelvin-voigt", "4.1.1", "The three methods converge to the real parameters.",
        verdict_of(holds), f"largest error of a final parameter: {listing}", why,
    )  # fmt: skip


def _settling(case: Result, method: Method, name: str) -> float:
    value = method_of(case, method)["settling_s"][name]
    return math.inf if value is None else float(value)


def _integral_is_fastest(cases: Sequence[Result]) -> Statement:
    times = {m: [_settling(one, m, "k") for one in cases] for m in REPORTED["kelvin-voigt"]}
    fastest = all(
        min(times[m][i] for m in times if m != IEC) > times[IEC][i] for i in range(len(cases))
    )
    overshoot = {
        m: max(max(method_of(one, m)["overshoot"].values()) for one in cases) for m in times
    }
    listing = "; ".join(
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
        verdict_of([fastest, calm]), listing, why,
    )  # fmt: skip


def _frequency(name: str, cases: Sequence[Result], methods: Sequence[Method], by: str) -> Statement:
    """Judge that convergence is quicker the higher the frequency."""
    ordered = sorted(cases, key=lambda one: one["frequency_hz"])
    f = np.array([one["frequency_hz"] for one in ordered])
    holds, listing, exceptions = [], [], []
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
        listing.append(f"{_named(method)}: {by} after {listed} s (exponent {slope:.2f})")
    why = "velocity, which separates b from k, grows with the frequency"
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
        verdict_of(holds), f"at {frequencies} Hz, " + "; ".join(listing), why,
    )  # fmt: skip


def _all_but_integral_damping(cases: Sequence[Result], noisy: Result) -> Statement:
    errors = {m: _errors(cases, "hunt-crossley", m) for m in REPORTED["hunt-crossley"]}
    others = all(max(e.values()) <= SETTLED for m, e in errors.items() if m != IEC)
    missed = errors[IEC]["b"] > SETTLED
    listing = ", ".join(f"{_named(m)} b {100 * e['b']:.2g} %" for m, e in errors.items())
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
        verdict_of([others, missed]), f"largest error of the final b: {listing}", why,
    )  # fmt: skip


def _error_is_constant(simulated: Sequence[Result]) -> Statement:
    holds, listing = [], []
    for model in TRUTH:
        cases = [one for one in simulated if one["model"] == model]
        for method in (RLS, IEC, ALGEBRAIC):
            errors = [method_of(one, method)["nrmse"] for one in cases]
            holds.append(max(errors) - min(errors) <= SMALL_ERROR)
            listing.append(f"{model} {_named(method)} {min(errors):.2g} to {max(errors):.2g}")
    start = [one["nrmse_online"] for case in simulated for one in case["methods"]]
    why = (
        "once converged the force is right at every frequency; the rest is the trapezoid's "
        "error and the prior's, small beside the range of the force"
        if all(holds)
        else f"somewhere it changes by more than {SMALL_ERROR:g} of the range of the force"
    )
    why += (
        f"; with the parameters of each moment, the start included, it is {min(start):.2g} to "
        f"{max(start):.2g} (figure 4.4): that shows how long a method takes to converge"
    )
    return Statement(
        "error-constant", "4.1.3", "The NRMSE of the force hardly depends on the frequency.",
        verdict_of(holds), "; ".join(listing), why,
    )  # fmt: skip


def _one_frequency(conditions: Sequence[Result]) -> Statement:
    """Judge it on one sinusoid about zero and about an offset, each with and without a bias."""
    listed = []
    for one in conditions:
        value = one["condition"]
        number = "infinite" if value is None else f"{value:.2g}"
        where = f"{1e3 * one['mean_m']:g} mm" + (" with bias" if one["bias"] else "")
        listed.append((one["model"], where, number, bool(one["excited"])))
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
