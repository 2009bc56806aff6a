"""Detectable sizes, checked by injection: each effect put in at the size that would have been seen.

    scripts/campaign detectable [--effects NAME ...] [--records N] [--seed S] [--jobs J] [--json]

A plain recording states for each effect the size that would be detected in 95 of 100 cases, at its
worst shape. The effect is then added to the force of the same plant at that size, and at half of
it, with other noise in each record, and counted where anything is found missing. The bar is 92 to
98 % at the size and 60 % at most at half of it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.models.simulate import run_step
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt_dev.diagnosis.plants import make
from teleop_rt_dev.diagnosis.table import interval
from teleop_rt_dev.parallel import in_order

EFFECTS = ("force_bias", "quadratic_damping", "coulomb_friction", "stress_relaxation",
           "nonlinear_stiffening", "tool_inertia")  # fmt: skip
SHARES = (1.0, 0.5)  # of the stated size
MATERIAL, NOISE, SECONDS = "silicone", 0.01, 4.0  # noise over the force's deviation
PLANT_SEED = 5  # of the one motion that all cases share


def added(effect: Effect, motion: RecordedMotion, shape: Mapping[str, float]) -> Vector:
    """Return the force of unit amplitude on a motion."""
    eta = np.zeros(max(1, len(effect.shapes)))
    for place, one in enumerate(effect.shapes):
        eta[place] = shape[one.name]
    m = motion
    row = run_step(effect, m.x, m.v, m.a, m.t, m.dt, eta)
    return np.where(m.x > 0.0, row, 0.0) if effect.only_in_contact else row


def plain(noise: float) -> tuple[Recording, float]:
    """Return a plant that misses nothing, and the deviation of its noise [N]."""
    record = make(PLANT_SEED, (), MATERIAL, noise=noise, seconds=SECONDS)
    return from_arrays("plain", record.t, record.position, record.force), record.noise


def rows(name: str, records: int, seed: int) -> list[dict[str, Any]]:
    """Return for the size and for half of it how many records showed the effect."""
    laws = tuple(one for one in LIBRARY if one.name == name)
    recording, noise = plain(NOISE)
    clean = plain(0.0)[0].force
    found = diagnose(recording, "kelvin-voigt", surface=0.0, effects=laws)
    stated = next(one for one in found.answer["detectable"] if one["name"] == name)
    if stated["size"] is None:
        return []
    row = added(laws[0], found.problem.motion, stated["shape"])
    result = []
    for share in SHARES:
        hits = 0
        for number in range(records):
            rng = np.random.default_rng([seed, number, round(100 * share)])
            heard = noise * rng.standard_normal(row.size)
            force = clean[: row.size] + share * stated["size"] * row + heard
            again = replace(recording, position=recording.position[: row.size], force=force,
                            mask=recording.mask[: row.size])  # fmt: skip
            answer = diagnose(again, "kelvin-voigt", surface=0.0, effects=laws).answer
            hits += answer["verdict"] != "no_missing_effect"
        result.append({
            "name": name, "size": stated["size"], "unit": stated["unit"], "shape": stated["shape"],
            "share": share, "hits": hits, "of": records, "bounds": interval(hits, records),
        })  # fmt: skip
    return result


def show(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the table as text."""
    lines = [f"{'effect':24} {'size':>12} {'share':>6} detected"]
    lines += [
        f"{r['name']:24} {r['size']:12.4g} {r['share']:6.2g} {r['hits']} of {r['of']}"
        f"  [{100 * r['bounds'][0]:.0f}, {100 * r['bounds'][1]:.0f}] %  {r['unit']}"
        for r in found
    ]
    for share in SHARES:
        some = [r for r in found if r["share"] == share]
        hits, of = sum(r["hits"] for r in some), sum(r["of"] for r in some)
        low, high = interval(hits, of) if of else (0.0, 1.0)
        lines.append(f"at {share:g} of the size: {hits} of {of}"
                     f"  [{100 * low:.0f}, {100 * high:.0f}] %")  # fmt: skip
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign detectable", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--effects", nargs="*", default=list(EFFECTS))
    parser.add_argument("--records", type=int, default=8, help="of each effect and size")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    calls = (partial(rows, name, chosen.records, chosen.seed) for name in chosen.effects)
    parts = in_order("campaign detectable", calls, chosen.jobs)
    found = [row for part in parts for row in part]
    print(json.dumps(found) if chosen.json else show(found))
    return 0
