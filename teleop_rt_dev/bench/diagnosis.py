"""Diagnosis against sparse regression on the same records: names, error, false alarms, time."""

from __future__ import annotations

import statistics
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.samples.motion import motion_of
from teleop_rt.diagnosis.samples.smoothing import half_window
from teleop_rt.recordings.recording import from_arrays
from teleop_rt_dev.bench.measure import Row, processor_seconds, row
from teleop_rt_dev.diagnosis.peers_venv import answers_of_peers
from teleop_rt_dev.diagnosis.plants import Record, make

Array = NDArray[np.float64]
# The last of a rich record, its multi-sine, is held out.
SPLIT, TOTAL = 7200, 10_000
ADDITIVE = ("force_bias", "coulomb_friction", "tool_inertia", "force_drift", "quadratic_damping",
            "nonlinear_stiffening")  # fmt: skip
OTHERS = ("stress_relaxation", "channel_delay", "backlash", "second_layer", "hysteresis",
          "force_saturation")  # fmt: skip
NULLS = 6  # two of each colour of noise
_LEAST_SHARE = 0.01
"""Share of the force from which on an effect that was added counts as named."""
_YARDSTICK_ROUNDS = 1000  # about 0.15 s


def dictionary(record: Record) -> tuple[Array, list[str]]:
    """Return columns of additive terms (samples, terms) and the effect that each represents."""
    half = half_window(record.position, 1e-3)
    motion = motion_of(record.position, record.force, 1e-3, 0.0, half)
    x, v, a, t = motion.x, motion.v, motion.a, motion.t
    c, depth = x > 0.0, np.maximum(x, 0.0)
    terms = {
        "stiffness": depth, "damping": c * v, "force_bias": np.ones_like(x), "force_drift": t,
        "coulomb_friction": np.sign(v), "viscous_friction": v, "tool_inertia": a,
        "direction_dependent_damping": np.abs(v), "quadratic_damping": c * v * np.abs(v),
        "nonlinear_stiffening": depth**3, "softening": depth * t,
        "mullins_softening": depth * np.maximum.accumulate(depth),
        "second_layer": np.maximum(depth - 0.5 * np.max(depth), 0.0),
        "hysteresis": c * np.sign(v) * depth, "channel_delay": np.gradient(depth, t),
    }  # fmt: skip
    return np.column_stack(list(terms.values())), list(terms)


def records() -> list[Record]:
    """Return the records: single effects, additive and not, and nothing missing."""
    found = [
        make(900 + i, (effect,), size=0.1, noise=0.01) for i, effect in enumerate(ADDITIVE + OTHERS)
    ]
    kinds = ("white", "ar1", "pink")
    return found + [make(950 + i, (), noise=0.01, kind=kinds[i % 3]) for i in range(NULLS)]


def by_peers(cases: list[Record]) -> dict[str, list[dict[str, Any]]]:
    """Return each peer's answers, by record."""
    tables = [dictionary(record) for record in cases]
    arrays: dict[str, Any] = {"count": len(cases)}
    for i, (record, (theta, _)) in enumerate(zip(cases, tables, strict=True)):
        fold = np.where(np.arange(TOTAL) < SPLIT, -1, 0)
        arrays |= {f"theta{i}": theta, f"force{i}": record.force, f"fold{i}": fold}
    found: dict[str, list[dict[str, Any]]] = {}
    for answer in answers_of_peers(arrays):
        if "error" in answer:
            print(f"{answer['peer']}: {answer['error']}", file=sys.stderr)
            continue
        record, names = cases[answer["record"]], tables[answer["record"]][1]
        shares = dict(zip(names, np.abs(answer["coefficients"]), strict=True))
        extra = {n: s for n, s in shares.items() if n not in {"stiffness", "damping"}}
        kept = {n: s for n, s in extra.items() if s > _LEAST_SHARE}
        first = max(kept, key=lambda n: kept[n]) if kept else None
        found.setdefault(answer["peer"], []).append({
            "truth": record.truth, "first": first, "alarm": bool(kept),
            "over_floor": answer["rms"] / record.noise, "seconds": answer["seconds"],
            "ratio": answer["seconds"] / yardstick(),
        })  # fmt: skip
    return found


def by_us(cases: list[Record]) -> list[dict[str, Any]]:
    """Return the answers of diagnosis, by record."""
    found = []
    for record in cases:
        parts = [
            from_arrays("part", record.t[s], record.position[s], record.force[s])
            for s in (slice(0, SPLIT), slice(SPLIT, TOTAL))
        ]
        begun = time.process_time()
        answer = diagnose(parts[0], record.base, test=parts[1], surface=0.0).answer
        seconds = time.process_time() - begun
        inside = record.position[SPLIT:] > 0.0
        rms = answer["error"]["after"] * float(np.ptp(record.force[SPLIT:][inside]))
        first = answer["class"][0] if answer["class"] else None
        found.append({
            "truth": record.truth, "first": first[0] if first and len(first) == 1 else None,
            "alarm": answer["verdict"] != "no_missing_effect",
            "over_floor": rms / record.noise, "seconds": seconds, "ratio": seconds / yardstick(),
        })  # fmt: skip
    return found


def yardstick() -> float:
    """Return the processor time [s] of a fixed workload in numpy, of spectra and products.

    A ratio to it, measured right after, compares commits on another or a busy machine.
    """
    rows = np.random.default_rng(0).standard_normal((4, TOTAL))

    def work() -> None:
        for _ in range(_YARDSTICK_ROUNDS):
            spectra = np.fft.rfft(rows)
            np.abs(spectra) @ np.abs(spectra).T

    return processor_seconds(work)


def rows_of(name: str, answers: list[dict[str, Any]], *, ours: bool) -> list[Row]:
    """Return the rows of one method; the bars are those of our own."""

    def share(chosen: list[dict[str, Any]], hit: str) -> list[float]:
        return [float(a[hit]) for a in chosen]

    for a in answers:
        a["right"] = bool(a["truth"]) and a["first"] == a["truth"][0]
    additive = [a for a in answers if a["truth"] and a["truth"][0] in ADDITIVE]
    others = [a for a in answers if a["truth"] and a["truth"][0] in OTHERS]
    nulls = [a for a in answers if not a["truth"]]
    seen = [*additive, *others]
    mean = statistics.fmean
    return [
        row(f"{name}: right effect, additive ones", "share", [mean(share(additive, "right"))],
            ">= 0.97" if ours else None),
        row(f"{name}: right effect, the others", "share", [mean(share(others, "right"))],
            ">= 0.97" if ours else None),
        row(f"{name}: false alarms", "share", [mean(share(nulls, "alarm"))],
            "<= 0.005" if ours else None),
        row(f"{name}: held-out error over the noise", "ratio", share(seen, "over_floor"),
            "<= 1.05" if ours else None),
        row(f"{name}: time, one effect", "s", share(seen, "seconds"), "<= 1" if ours else None),
        row(f"{name}: the same, over numpy's yardstick", "ratio", share(seen, "ratio")),
    ]  # fmt: skip


def run(rounds: int) -> list[Row]:
    """Compare on the same records; the figures spread over them, not over rounds."""
    del rounds
    cases = records()
    by_us(cases[:1])
    found = rows_of("teleop-rt", by_us(cases), ours=True)
    for name, answers in by_peers(cases).items():
        found += rows_of(name, answers, ours=False)
    return found
