"""Every row of the fault table, in every phase of a trial: detection, final state, peak force.

    scripts/campaign faults [--seeds N] [--phases P...] [--rows TEXT...] [--processes] [--json]
    scripts/campaign faults --table FILE...

On the simulated clock, where a tick is a millisecond and a bound is exact; then what is counted,
not timed: packets, configs, cuts, killed recorders, a soak. With --processes also on this machine's
clock: daemon and slave killed or frozen, the motor read in the simulated rig's own process. --table
prints what runs with --json have left in files as one table. Exits with 1 where something does
not hold.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "link"))
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "faults"))

from counted_faults import counted
from fault_rows import ROWS, play
from fault_table import markdown
from fault_world import PHASES
from real_faults import killed_processes


def simulated(seeds: int, phases: list[str], wanted: Callable[[str], bool]) -> list[dict[str, Any]]:
    """Play the rows; one result for each row and phase, the worst over the seeds."""
    found = []
    for row in ROWS:
        for phase in (p for p in row.phases if p in phases and wanted(row.name)):
            outcomes = []
            for seed in range(1, seeds + 1):
                with tempfile.TemporaryDirectory() as session:
                    outcomes.append(play(row, phase, seed, Path(session)))
            problems = {o.problem for o in outcomes if o.problem}
            found.append(
                {
                    "fault": row.name,
                    "phase": phase,
                    "clock": "simulated",
                    "seeds": seeds,
                    "detected_ms": max(o.detected_ms for o in outcomes),
                    "bound_ms": row.bound_ms,
                    "state": "/".join(sorted({o.state for o in outcomes})),
                    "named": "/".join(sorted({o.fault for o in outcomes})),
                    "peak_force_N": max(o.peak_force_N for o in outcomes),
                    "problem": "; ".join(sorted(problems)),
                    "holds": not problems,
                }
            )
            show(found[-1])
    return found


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


def main() -> int:
    parser = argparse.ArgumentParser(prog="scripts/campaign faults", description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--phases", nargs="*", default=list(PHASES), choices=PHASES)
    parser.add_argument("--rows", nargs="*", help="only rows whose name holds one of these texts")
    parser.add_argument("--packets", type=int, default=100_000, help="hostile packets")
    parser.add_argument("--configs", type=int, default=300, help="mutated configs")
    parser.add_argument("--processes", action="store_true", help="also kill real processes")
    parser.add_argument("--kills", type=int, default=5, help="how often each process is killed")
    parser.add_argument("--table", nargs="+", type=Path, help="print saved results instead")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    if chosen.table:
        print(markdown(chosen.table))
        return 0

    def wanted(name: str) -> bool:
        return chosen.rows is None or any(text in name for text in chosen.rows)

    found = simulated(chosen.seeds, chosen.phases, wanted)
    beyond = list(counted(chosen.seeds, chosen.packets, chosen.configs, chosen.kills))
    beyond += killed_processes(chosen.kills) if chosen.processes else []
    for name, work in beyond:
        if wanted(name):
            found.append(work())
            show(found[-1])
    holds = all(one["holds"] for one in found)
    if chosen.json:
        print(json.dumps({"campaign": "faults", "rows": found, "holds": holds}))
    else:
        failed = sum(not one["holds"] for one in found)
        print(f"{len(found)} rows and phases, {failed} of them do not hold")
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
