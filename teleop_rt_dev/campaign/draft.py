"""Draft campaign: an effect is taken out of the library, and a law drafted in its place.

    scripts/campaign draft [--effects NAME ...] [--seeds N] [--jobs J] [--json]

Each plant is recorded once, over two motions; the law is drafted on the first and scored on the
second. Printed are the verdict without the effect, the terms of the law, NRMSE on the second motion
of the base, of the true effect and of the draft, and the draft's share of the error that the
true effect takes (the bar is 0.8). Where other effects stand in for the one taken out, the law is
drafted all the same, of all that the base leaves. Exits with 1 where a draft stays below the bar.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.draft.drafted import drafted
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt_dev.diagnosis.motions import RATE_HZ, rich
from teleop_rt_dev.diagnosis.plants import MATERIALS, make
from teleop_rt_dev.parallel import in_order

EFFECTS = (
    "nonlinear_stiffening", "second_layer", "stress_relaxation", "hysteresis", "mullins_softening",
    "quadratic_damping", "adhesion", "coulomb_friction", "direction_dependent_damping",
    "tool_inertia",
)  # fmt: skip
BAR = 0.8
"""Share of the error that the true effect takes, which a draft has to take."""
LEAST_TAKEN = 0.1  # of the base's error: where the true effect takes less, no draft can be judged
MATERIAL, SIZE, NOISE = "silicone", 0.15, 0.01  # of the force's deviation
SECONDS, FADE_S = 6.0, 0.25


def recordings(effect: str, seed: int) -> tuple[Recording, Recording]:
    """Return one plant with the effect, recorded over two motions after each other."""
    depth = MATERIALS[MATERIAL][4]
    first, second = (rich(np.random.default_rng([seed, i]), depth, SECONDS) for i in range(2))
    over = round(FADE_S * RATE_HZ)
    share = np.linspace(0.0, 1.0, over)
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    blend = (1.0 - share) * first[-over:] + share * second[:over]
    path = np.concatenate((first[:-over], blend, second[over:]))
    made = make(seed, (effect,), MATERIAL, size=SIZE, noise=NOISE, path=path)
    middle = round(SECONDS / (made.t[1] - made.t[0]))
    return tuple(
        from_arrays(name, made.t[part] - made.t[part][0], made.position[part], made.force[part])
        for name, part in (("first", slice(None, middle)), ("second", slice(middle, None)))
    )  # type: ignore[return-value]  # a pair


def row(effect: str, seed: int) -> dict[str, Any]:
    """Return the table's row of one effect taken out."""
    first, second = recordings(effect, seed)
    true = diagnose(first, "kelvin-voigt", surface=0.0, test=second).answer
    rest = tuple(one for one in LIBRARY if one.name != effect)
    found = diagnose(first, "kelvin-voigt", surface=0.0, test=second, effects=rest)
    without = found.answer
    if without["effects"]:
        found = diagnose(first, "kelvin-voigt", surface=0.0, test=second, effects=())
    with tempfile.TemporaryDirectory() as folder:
        draft = drafted(found, first, Path(folder))
        error = None if draft is None else draft.predicted(second, 0.0).errors
    taken = true["error"]["before"] - true["error"]["after"]
    measurable = taken > LEAST_TAKEN * true["error"]["before"]
    after = None if error is None else error["after"]
    return {
        "effect": effect, "seed": seed,
        "true": true["class"], "without": without["class"] or without["verdict"],
        "terms": [] if draft is None else [term.words for term in draft.law.terms],
        "shares": None if draft is None else draft.law.shares,
        "before": true["error"]["before"], "after_true": true["error"]["after"],
        "after_draft": after,
        "takes": None if not measurable else
        0.0 if after is None else (true["error"]["before"] - after) / taken,
    }  # fmt: skip


def show(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table as text."""
    lines = [
        f"{'effect taken out':28} {'base':7} {'true':7} {'draft':7} {'takes':6} law | without it"
    ]
    for r in rows:
        draft = "-" if r["after_draft"] is None else f"{r['after_draft']:.4f}"
        takes = "-" if r["takes"] is None else f"{r['takes']:.2f}"
        without = r["without"]
        named = without if isinstance(without, str) else " | ".join("+".join(s) for s in without)
        lines.append(
            f"{r['effect']:28} {r['before']:.4f}  {r['after_true']:.4f}  {draft:7}"
            f" {takes:6} {'; '.join(r['terms'])} | {named}"
        )
    judged = [r["takes"] for r in rows if r["takes"] is not None]
    enough = sum(takes >= BAR for takes in judged)
    count = f"{enough} of {len(judged)} drafts take {BAR:g} and more"
    return "\n".join([*lines, f"{count}; {len(rows) - len(judged)} cannot be judged"])


def main(arguments: list[str]) -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign draft", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--effects", nargs="*", default=list(EFFECTS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    calls = (
        partial(row, effect, seed)
        for effect in chosen.effects
        for seed in range(1, chosen.seeds + 1)
    )
    rows: list[dict[str, Any]] = in_order("campaign draft", calls, chosen.jobs)
    print(json.dumps({"campaign": "draft", "rows": rows}) if chosen.json else show(rows))
    return 0 if all(r["takes"] is None or r["takes"] >= BAR for r in rows) else 1
