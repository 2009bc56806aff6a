"""A soak: random faults on the slave daemon, healed, reset and armed again; nothing may grow.

    scripts/campaign soak [--minutes M] [--seed S] [--json]

Exits with 1 where memory or descriptors grew, where a fault was not latched and reset, or where an
exception came out of the loop.
"""

from __future__ import annotations

import argparse
import json

from teleop_rt_dev.faults.soak import after_minutes, soak


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="teleop-rt-dev campaign soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    found = soak(after_minutes(chosen.minutes), chosen.seed)
    if chosen.json:
        print(json.dumps(found))
    else:
        print("\n".join(f"{name}: {value}" for name, value in found.items()))
    return 0 if found["holds"] else 1
