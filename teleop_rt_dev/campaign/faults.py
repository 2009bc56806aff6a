"""Every row of the fault table, in every phase of a trial: detection, final state, peak force.

    scripts/campaign faults [--seeds N] [--phases P...] [--rows TEXT...] [--without TEXT...]
                            [--processes] [--json]
    scripts/campaign faults --table FILE...

On the simulated clock, where a tick is a millisecond and a bound is exact; then rows that are
counted, not timed: packets, configs, cuts, killed recorders, a soak. With --processes also on this
machine's clock: daemon and slave killed or frozen, the motor read in the simulated rig's own
process.

--json prints a line as soon as a row is there, so that a campaign that is ended early has not been
for nothing; --table prints such files as one table. A case that cannot be played is a row, which
does not hold. Exits with 1 where something does not hold.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from teleop_rt_dev.faults.actuator_rows import ACTUATOR_ROWS
from teleop_rt_dev.faults.counted import counted
from teleop_rt_dev.faults.handle_rows import HANDLE_ROWS, WITHIN_MS, HandleRow
from teleop_rt_dev.faults.handle_rows import play as play_handle
from teleop_rt_dev.faults.killed_recorders import KILLED_RECORDERS, killed_in_one_run
from teleop_rt_dev.faults.real import killed_processes
from teleop_rt_dev.faults.rows import ROWS, Outcome, Row, play
from teleop_rt_dev.faults.table import markdown, result
from teleop_rt_dev.faults.world import PHASES, Phase


def simulated(
    seeds: int, phases: list[str], wanted: Callable[[str], bool]
) -> Iterator[dict[str, Any]]:
    """Play the rows; one result for each row and phase, the worst over the seeds."""
    for row in (*ROWS, *ACTUATOR_ROWS):
        for phase in (p for p in row.phases if p in phases and wanted(row.name)):
            yield judged(row, phase, [attempt(row, phase, 1 + seed) for seed in range(seeds)])


def attempt(row: Row, phase: Phase, seed: int) -> Outcome | str:
    """Run one seed; one that cannot be run is reported, and the others still run."""
    with tempfile.TemporaryDirectory() as ring_folder:
        try:
            return play(row, phase, seed, Path(ring_folder))
        except Exception as error:  # noqa: BLE001 - whatever it is, it ends no campaign
            return f"seed {seed} not played: {in_words(error)}"


def in_words(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def judged(row: Row, phase: str, tried: list[Outcome | str]) -> dict[str, Any]:
    """Return the worst of all cases; one that could not be played does not hold."""
    outcomes = [one for one in tried if isinstance(one, Outcome)]
    unplayed = [one for one in tried if isinstance(one, str)]
    problems = sorted({one.problem for one in outcomes if one.problem}) + unplayed
    return result(
        row.name, len(tried), "; ".join(problems), "/".join(sorted({o.state for o in outcomes})),
        phase=phase, played=len(outcomes), bound_ms=row.bound_ms,
        named="/".join(sorted({o.fault for o in outcomes})),
        detected_ms=max((o.detected_ms for o in outcomes), default=None),
        peak_force_N=max((o.peak_force_N for o in outcomes), default=None),
    )  # fmt: skip


def worked(name: str, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return the result of a counted piece; one that raises does not hold."""
    try:
        return work()
    except Exception as error:  # noqa: BLE001 - whatever it is, it ends no campaign
        return result(name, 0, f"not played: {in_words(error)}", "-", played=0)


def show(one: dict[str, Any]) -> None:
    """Print a result as soon as it is there, on standard error, for the run may take minutes."""
    took = "-" if one["detected_ms"] is None else f"{one['detected_ms']:.0f}"
    peak = "-" if one["peak_force_N"] is None else f"{one['peak_force_N']:.1f} N"
    verdict = "holds" if one["holds"] else f"FAILS: {one['problem']}"
    print(
        f"{one['fault']:<40} {one['phase']:<9} {took:>5} / {one['bound_ms'] or '-':<5} ms "
        f"{one['state']:<10} {one['named']:<15} {peak:>8}  {verdict}",
        file=sys.stderr,
        flush=True,
    )


def handle_row(row: HandleRow) -> dict[str, Any]:
    """Play a hazard of the operator's device; its seeds change nothing that the row sees."""
    taken = play_handle(row)
    return result(
        row.name, 1, taken.problem, "let go", phase="contact", bound_ms=WITHIN_MS,
        named=taken.named, detected_ms=taken.took_ms, peak_force_N=row.push_N,
    )  # fmt: skip


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="teleop-rt-dev campaign faults", description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--phases", nargs="*", default=list(PHASES), choices=PHASES)
    parser.add_argument("--rows", nargs="*", help="only rows whose name holds one of these texts")
    parser.add_argument("--without", nargs="*", default=[], help="but none whose name holds these")
    parser.add_argument("--packets", type=int, default=100_000, help="hostile packets")
    parser.add_argument("--configs", type=int, default=300, help="mutated configs")
    parser.add_argument(
        "--recorder-kills", type=int, default=50, help="kills of a recorder in one run"
    )
    parser.add_argument("--processes", action="store_true", help="also kill real processes")
    parser.add_argument("--kills", type=int, default=5, help="how often each process is killed")
    parser.add_argument("--table", nargs="+", type=Path, help="print saved results instead")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    if chosen.table:
        print(markdown(chosen.table))
        return 0

    def wanted(name: str) -> bool:
        named = chosen.rows is None or any(text in name for text in chosen.rows)
        return named and not any(text in name for text in chosen.without)

    pieces = list(counted(chosen.seeds, chosen.packets, chosen.configs))
    pieces += [(row.name, partial(handle_row, row)) for row in HANDLE_ROWS]
    pieces.append((KILLED_RECORDERS, partial(killed_in_one_run, chosen.recorder_kills)))
    pieces += killed_processes(chosen.kills) if chosen.processes else []
    beyond = (worked(name, work) for name, work in pieces if wanted(name))
    played = failed = 0
    for one in chain(simulated(chosen.seeds, chosen.phases, wanted), beyond):
        show(one)
        if chosen.json:
            print(json.dumps(one), flush=True)
        played += 1
        failed += not one["holds"]
    if chosen.json:
        print(json.dumps({"campaign": "faults", "rows": played, "failed": failed}))
    else:
        print(f"{played} rows and phases, {failed} of them do not hold")
    return 1 if failed else 0
