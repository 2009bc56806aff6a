"""The keys of the answer that `teleop-rt diagnose --json` prints, one object per recording."""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired

from pydantic import Field

from teleop_rt.contact.effect import BelongsTo, Compensation, Family
from teleop_rt.diagnosis.draft.terms import Group
from teleop_rt.diagnosis.inference.verdict import Verdict
from teleop_rt.json_schema import Keys


class FittedParameter(Keys):
    """A parameter that was fitted."""

    value: float | None
    """The estimate, in `unit`; null where it is not finite."""
    std: float | None
    """Standard deviation of the estimate, in `unit`; null where the data do not determine it."""
    unit: str
    """Unit of value and std."""
    note: NotRequired[Literal["not identified", "at its bound"]]
    """Present where a parameter of the base is not above zero by two standard deviations, and where
    the value is a bound of the range in which it is searched: the true one may lie beyond it."""
    at_depth: NotRequired[float]
    """Largest depth that was reached [m or rad]; beside the size of a law with x^n only."""
    value_at_depth: NotRequired[float]
    """The size times x^n there, in `unit_at_depth`: of a spring the force."""
    unit_at_depth: NotRequired[str]
    """Unit of value_at_depth."""


class FittedBase(Keys):
    """The base model, fitted together with the effects."""

    model: str
    """A model's name, or terms joined by commas."""
    clamped: bool
    """Whether the base's force is cut at zero, for contact never pulls."""
    clamped_with_effects: bool
    """Whether that cuts base and material effects together, as of a body that lets go."""
    clamped_without_damping: bool
    """Whether that leaves the damping of the base, which may still pull."""
    parameters: dict[str, FittedParameter]
    """Parameters by name."""


class FoundEffect(Keys):
    """An effect that the base model lacks."""

    name: str
    """Name of the effect."""
    law: str
    """Mathematical form, where the effect has several; empty otherwise."""
    family: Family
    """Family of the effect."""
    belongs_to: BelongsTo
    """Whether the effect is the environment's or the rig's."""
    parameters: dict[str, FittedParameter]
    """Amplitude and shape by name."""
    explains: float | None
    """Share of the base's residual that the effect explains [0 to 1]; null for outliers.

    It is the gain beside other effects of the set, averaged over all orders (Shapley 1953), so the
    shares add up to that of the set."""
    absorbed_by_base: float | None
    """Share of the effect's energy that the base alone takes up [0 to 1]; null where undefined."""
    compensation: Compensation
    """The controller's treatment of the effect."""
    sentence: str
    """Sentence about the effect, with its figures in SI."""
    template: str
    """The same with the name of each parameter in braces, for figures in other units."""


class Experiment(Keys):
    """The motion that would decide between the sets of a class."""

    trial: str | None
    """File of the proposed trial; null without --out, or without the trial of the recording."""
    profile: str
    """Name of the motion."""
    why: str
    """The distinction that the motion makes, as a sentence."""
    predicted_separation: float
    """Predicted separation of the two most similar sets, as a chi-square [1]."""


class Candidate(Keys):
    """A set of effects that was tried."""

    effects: list[str]
    """Names of its effects."""
    laws: list[str]
    """The law of each, as in the list of `teleop-rt effects`; the plain law is empty."""
    belongs_to: list[BelongsTo]
    """Whether its effects are the environment's or the rig's."""
    delta_bic: float
    """Evidence for the set over the base alone, as a difference of BIC [1]."""
    explains: float
    """Share of the base's residual that it explains [0 to 1]."""


class Nearest(Keys):
    """The candidate that comes nearest where no set of effects is an answer."""

    effects: list[str]
    """Names of its effects."""
    family: Family
    """Family of its first effect."""
    share: float
    """Share of the base's residual that it explains [0 to 1]."""
    before: float | None
    """NRMSE of the base on unseen data [1]; null where it is not defined."""
    after: float | None
    """NRMSE with the candidate on unseen data [1]; null where it is not defined."""


class Detectable(Keys):
    """The smallest size of an effect that the recording would have shown."""

    name: str
    """Name of the effect."""
    parameter: str
    """The parameter that is its size."""
    size: float | None
    """Size seen in 95 of 100 recordings, in `unit`; null where no size within its bounds is."""
    unit: str
    """Unit of the size."""
    shape: dict[str, float]
    """The shape that shows least: its parameters by name, in the units of the effect."""
    at_depth: NotRequired[float]
    """Largest depth that was reached [m or rad]; beside the size of a law with x^n only."""
    value_at_depth: NotRequired[float]
    """The size times x^n there, in `unit_at_depth`: of a spring the force."""
    unit_at_depth: NotRequired[str]
    """Unit of value_at_depth."""


class Errors(Keys):
    """Error with the base alone and with the best model."""

    before: float | None
    """Error of the base, over the force's standard deviation [1]; null without a prediction."""
    after: float | None
    """Error of the best model, over the force's standard deviation [1]; null like before."""


class LowPassedErrors(Errors):
    """The same with force and prediction low-passed alike."""

    filter: str
    """The filter."""


class DraftError(Keys):
    """Error before and after, on unseen data."""

    metric: Literal["nrmse"]
    """Root-mean-square error over the force's range."""
    on: Literal["held-out blocks", "held-out record"]
    """Whether unseen data are blocks of the recording, or the recording of --test."""
    before: float | None
    """NRMSE of the base [1]; null where it predicts nothing."""
    after: float | None
    """NRMSE of the best model [1]; null where it predicts nothing."""


class Error(DraftError):
    """Error before and after on unseen data, with the noise floor."""

    noise_floor: float | None
    """NRMSE that noise alone leaves [1]; null where the force does not vary. It is an estimate, at
    most the least error of this answer, and beside the verdicts partial and unexplained an upper
    bound: a force that nothing explains may be in it."""
    after_over_floor: float | None
    """`after` over `noise_floor` [1]; null where either is, or the floor is 0."""
    std_normalised: Errors
    """The same errors over the force's standard deviation."""
    std_normalised_low_passed: LowPassedErrors | None
    """The same, low-passed; null for recordings that are too slow for the filter."""


class Draft(Keys):
    """The law that was drafted where the vocabulary has no word."""

    file: str
    """Python file of the law, ready for --effects."""
    terms: list[str]
    """The terms of the law, in words."""
    effect: FoundEffect
    """The law as an effect; it explains this share of the base's mean square."""
    error: DraftError
    """Error before and after the law."""


class InstrumentParameter(Keys):
    """A parameter by instruments, beside that by least squares."""

    value: float | None
    """The estimate by instruments, in `unit`; null where it is not finite."""
    std: float | None
    """Its standard deviation, in `unit`; null where it is not finite."""
    least_squares: float | None
    """The estimate by least squares, in `unit`; null where it is not finite."""
    unit: str
    """Unit of all three."""


class InstrumentErrors(Keys):
    """Errors in free run over the force's standard deviation."""

    std_normalised: float | None
    """Error [1]; null where the force does not vary."""
    std_normalised_low_passed: NotRequired[float | None]
    """Error with the prediction low-passed [1]; absent for recordings too slow for the filter."""


class InstrumentError(Keys):
    """Errors of both kinds of estimate."""

    on: Literal["recording itself", "held-out record"]
    """The recording that was predicted."""
    instruments: InstrumentErrors
    """Errors with the parameters by instruments."""
    least_squares: InstrumentErrors
    """Errors with the parameters by least squares."""


class Instruments(Keys):
    """Linear parameters by instrumental variables, which a closed loop does not bias."""

    source: Annotated[Literal["reference"], Field(alias="from")]
    """The signal that the instruments are made from."""
    parameters: dict[str, InstrumentParameter]
    """Parameters by name."""
    error: InstrumentError
    """Errors of both kinds of estimate on one recording."""


class Gaps(Keys):
    """Missing parts of the recording."""

    count: int
    """How many gaps."""
    samples: int
    """How many samples are missing."""


class Part(Keys):
    """The part of the recording that was diagnosed."""

    from_s: float
    """Its beginning, from the recording's first sample [s]."""
    length_s: float
    """Its length [s]."""


class Answer(Keys):
    """Effects that a base model lacks, found in a recording."""

    recording: str
    """The recording, as it was named."""
    base: FittedBase
    """The base model with its parameters."""
    verdict: Verdict
    """Whether nothing is missing, or effects are named, a class, partial, or unexplained."""
    effects: list[FoundEffect]
    """The effects of the first set; empty where nothing is missing or nothing explains it."""
    sets: Annotated[list[list[str]], Field(alias="class")]
    """Sets of names of effects between which the recording does not decide, the best first."""
    family: Family | None
    """Family of the missing effect for the verdicts partial and unexplained; null where unknown."""
    experiment: Experiment | None
    """The motion that decides; null unless the verdict is class and a motion was found."""
    nearest: Nearest | None
    """The nearest candidate; null unless the verdict is unexplained, or without a candidate."""
    dependence: dict[Group, float] | None
    """Shares of the base's mean square by quantity that the remainder depends on [0 to 1]; null
    unless the verdict is partial or unexplained, or without a law."""
    draft: Draft | None
    """The drafted law; null unless the verdict is partial or unexplained and --out is given."""
    detectable: list[Detectable]
    """Detectable size of each effect that was not found."""
    candidates: list[Candidate]
    """The sets of effects that were tried, the best first, fifteen at most."""
    probability: dict[str, float]
    """Probability by effect, given the vocabulary [0 to 1]; empty where no effect is named."""
    predictor: list[str]
    """The effects with which the force is predicted best."""
    notes: list[str]
    """Reservations about the answer, as sentences."""
    error: Error
    """Error on unseen data."""
    gaps: Gaps
    """Gaps of the recording."""
    instruments: NotRequired[Instruments]
    """Parameters by instruments; absent where the recording has no commanded motion to serve."""
    part: Part
    """The part that the answer is of."""


class Problem(Keys):
    """Why a recording has no answer."""

    recording: str
    """The recording, as it was named."""
    problem: str
    """Cause, place and next step, as one message."""
