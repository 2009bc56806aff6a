"""Ablation of diagnosis: the worth of each gate and each constant of the judgement.

    scripts/campaign ablate [--records N] [--seed S] [--groups G ...] [--gates NAME ...]
        [--constants [NAME ...]] [--measured TEXT ...] [--keyed FOLDER ...] [--every N]
        [--jobs J] [--json]

Each record is diagnosed as it is, and once more without each gate that did something there: a gate
that does nothing changes nothing. Printed are for each gate

acted     records in which it did something
changed   of these, records whose answer is another without it
saved     answers that are worth more with the gate than without
harmed    answers that are worth less with the gate than without

A right answer is worth more than an honest one, and that more than a wrong one. Records are those
of `campaign diagnosis`, own and foreign, with --measured those of `campaign measured` (`all`, or
texts in their names), and with --keyed every Nth one of `campaign keyed`. The constants of the
judgement are halved and doubled, and the candidates of each record are judged again: `halved` and
`doubled` count the records whose verdict or best set changes. With --constants each record is
diagnosed twice more for each constant outside the judgement, all of them unless some are named:
`changed`, `saved` and `harmed` are as for gates.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.diagnosis import criteria
from teleop_rt_dev.campaign import diagnosis as campaign_diagnosis
from teleop_rt_dev.campaign import keyed as campaign_keyed
from teleop_rt_dev.campaign import measured as campaign_measured
from teleop_rt_dev.diagnosis.replaced import (
    Call,
    Function,
    always,
    instead,
    kept,
    modules,
    scaled,
    watched,
)
from teleop_rt_dev.diagnosis.table import table, wrong
from teleop_rt_dev.parallel import in_order

Case = tuple[str, Any]  # kind of record, and its maker

GROUPS = (  # group, generator, surface
    ("null", "own", "given"), ("null", "foreign", "given"), ("single", "own", "given"),
    ("single", "foreign", "found"), ("pair", "own", "given"), ("outside", "own", "given"),
    ("sinusoid", "own", "given"), ("narrow", "foreign", "given"),
)  # fmt: skip
JUDGEMENTS = ("inference.verdict:judge", "inference.explanation:explain")


_WORTH = {"right": 1, "wrong": -1}  # all else is honest


def first(*arguments: Any, **_: Any) -> Any:
    """Return the first argument: a gate's input, unchanged."""
    return arguments[0]


def second(*arguments: Any, **_: Any) -> Any:
    """Return the second argument: as `first`, of a gate that is given the problem before."""
    return arguments[1]


NEVER = always(value=False)
NO_NAME = always(frozenset())
GATES: dict[str, tuple[str, Function]] = {
    "samples beside gaps": ("samples.preparation:_beside_gaps", always(0.0)),
    "unknown history": ("samples.preparation:_unknown_history", always(0)),
    "contact lost in the body": ("samples.lost_contact:without_contact", always(0.0)),
    "lone samples": ("samples.outliers:outliers", lambda force, *_: np.zeros(force.size)),
    "converter's steps": ("samples.converter:without_steps", first),
    "window by the spectrum": ("samples.smoothing:_quietest", lambda _, __, half, ___: half),
    "impacts of a play": ("samples.preparation:without_impacts", first),
    "dropouts": ("samples.dropouts:dropouts", always([])),
    "held body seen": ("samples.held:is_held", NEVER),
    "left body seen": ("samples.held:is_left", NEVER),
    "body that may be fixed": ("samples.held:may_be_held", NEVER),
    "air that is no air": ("inference.views:_air_ratio", always(0.0)),
    "onset as wide as a gap": ("inference.rounds:_beyond_onset", always(None)),
    "surface behind a weight": ("samples.surface:surface_behind_weight", always(None)),
    "away from touches": ("inference.rounds:_may_rest_on_touches", NEVER),
    "odd beginning": ("samples.beginning:misfits", NEVER),
    "encoder in the noise": ("noise.encoder:knowing_encoder", first),
    "within a step": ("noise.encoder:within_a_step", second),
    "slow noise": ("noise.slow:excess", always(None)),
    "level of the noise": ("noise.level:level_of", lambda row, *_: np.ones(row.size)),
    "louder than noise": ("inference.rounds:_exceeds_noise", NEVER),
    "larger sets under white noise": ("inference.one_more:coarse_one_more", always([])),
    "otherwise clamped": ("inference.search:with_other_clamp", second),
    "past before the recording": ("inference.search:with_past", second),
    "surface at the onset": ("inference.search:_reshaped", always([])),
    "other surfaces": ("inference.screening:_at_surfaces", lambda *given: given[3]),
    "other depths": ("inference.search:_at_other_depths", always([])),
    "surface between samples": ("inference.polishing:_between_samples", second),
    "steps among jumps": ("inference.polishing:polished", second),
    "exchanged partners": ("inference.one_more:exchanged", always([])),
    "other laws of a larger set": ("inference.one_more:by_other_laws", always([])),
    "partner that takes the rest": ("inference.second:_takes_the_rest", NEVER),
    "noise of a needed set": ("inference.rounds:_quieter", always(None)),
    "larger sets that are complete": ("inference.needed:_complete", always(value=True)),
    "residual that is no noise": ("inference.confirmed:_beside_noise_alone", first),
    "likelier than a form": ("inference.needed:_likelier_than_form", first),
    "set that a law is like": ("inference.one_more:alike", always(None)),
    "encoder spared": ("inference.ranking:Ranking._smoothing_gain", always(0.0)),
    "encoder owed": ("inference.verdict:_encoder_advantage", always(0.0)),
    "shows apart": ("inference.tones:shows_tone_or_air_force", NEVER),
    "outdone by a larger set": ("inference.verdict:_surpassed", NEVER),
    "air and contact alike": ("noise.structure:air_contact_mismatch", always(0.0)),
    "laws without their property": ("inference.unsupported:lacks_named_property", NO_NAME),
    "laws at a bound": ("inference.unsupported:at_wrong_bound", NO_NAME),
    "empty extensions": ("inference.verdict:without_empty_extensions", first),
    "misfit as tolerance": ("inference.verdict:_tolerance", always(0.0)),
    "doubt in the noise": ("inference.ranked:scaled_by_doubt", second),
    "confirmed unweighted": ("inference.confirmed:confirmed_unweighted", first),
    "confirmed on blocks": ("inference.on_blocks:OnBlocks.confirm", always(value=True)),
    "no noise": ("noise.not_noise:not_noise", always([])),
    "noise of air after blocks": ("inference.confirmed:_is_hidden", NEVER),
    "weights that predict worse": ("inference.confirmed:_predicts_worse", NEVER),
    "beside the unknown": ("inference.discrepancy:needs_unknown_remainder", NEVER),
    "empty extension of a set": ("inference.explanation:_special_case_fits_as_well", NEVER),
    "names of one prediction": ("inference.explanation:_predict_alike", NEVER),
    "one name of one physics": (
        "inference.explanation:_distinct", lambda order, *_: frozenset(order),
    ),
    "no name that fits no better": ("inference.explanation:_named_set_fits_as_well", NEVER),
}  # fmt: skip
"""Gate -> its module, and its replacement where it is left out."""

_NEARLY_ONE = {"NAMED_SHARE", "POSTERIOR_MASS", "HIGHEST_PROBABILITY", "HIGHEST_BESIDE_UNKNOWN"}
CONSTANTS = tuple(name for name in vars(criteria) if name.isupper() and name not in _NEARLY_ONE)
"""All but shares and probabilities that are nearly 1."""
ELSEWHERE = (
    "diagnosis.inference.one_more:EXTENDED", "diagnosis.inference.search:_LIKELY_EFFECTS",
    "diagnosis.models.behind_joint:_LEAST_SPRING", "diagnosis.models.behind_joint:_RUNAWAY",
    "diagnosis.noise.not_noise:_NORMAL_KURTOSIS", "diagnosis.noise.not_noise:_REPEATED",
    "diagnosis.samples.held:_REPEATED", "diagnosis.samples.motion:_BAND",
    "diagnosis.samples.motion:_TO_AND_FRO", "diagnosis.samples.preparation:_IMPACT_RATIO",
    "diagnosis.samples.range_end:_MOVES_ON", "diagnosis.samples.smoothing:_NORMAL_KURTOSIS",
    "diagnosis.samples.smoothing:_STEPS_POWER_RATIO", "recordings.resampling:_CLOSE",
)  # fmt: skip
"""Constants before the judgement, as `module:NAME`, that each diagnosis reads again. Those that a
law or a kernel took up when it was made, as the ends of a range, do not change any more."""
FACTORS = {"halved": 0.5, "doubled": 2.0}


def again(calls: Sequence[Call]) -> list[tuple[str, list[str]]]:
    """Return verdict and best set of each judgement, with the constants as they are now."""
    found = [function(*arguments, **keys) for function, arguments, keys in calls]
    return [(f.verdict, sorted(f.sets[0].fit.names) if f.sets else []) for f in found]


def by_constants(calls: Sequence[Call]) -> dict[str, list[bool]]:
    """Return for each constant whether a judgement changes where it is halved, and doubled."""
    plain, changed = again(calls), {}
    for name in CONSTANTS:
        value, flags = getattr(criteria, name), []
        users = [module for module in modules() if hasattr(module, name)]
        for factor in (0.5, 2.0, 1.0):
            for module in users:
                setattr(module, name, factor * value)
            flags.append(again(calls) != plain)
        changed[name] = flags[:2]
    return changed


def answered(case: Case) -> tuple[str, int]:
    """Return the answer, as text, and its worth: 1 if right, 0 if honest, -1 if wrong."""
    kind, what = case
    if kind == "measured":
        row = campaign_measured.row(what, Path(os.environ["TELEOP_RT_DATA"]))
    elif kind == "keyed":
        row = campaign_keyed.row(what)
    else:
        row = campaign_diagnosis.run(dict(what))
        table([row])
        row["worth"] = "wrong" if wrong(row) else "right"
    return json.dumps([row["verdict"], row["class"]]), _WORTH.get(row["worth"], 0)


def again_with(case: Case, answer: str, worth: int) -> dict[str, Any]:
    """Diagnose a record again; return whether answer and worth changed, and the time."""
    begun = time.process_time()
    other, still = answered(case)
    return {
        "changed": other != answer, "saved": worth > still,
        "harmed": still > worth, "seconds": time.process_time() - begun,
    }  # fmt: skip


def ablated(case: Case, gates: Sequence[str], constants: Sequence[str] = ()) -> dict[str, Any]:
    """Diagnose a record, again without each gate that acted, and by other constants."""
    acted: dict[str, list[bool]] = {gate: [] for gate in gates}
    calls: list[Call] = []
    begun = time.process_time()
    with ExitStack() as stack:
        for gate in gates:
            path, without = GATES[gate]
            stack.enter_context(instead(path, watched(without, acted[gate])))
        for judgement in JUDGEMENTS:
            stack.enter_context(instead(judgement, kept(calls)))
        answer, worth = answered(case)
    seconds = time.process_time() - begun
    found: dict[str, Any] = {"seconds": seconds, "right": worth > 0, "gates": {}}
    found["constants"] = by_constants(calls)
    for gate in (gate for gate, flags in acted.items() if flags):
        path, without = GATES[gate]
        with instead(path, always(without)):
            found["gates"][gate] = again_with(case, answer, worth)
    found["elsewhere"] = {name: {} for name in constants}
    for name, tried in found["elsewhere"].items():
        for how, factor in FACTORS.items():
            with scaled(name, factor):
                tried[how] = again_with(case, answer, worth)
    return found


def show_elsewhere(rows: Sequence[dict[str, Any]], constants: Sequence[str]) -> list[str]:
    """Return the table of constants outside the judgement, in Markdown."""
    counted = ("changed", "saved", "harmed")
    lines = ["", "| constant elsewhere | factor | changed | saved | harmed |",
             "| --- | --- | --- | --- | --- |"]  # fmt: skip
    for name in constants:
        for how in FACTORS:
            counts = (sum(r["elsewhere"][name][how][key] for r in rows) for key in counted)
            lines.append(f"| {name} | {how} | {' | '.join(map(str, counts))} |")
    return lines if constants else []


def show(
    rows: Sequence[dict[str, Any]], gates: Sequence[str], constants: Sequence[str] = ()
) -> str:
    """Return the tables as text, in Markdown."""
    right = sum(r["right"] for r in rows)
    lines = [f"{len(rows)} records, {right} answered rightly", "",
             "| gate left out | acted | changed | saved | harmed | time |",
             "| --- | --- | --- | --- | --- | --- |"]  # fmt: skip
    for gate in gates:
        ones = [(r["gates"][gate], r["seconds"]) for r in rows if gate in r["gates"]]
        counts = Counter(key for one, _ in ones for key in ("changed", "saved", "harmed")
                         if one[key])  # fmt: skip
        spent, whole = sum(one["seconds"] for one, _ in ones), sum(s for _, s in ones)
        share = f"{spent / whole:.2f}" if whole else "-"
        lines.append(f"| {gate} | {len(ones)} | {counts['changed']} | {counts['saved']} |"
                     f" {counts['harmed']} | {share} |")  # fmt: skip
    lines += ["", "| constant of the judgement | halved | doubled |", "| --- | --- | --- |"]
    for name in CONSTANTS:
        halved, doubled = (sum(r["constants"][name][i] for r in rows) for i in (0, 1))
        lines.append(f"| {name} = {getattr(criteria, name):g} | {halved} | {doubled} |")
    return "\n".join([*lines, *show_elsewhere(rows, constants)])


def cases(
    records: int,
    seed: int,
    groups: Sequence[str],
    measured: Sequence[str],
    keyed: Sequence[Path] = (),
    every: int = 1,
) -> list[Case]:
    """Return the maker of each record: so many of each group, and those measured and keyed."""
    drawn: list[Case] = [
        ("drawn", campaign_diagnosis.plan(group, number, seed, generator, surface))
        for group, generator, surface in GROUPS
        if not groups or group in groups
        for number in range(records)
    ]  # fmt: skip
    known = [entry for folder in keyed for entry in campaign_keyed.entries(folder)][::every]
    return [*drawn, *(("keyed", entry) for entry in known),
            *(("measured", entry) for text in measured
              for entry in campaign_measured.keyed([text] if text != "all" else [])
              if entry["keys"] is not None)]  # fmt: skip


def named(parts: Sequence[str] | None) -> list[str]:
    """Return the constants whose names hold one of these; all for none, and none without a list."""
    if parts is None:
        return []
    return [name for name in ELSEWHERE if not parts or any(part in name for part in parts)]


def main(arguments: list[str]) -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign ablate", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--records", type=int, default=6, help="of each group")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--groups", nargs="*", default=[], choices=sorted({g for g, *_ in GROUPS}))
    parser.add_argument("--gates", nargs="*", default=list(GATES), choices=list(GATES))
    parser.add_argument("--constants", nargs="*", metavar="NAME",
                        help="constants outside the judgement, by name or part of it")  # fmt: skip
    parser.add_argument("--measured", nargs="*", default=[], metavar="TEXT",
                        help="measured recordings whose names hold it, or all")  # fmt: skip
    parser.add_argument("--keyed", nargs="*", type=Path, default=[], metavar="FOLDER",
                        help="folders of `campaign keyed`")  # fmt: skip
    parser.add_argument("--every", type=int, default=1, help="each Nth of their records")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    if chosen.measured and not os.environ.get("TELEOP_RT_DATA"):
        print("campaign ablate: set TELEOP_RT_DATA to the folder of recordings", file=sys.stderr)
        return 2
    tried = cases(chosen.records, chosen.seed, chosen.groups, chosen.measured, chosen.keyed,
                  chosen.every)  # fmt: skip
    constants = named(chosen.constants)
    calls = (partial(ablated, case, chosen.gates, constants) for case in tried)
    rows = in_order("campaign ablate", calls, chosen.jobs)
    print(json.dumps(rows) if chosen.json else show(rows, chosen.gates, constants))
    return 0
