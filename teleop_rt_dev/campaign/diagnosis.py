"""Diagnosis campaign: synthetic recordings from independent physics, judged against the bar.

    scripts/campaign diagnosis [--records N] [--json] [--jobs J] [--seed S] [--group G]
        [--generator own|foreign] [--surface given|found]

Prints the table of rates with their 95 % bounds, the confusion matrix, and every wrong answer. The
foreign generator shares nothing with the own one, nor either with the library of effects. Where
the surface is to be found, positions are those of an encoder with an arbitrary zero, and the
surface is not given.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt_dev.diagnosis.foreign_effects import NAMES as FOREIGN_NAMES
from teleop_rt_dev.diagnosis.foreign_motions import NARROW
from teleop_rt_dev.diagnosis.foreign_plants import Foreign, foreign, moved_again
from teleop_rt_dev.diagnosis.motions import RATE_HZ
from teleop_rt_dev.diagnosis.plants import MATERIALS, OUTSIDE_LIBRARY, Record, make
from teleop_rt_dev.diagnosis.table import show, table
from teleop_rt_dev.diagnosis.visibility import foreign_lambda
from teleop_rt_dev.parallel import in_order

FAMILY = {effect.name: effect.family for effect in LIBRARY}
SINGLES = tuple(name for name in FAMILY if name not in {"gravity_torque", "return_spring"})
PAIRS = (
    ("coulomb_friction", "force_bias"), ("stress_relaxation", "coulomb_friction"),
    ("nonlinear_stiffening", "channel_delay"), ("tool_inertia", "force_bias"),
    ("hysteresis", "force_drift"), ("backlash", "periodic_disturbance"),
    ("second_layer", "coulomb_friction"), ("mullins_softening", "force_bias"),
    ("stress_relaxation", "periodic_disturbance"), ("adhesion", "channel_delay"),
    ("contact_offset", "quadratic_damping"), ("position_ripple", "tool_inertia"),
)  # fmt: skip
"""Effects that move the contact come first, as in a rig: damping in free air is no pair."""
ENCODER_STEP_M = 5e-6
"""As the generator of the records rounds its positions."""
SHARES = {
    "null": 0.35, "single": 0.25, "pair": 0.1, "outside": 0.1, "sinusoid": 0.1, "interval": 0.1,
}  # fmt: skip
SEED_NAMES = {"outside": "stranger"}
"""Groups renamed since their records were printed in docs/measured.md: the old name seeds them."""
FOREIGN_SHARES = {"null": 0.4, "single": 0.4, "narrow": 0.2}
NARROW_EFFECTS = tuple(name for name in FOREIGN_NAMES if name != "outliers")
OUTSIDE_FAMILY = {
    "pulsating_stiffness": {"drift", "periodic"},
    "tool_resonance": {"inertia", "periodic", "delay"},
    "thinning_damper": {"damping", "friction"},
    "wandering_gain": {"drift"},
    "depth_waves": {"stiffening", "ripple"},
}


def plan(
    group: str, number: int, seed: int, generator: str = "own", surface: str = "given"
) -> dict[str, Any]:
    """Return the recipe of record `number` of a group; its seed alone decides."""
    rng = np.random.default_rng([seed, number, sum(map(ord, SEED_NAMES.get(group, group)))])
    case: dict[str, Any] = {
        "group": group,
        "generator": generator,
        "surface": surface,
        "seed": int(rng.integers(2**31)),
        "material": str(rng.choice(list(MATERIALS))),
        "motion": "sinusoid" if group == "sinusoid" else "rich",
        "size": float(np.exp(rng.uniform(np.log(0.02), np.log(0.3)))),
        "noise": float(np.exp(rng.uniform(np.log(0.001), np.log(0.05)))),
        "kind": "white",
    }
    effects: tuple[str, ...] = ()
    if group == "null":
        case["kind"] = ("white", "white", "white", "white", "ar1", "pink")[number % 6]
        case["motion"] = ("rich", "rich", "tapping", "sinusoid")[number % 4]
    elif group == "narrow":
        motions = ("tone", *NARROW)
        case["motion"] = motions[rng.integers(len(motions))]
        deep = -float(np.exp(rng.uniform(np.log(0.05), 0.0)))
        case["air"] = float(rng.uniform(0.1, 0.5)) if rng.random() < 0.4 else deep
        effects = (NARROW_EFFECTS[number % len(NARROW_EFFECTS)],)
    elif group == "pair":
        effects = PAIRS[number % len(PAIRS)]
    elif group == "outside":
        effects = (OUTSIDE_LIBRARY[number % len(OUTSIDE_LIBRARY)],)
    elif group == "interval":
        effects = ((), ("force_bias",), ("tool_inertia",), ("contact_offset",))[number // 3 % 4]
        case["noise"] = (0.001, 0.01, 0.05)[number % 3]
        case["material"] = str(rng.choice(["silicone", "foam", "stiff"]))
    else:
        names = SINGLES if generator == "own" else FOREIGN_NAMES
        effects = (names[number % len(names)],)
    case["effects"] = list(effects)
    return case


def excess_lambda(record: Record) -> float:
    """Return the energy of the true effect that the base's own refit leaves, over the noise's."""
    x = np.maximum(record.path, 0.0)
    v = np.gradient(record.path, record.t)
    inside = record.path > 0.0
    powers = (1.0,) if record.base == "kelvin-voigt" else np.linspace(0.8, 3.0, 45)
    best = np.inf
    for n in powers:
        damping = v if record.base == "kelvin-voigt" else x**n * v
        design = np.where(inside, np.array([x**n, damping]), 0.0).T
        rest = record.clean - design @ np.linalg.lstsq(design, record.clean, rcond=None)[0]
        best = min(best, float(rest @ rest))
    stiffness = float(np.std(record.clean) / np.std(x))
    return best / (record.noise**2 + (stiffness * ENCODER_STEP_M) ** 2 / 12.0)


def run(case: dict[str, Any]) -> dict[str, Any]:
    """Diagnose one record and judge the answer."""
    effects = tuple(case["effects"])
    if case["generator"] == "foreign":
        return run_foreign(case, effects)
    record = make(
        case["seed"], effects, case["material"], case["motion"], case["size"], case["noise"],
        case["kind"],
    )  # fmt: skip
    recording = from_arrays("record", record.t, record.position, record.force)
    begun = time.process_time()
    found = diagnosed(recording, record.base, case)
    row = {**case, **judged(found, effects), "lambda": round(excess_lambda(record), 1)}
    row["seconds"] = time.process_time() - begun
    if found is not None and case["group"] == "sinusoid" and found.experiment is not None:
        row["resolved"] = resolved(case, effects, found)
    if case["group"] == "interval":
        row["inside"] = [] if found is None else inside(found, case["material"])
    return row


def run_foreign(case: dict[str, Any], effects: tuple[str, ...]) -> dict[str, Any]:
    """Diagnose a record of the foreign generator, which draws the open parts of the case."""
    record = foreign(case["seed"], effects, **narrow(case))
    begun = time.process_time()
    found = diagnosed(measured(record), record.base, case)
    seconds = time.process_time() - begun
    drawn = {key: record.notes[key] for key in ("size", "noise", "kind", "motion")}
    weight = foreign_lambda(record, surface_found=case["surface"] == "found")
    row = {
        **case, **drawn, **judged(found, effects), "material": record.notes["base"],
        "lambda": round(weight, 1), "seconds": seconds,
    }  # fmt: skip
    if found is not None and found.experiment is not None:
        again = moved_again(record, found.experiment.t, found.experiment.x)
        second = diagnosed(measured(again), record.base, case)
        row["resolved"] = left_alone(second, found, effects)
    return row


def diagnosed(recording: Recording, base: str, case: dict[str, Any]) -> Diagnosis | None:
    """Diagnose a recording with a given surface, or one in an encoder's coordinates without.

    None where it is refused: that is an answer, too.
    """
    try:
        return _diagnosed(recording, base, case)
    except RecordingError:
        return None


def _diagnosed(recording: Recording, base: str, case: dict[str, Any]) -> Diagnosis:
    if case["surface"] == "given":
        return diagnose(recording, base, surface=0.0)
    rng = np.random.default_rng([case["seed"], 3])
    # By rule, a place within a quarter of the deepest penetration from 0 counts as the surface.
    zero = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 5.0) * float(np.max(recording.position))
    return diagnose(replace(recording, position=recording.position + zero), base)


def narrow(case: dict[str, Any]) -> dict[str, Any]:
    """Return arguments of the foreign generator: a narrow motion, of which 10 s are recorded."""
    if case["group"] != "narrow":
        return {}
    return {key: case[key] for key in ("motion", "air", "size", "noise")} | {"seconds": 10.0}


def measured(record: Foreign) -> Recording:
    """Return the recording that a foreign record is to a diagnosis."""
    return from_arrays("record", record.t, record.position, record.force, units=record.units)


_REFUSED: dict[str, Any] = {
    "verdict": "refused", "class": [], "effects": [], "family": None,
    "error": {"after_over_floor": None}, "probability": {},
}  # fmt: skip


def judged(found: Diagnosis | None, effects: tuple[str, ...]) -> dict[str, Any]:
    """Return the grade of the answer for this truth."""
    answer = _REFUSED if found is None else found.answer
    sets = [sorted(s) for s in answer["class"]]
    truth = sorted(effects)
    families = {e["family"] for e in answer["effects"]} | ({answer["family"]} - {None})
    return {
        "verdict": answer["verdict"],
        "class": sets,
        "named": [e["name"] for e in answer["effects"]],
        "family": answer["family"],
        "first": bool(sets) and sets[0] == truth,
        "covered": truth in sets,
        "own_family": families <= OUTSIDE_FAMILY.get(truth[0] if truth else "", set()),
        "after_over_floor": answer["error"]["after_over_floor"],
        "resolved": None,
        "probability": answer["probability"],
    }


def resolved(case: dict[str, Any], effects: tuple[str, ...], first: Diagnosis) -> bool:
    """Return whether the proposed motion, made on the same plant, leaves only the truth."""
    motion = first.experiment
    if motion is None:
        return False
    t = np.arange(round(motion.t[-1] * RATE_HZ)) / RATE_HZ
    record = make(
        case["seed"], effects, case["material"], case["motion"], case["size"], case["noise"],
        case["kind"], path=CubicSpline(motion.t, motion.x)(t),
    )  # fmt: skip
    again = diagnosed(
        from_arrays("again", record.t, record.position, record.force), record.base, case
    )
    return left_alone(again, first, effects)


def left_alone(second: Diagnosis | None, first: Diagnosis, effects: tuple[str, ...]) -> bool:
    """Return whether only the truth is in both classes."""
    if second is None:
        return False
    before = [sorted(s) for s in first.answer["class"]]
    sets = [sorted(s) for s in second.answer["class"]]
    return [s for s in sets if s in before] == [sorted(effects)]


def inside(found: Diagnosis, material: str) -> list[bool]:
    """Return for stiffness and damping whether the 95 % interval contains the truth."""
    _, k, b, _, _ = MATERIALS[material]
    fitted = found.answer["base"]["parameters"]
    if found.answer["verdict"] not in {"no_missing_effect", "named"}:
        return []
    return [
        abs(fitted[name]["value"] - truth) <= 1.96 * fitted[name]["std"]
        for name, truth in (("k", k), ("b", b))
    ]


def main(arguments: list[str]) -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(prog="teleop-rt-dev campaign diagnosis", description=__doc__)
    parser.add_argument("--records", type=int, default=600, help="records in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--group", choices=tuple(SHARES | FOREIGN_SHARES))
    parser.add_argument("--generator", choices=("own", "foreign"), default="own")
    parser.add_argument("--surface", choices=("given", "found"), default="given")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    shares = SHARES if options.generator == "own" else FOREIGN_SHARES
    if options.group:
        shares = {options.group: 1.0}
    cases = [
        plan(group, i, options.seed, options.generator, options.surface)
        for group, share in shares.items()
        for i in range(round(share * options.records))
    ]
    begun = time.perf_counter()
    rows = in_order("campaign diagnosis", (partial(run, c) for c in cases), options.jobs)
    found = table(rows)
    if options.json:
        print(json.dumps({"seed": options.seed, "table": found, "records": rows}))
    else:
        print(f"{len(rows)} records, seed {options.seed}, {time.perf_counter() - begun:.0f} s\n")
        show(rows, found)
    return 0
