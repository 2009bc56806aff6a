"""The keys of summary.json, as `summarise` makes it and `teleop-rt run --json` prints it."""

from __future__ import annotations

from typing import Literal, NotRequired

from teleop_rt.estimation.report_keys import EstimatorRow, SelectedEstimator
from teleop_rt.json_schema import Keys
from teleop_rt.trial.felt_keys import FeltForce
from teleop_rt.trial.loop_keys import LoopLateness, Quantiles
from teleop_rt.trial.safety_keys import Safety


class Software(Keys):
    """Which software ran, and where."""

    version: str
    """Version of teleop-rt."""
    commit: str | None
    """Commit of its source, `-dirty` where it was changed since; null where it is not known."""
    python: str
    """Version of Python."""
    platform: str
    """Operating system, kernel and processor."""


class WorstSurface(Keys):
    """The worst of the surface in the whole run, the first touch included.

    Null where the true surface is not known, or moves by itself.
    """

    surface_error: float | None
    """Largest error of the surface that the slave had, in the contact's unit."""
    surface_error_s: float | None
    """Time of it, from the slave's first tick [s]."""
    deepest: float | None
    """Deepest press into the true surface, in the contact's unit; null without one."""


class ContactFound(Keys):
    """The surface that was found, and the number of contacts."""

    surface_found: float | None
    """Position of the surface, in `unit`; null where it was not found."""
    surface_true: float | None
    """True position of a simulated surface, in `unit`; null where it is not known."""
    worst: WorstSurface
    """The worst of the surface in the whole run."""
    unit: Literal["m", "rad"]
    """Unit of the positions."""
    onsets: int
    """Number of onsets of contact."""
    brief_touch_ms: NotRequired[float]
    """Longest time above contact.onset_force that was too short for a contact [ms]; absent where
    there was a contact, or no such time."""
    reason: NotRequired[str]
    """Why a position is null; absent where neither is."""


class Adequacy(Keys):
    """Whether the selected model left structure in the force."""

    inadequate: bool | None
    """Whether it did at the end; null where there was too little contact to judge it."""
    raised: bool
    """Whether it ever did."""
    first_raised_s: float | None
    """Time at which it first did, from the first tick [s]; null if it never did."""
    share_of_contact: float | None
    """Share of the ticks in contact at which it did [1]; null without contact."""


class LinkEnd(Keys):
    """Counts of one end of the link; null if its process ended before it could report them."""

    trouble: NotRequired[str | None]
    """Why the link was not connected at the end, as a sentence; null if it was."""
    sent: int | None
    """Packets sent; null where it is not known."""
    received: int | None
    """Packets received; null where it is not known."""
    lost: int | None
    """Packets that never came; null where it is not known."""
    overtaken: int | None
    """Packets that came after a newer one; null where it is not known."""
    rejected: int | None
    """Packets not accepted, without those overtaken; null where it is not known."""
    rejected_by_reason: NotRequired[dict[str, int]]
    """The same by reason; absent where it is not known."""
    round_trip_ms: float | None
    """Smoothed round trip [ms]; null before the first one."""
    take_overs: NotRequired[int]
    """Number of takeovers of the link by another master; absent if it is not known."""


class Link(LinkEnd):
    """Counts of the slave's end of the link, and the master's below it."""

    master: NotRequired[LinkEnd]
    """Counts of the master's end; absent in a summary from the recording alone."""
    refused: int | None
    """Packets that both ends rejected; null where it is not known."""


class RecorderLosses(Keys):
    """Losses of the recorder."""

    dropped: dict[str, int] | None
    """Rows that were not recorded, by topic; null if the recorder could not report them."""
    alarm: NotRequired[str]
    """Problem of the recording, empty without one; absent on simulated time."""
    restarts: NotRequired[int]
    """Number of restarts of the recorder; absent on simulated time."""


GradeName = Literal["good", "attention", "bad", "unknown"]


class Grades(Keys):
    """Grade of each part of the run, by the criteria that pages and terminal use as well."""

    felt_force: GradeName
    """Error and lag of the force under the hand; unknown without a reference."""
    phantom: GradeName
    """Worst force felt where the true environment gives none; unknown without a reference."""
    model: GradeName
    """Error of the selected model, and whether it leaves structure in the force."""
    surface: GradeName
    """Worst error of the surface in the whole run; unknown where the true one is."""
    safety: GradeName
    """Whether a fault ended the run, or a safeguard was missing."""
    loop: GradeName
    """Share of missed ticks."""
    link: GradeName
    """Connection of the link at the end, and the share of lost packets."""


class Summary(Keys):
    """The results of a trial."""

    trial: str
    """Name of the trial."""
    began_at: str | None
    """Start of the run: date, time and zone (ISO 8601); null if it is not known."""
    software: Software
    """Version of the software, and its machine."""
    clock: Literal["real", "simulated"]
    """The clock of the run."""
    seed: int
    """Seed of all random numbers."""
    start_up_s: float | None
    """Time from the command to the slave's first tick [s]; null on simulated time."""
    duration_s: float
    """Time from the slave's first tick to its last [s]."""
    planned_s: float
    """The trial's `duration_s` [s], which a run that was cut off did not reach."""
    interrupted: bool
    """Whether somebody ended the run before its time."""
    ticks: int
    """Number of recorded ticks of the slave."""
    missed_ticks: int | None
    """Ticks that the slave missed; null if its process ended before it could report them."""
    late: LoopLateness | None
    """Lateness of the slave's loop; null where it is not known."""
    wake_latency_us: Quantiles | None
    """Wake-up latency of the slave's loop [us]; null on simulated time."""
    work_us: Quantiles | None
    """Work time of a tick of the slave [us]; null on simulated time."""
    contact: ContactFound
    """The surface, and the contacts with it."""
    estimators: list[EstimatorRow]
    """Results of each estimator of the bank."""
    selected: SelectedEstimator | None
    """The estimator that was selected; null where none was."""
    adequacy: Adequacy
    """Whether the selected model suffices."""
    link: Link
    """Counts of the link."""
    master: FeltForce
    """The rendered force of the master."""
    safety: Safety
    """The end of the slave's safety chain."""
    recorder: RecorderLosses
    """Rows that the recorder lost, and why."""
    privileges: list[str]
    """Privileges of the slave's process, granted or refused; empty on simulated time."""
    notes: list[str]
    """Reservations about the figures, as sentences."""
    grades: Grades
    """Grades of the parts of the run."""
