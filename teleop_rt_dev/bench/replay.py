"""An hour at 1 kHz through the bank, against plain Python and the same kernel in C."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from teleop_rt.estimation.bank import Bank
from teleop_rt_dev.bench.measure import Row, interleave, ratios, row, seconds
from teleop_rt_dev.bench.workload import Array, bank, oracles, regressions, sizes

TICKS = 3_600_000  # an hour at 1 kHz
CHUNK = 40_000  # ticks at once, of which a round's are made: all 3.6 million need GBs
ORACLE_SLICE = 300  # ticks of the solvers in plain Python, which take far longer for each
SOURCE = Path(__file__).with_name("bank.c")


def in_c(folder: Path) -> ctypes.CDLL | None:
    """Build the C version, or return None where there is no compiler."""
    if shutil.which("cc") is None:
        return None
    library = folder / "bank.so"
    command = ["cc", "-O3", "-shared", "-fPIC", "-o", str(library), str(SOURCE), "-lm"]
    subprocess.run(command, check=True)
    built = ctypes.CDLL(str(library))
    built.bank_run.argtypes = [ctypes.c_void_p] * 7 + [ctypes.c_int64] * 3
    return built


def run_c(library: ctypes.CDLL, one: Bank, phi: Array, y: Array) -> None:
    """Advance the state of a bank by the C version."""
    arrays = (one.state, one.columns, one.active, phi, y, one.lever, one.live)
    library.bank_run(*(array.ctypes.data for array in arrays), *phi.shape)


def run(rounds: int) -> list[Row]:
    phi, y = regressions(CHUNK)
    one, other, plain, n = bank(), bank(), oracles(), sizes()
    per_round = max(1, round(TICKS / CHUNK / rounds))
    lists = [
        [(phi[i, r, : n[r]].tolist(), float(y[i, r])) for r in range(len(n))]
        for i in range(ORACLE_SLICE)
    ]

    def ours() -> None:
        for _ in range(per_round):
            one.run(phi, y)

    def pure() -> None:
        for samples in lists:
            for reference, (p, target) in zip(plain, samples, strict=True):
                reference.step(p, target)

    ticks = per_round * CHUNK
    sides = [lambda: seconds(ours) / ticks, lambda: seconds(pure) / ORACLE_SLICE]
    with tempfile.TemporaryDirectory() as folder:
        library = in_c(Path(folder))
        if library is not None:
            built = library

            def theirs() -> None:
                for _ in range(per_round):
                    run_c(built, other, phi, y)

            sides.append(lambda: seconds(theirs) / ticks)
        times = interleave(rounds, sides)
    return rows_of(times, None if library is None else (one, other))


def rows_of(times: list[list[float]], compared: tuple[Bank, Bank] | None) -> list[Row]:
    """Return the rows of ours, plain Python and, where there is a compiler, of C.

    times: a triple (or pair) of seconds per round; `compared`: our bank and the one that C ran.
    """
    rows = [
        row("bank, 18 rows, 3.6 million ticks", "us/tick", [1e6 * t[0] for t in times]),
        row("plain Python (a slice, per tick)", "us/tick", [1e6 * t[1] for t in times]),
        row("plain Python / bank", "ratio", ratios(times, 1, 0), ">= 30"),
    ]
    if compared is None:
        return [*rows, row("C version: no cc here", "ratio", [], "<= 1.3")]
    one, other = compared
    scale = np.maximum(np.abs(other.theta), 1.0)
    deviation = float(np.max(np.abs(one.theta - other.theta) / scale))
    return [
        *rows,
        row("the same kernel in C, cc -O3", "us/tick", [1e6 * t[2] for t in times]),
        row("bank / C", "ratio", ratios(times, 0, 2), "<= 1.3"),
        row("largest deviation of theta from C", "relative", [deviation]),
    ]
