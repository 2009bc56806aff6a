"""The commands on recordings, and their output."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from teleop_rt.batch.workers import Workers
from teleop_rt.diagnosis.answers.errors import is_beaten, predicts_worse
from teleop_rt.diagnosis.inference.rounds import INCONCLUSIVE
from teleop_rt.estimation.report import best_first
from teleop_rt.metrics import in_percent
from teleop_rt.offline.find import names_one
from teleop_rt.offline.many import each
from teleop_rt.offline.replay import Choice
from teleop_rt.offline.table import Table
from teleop_rt.offline.work import Diagnosing, Replaying
from teleop_rt.offline.write import report_missing_page
from teleop_rt.trial.table import estimator_lines
from teleop_rt.view.quantities import size_seen
from teleop_rt.view.style import effect_in_words, number, parameter

_ORDER = "; estimators: selected on-line (*), then identified, then the others, each by NRMSE"
_SAID_OF_PREDICTOR = "the errors are those of the set that predicts best: "
"""Beginning of a note that the line on the errors says already."""
_SHOWN_ROWS = 5
"""Estimators that a replay prints: as many as fit a screen with their parameters."""


def replay(
    recordings: list[Path],
    choice: Choice,
    table: Table,
    workers: Workers,
    *,
    trace: Path | None,
    effects: Path | None,
    out: Path | None,
    every: bool,
    as_json: bool,
) -> None:
    """Run the estimators over recordings, and print the best, or `every` one."""
    work = Replaying(choice, table, trace, effects, several=not names_one(recordings))
    each(work, recordings, workers, out, partial(print_replay, every=every), as_json=as_json)


def diagnose(
    recordings: list[Path],
    base: str,
    surface: float | None,
    table: Table,
    workers: Workers,
    *,
    test: Path | None,
    effects: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Diagnose recordings, and print the answers."""
    several = not names_one(recordings)
    work = Diagnosing(base, surface, table, test, effects, out, several=several)
    if out is not None:
        report_missing_page()
    each(work, recordings, workers, out, print_diagnosis, as_json=as_json)


def print_replay(console: Console, answer: dict[str, Any], *, every: bool) -> None:
    """Print the estimators, best first; the best few of many unless `every` one is wanted."""
    text = f"[bold]{escape(answer['recording'])}[/bold]: {answer['samples']} samples"
    console.print(text + _ORDER, highlight=False, soft_wrap=True)
    rows = best_first(answer["estimators"], answer["selected"])
    shown = rows if every else rows[:_SHOWN_ROWS]
    for line in estimator_lines(answer | {"estimators": shown}):
        console.print(line, highlight=False, soft_wrap=True)
    if answer["selected"] is None:
        console.print("  none is selected: no estimator is identified", highlight=False)
    _print_gaps(partial(console.print, highlight=False, soft_wrap=True), answer)
    for note in answer["notes"]:
        console.print(f"  note: {note}", highlight=False, soft_wrap=True)
    if len(rows) > len(shown):
        console.print(f"  and {len(rows) - len(shown)} more: --all prints them", highlight=False)


def print_effects(console: Console, answer: Mapping[str, Any]) -> None:
    """Print the effects that a diagnosis found, with their parameters, and the class."""
    for effect in answer["effects"]:
        values = ", ".join(parameter(name, one) for name, one in effect["parameters"].items())
        text = f"  {effect['name']} ({effect['belongs_to']}): {values}"
        console.print(text, highlight=False, soft_wrap=True)
        words = f"    {effect_in_words(effect)}{_evidence(effect, answer['probability'])}"
        console.print(words, highlight=False, soft_wrap=True)
    if len(answer["class"]) > 1:
        first = [effect["name"] for effect in answer["effects"]]  # in the order of the lines above
        sets = "; or ".join(" + ".join(names) for names in (first, *answer["class"][1:]))
        console.print(f"  one of: {sets}", highlight=False, soft_wrap=True)


def _evidence(effect: Mapping[str, Any], probability: Mapping[str, float]) -> str:
    """Return probability and share of an effect as a sentence; empty for outliers."""
    if (chance := probability.get(effect["name"])) is None:
        return ""
    share = in_percent(effect["explains"], 3)
    return f" Probability {chance:.2f}; explains {share} of the base's residual."


def print_draft(console: Console, answer: Mapping[str, Any]) -> None:
    """Print where a drafted law was written, and the errors with it."""
    draft = answer["draft"]
    if draft is None:
        return
    error = draft["error"]
    before, after = number(error["before"]), number(error["after"])
    worse = ", worse than the set of effects above" if predicts_worse(answer) else ""
    console.print(
        f"  drafted law: {'; '.join(draft['terms'])}: NRMSE on {error['on']}: before {before},"
        f" after {after}{worse}; {draft['file']} is ready for --effects",
        highlight=False,
        soft_wrap=True,
    )


def print_diagnosis(console: Console, answer: dict[str, Any]) -> None:
    """Print the answer of a diagnosis: names, errors, the next experiment and notes."""
    say = functools.partial(console.print, highlight=False, soft_wrap=True)
    verdict = answer["verdict"].replace("_", " ")
    console.print(f"[bold]{escape(answer['recording'])}[/bold]: {verdict}", soft_wrap=True)
    base = answer["base"]
    values = ", ".join(parameter(name, value) for name, value in base["parameters"].items())
    say(f"  {base['model']} (base): {values}")
    doubts = [note for note in answer["notes"] if "--base " in note or "--surface," in note]
    for note in doubts:  # before the names that a wrong base or surface would give
        say(f"  note: {note}")
    print_effects(console, answer)
    _print_errors(say, answer)
    print_draft(console, answer)
    if (experiment := answer["experiment"]) is not None:
        where = "" if experiment["trial"] is None else f"; run {experiment['trial']}"
        say(f"  to decide: {experiment['why']}{where}")
    _print_gaps(say, answer)
    for note in answer["notes"]:
        if note not in doubts and not note.startswith(_SAID_OF_PREDICTOR):
            say(f"  note: {note}")
    for name, entry in answer.get("instruments", {"parameters": {}})["parameters"].items():
        say(
            f"  {name} by instruments from the reference: {number(entry['value'])} {entry['unit']},"
            f" by least squares {number(entry['least_squares'])}"
        )
    seen = [
        f"{one['name'].replace('_', ' ')} {size_seen(one, base['parameters'])}"
        for one in answer["detectable"]
        if one["size"] is not None
    ]
    if answer["verdict"] == "no_missing_effect" and seen:
        say("  would have been detected (shapes: --json), above:")
        for line in _in_two_columns(seen):
            say(f"    {line}")


def _print_gaps(say: Callable[[str], None], answer: Mapping[str, Any]) -> None:
    """Print how many samples are missing, if any; kept answers of 0.2 do not say."""
    gaps = answer.get("gaps", {"samples": 0})
    if gaps["samples"]:
        samples, count = _counted(gaps["samples"], "sample"), _counted(gaps["count"], "gap")
        say(f"  {samples} missing in {count}")


def _print_errors(say: Callable[[str], None], answer: dict[str, Any]) -> None:
    """Print the errors of prediction, and properties of the unexplained remainder."""
    error = answer["error"]
    ends = error["before"], error["after"]
    worse = None not in ends and ends[1] > ends[0]
    if answer["predictor"] and set(answer["predictor"]) != {e["name"] for e in answer["effects"]}:
        best = "chosen to predict" if is_beaten(answer) else "predicts best with"
        best = "no set predicts better than the base; the nearest" if worse else best
        say(f"  {best}: {' + '.join(answer['predictor'])}; these are its errors")
    before, after, floor = (number(error[key]) for key in ("before", "after", "noise_floor"))
    bound = "at most " if answer["verdict"] in INCONCLUSIVE else ""
    say(f"  NRMSE on {error['on']}: before {before}, after {after}, noise floor {bound}{floor}")
    if (nearest := answer["nearest"]) is not None:
        say(
            f"  nearest: {' + '.join(nearest['effects'])}, of the family {nearest['family']},"
            f" explains {100.0 * nearest['share']:.0f} % of the base's residual: NRMSE before"
            f" {number(nearest['before'])}, after {number(nearest['after'])}"
        )
    if answer["dependence"] is not None:
        parts = sorted(answer["dependence"].items(), key=lambda item: -item[1])
        text = ", ".join(f"{group} {100.0 * share:.0f} %" for group, share in parts if share > 0.0)
        say(f"  the remainder depends on: {text}")


def _in_two_columns(texts: Sequence[str]) -> Iterator[str]:
    """Give the texts in two columns, which are read downwards."""
    rows = (len(texts) + 1) // 2
    width = max(map(len, texts[:rows]))
    for left, right in zip_longest(texts[:rows], texts[rows:], fillvalue=""):
        yield f"{left:{width}}   {right}".rstrip()


def _counted(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
