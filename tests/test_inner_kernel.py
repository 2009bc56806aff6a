import os
import pickle
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from llvmlite import binding
from numba.core import compiler

from teleop_rt.kernels.jit import inlined_kernel, kernel


@kernel
def halved(x: float) -> float:
    if x < 0.0:
        raise ValueError("negative")
    return 0.5 * x


@kernel
def quartered(x: float) -> float:
    return halved(halved(x))


@inlined_kernel
def power(x: float, count: int) -> float:
    product = 1.0
    for _ in range(count):
        product *= x
    return product


@kernel
def cubed(x: float) -> float:
    return power(x, 3)


def test_a_kernel_that_a_kernel_has_taken_in_is_complete_for_python_and_as_a_pointer():
    assert quartered(8.0) == 2.0
    assert not halved.signatures, "Python has not called it: nothing complete is there to call"
    assert halved(8.0) == 4.0

    @numba.njit(numba.float64(numba.types.FunctionType(numba.float64(numba.float64))))
    def called(function):
        return function(8.0)

    assert (called(halved), called(quartered)) == (4.0, 2.0)


def test_the_flavour_of_a_kernel_for_kernels_cannot_be_called_by_python():
    assert quartered(8.0) == 2.0
    # No public name leads to it, so that nobody calls it but by a mistake in `kernels/inner.py`.
    with pytest.raises(TypeError, match="halved: only kernels call this flavour"):
        halved._inner(8.0)


def test_what_a_kernel_within_a_kernel_raises_reaches_python():
    with pytest.raises(ValueError, match="negative"):
        quartered(-1.0)


def test_an_inlined_kernel_computes_what_its_source_says():
    assert (cubed(3.0), power(3.0, 2)) == (27.0, 9.0)


BRANCHES = """
from pathlib import Path
from teleop_rt.kernels import jit
from teleop_rt.kernels.jit import kernel

@kernel
def deepest(x: float) -> float:
    return x + 1.0

@kernel
def first(x: float) -> float:
    if False:
        return deepest(x)
    return 2.0 * x

@kernel
def second(x: float) -> float:
    return deepest(x) * 3.0

@kernel
def both(x: float) -> float:
    return first(x) + second(x)

@kernel
def outermost(x: float) -> float:
    return both(x)

print(outermost(1.0), outermost.stats.cache_hits.total())
print(*sorted(path.name.split("-")[0] for path in jit.kernel_folder(Path(__file__)).glob("*.nbc")))
"""


def printed(program: Path) -> str:
    """Return the output of a program, with a cache of kernels beside it."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(program.parent / "cache")}
    command = [sys.executable, program]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    ).stdout


def test_only_the_outermost_kernel_is_cached_with_all_that_any_branch_calls(tmp_path):
    program = tmp_path / "branches.py"
    program.write_text(BRANCHES)
    assert printed(program) == "8.0 0\nbranches.outermost\n"
    assert printed(program) == "8.0 1\nbranches.outermost\n"


def test_options_of_the_compiler_are_equal_where_all_their_values_are(monkeypatch):
    options = compiler.Flags
    # numba's own comparison, which takes long: it is not to be used.
    monkeypatch.setattr(options, "values", None)
    as_it_is, named, another = options(), options(), options()
    named.nrt = as_it_is.nrt
    another.nrt = not as_it_is.nrt
    assert as_it_is == named
    assert as_it_is != another
    assert as_it_is != "options"
    assert {as_it_is: 1}[named] == 1
    assert another not in {as_it_is: 1}


COMPILED_BEFORE = """
import sys
import kernels
assert kernels.twice(21.0) == 42.0
print(*[name for name in ("numba.cpython.listobj", "numba.typed.dictimpl") if name in sys.modules])
"""


def test_code_from_the_cache_is_loaded_without_what_only_compiling_needs(tmp_path):
    (tmp_path / "kernels.py").write_text(
        "from teleop_rt.kernels.jit import kernel\n"
        "@kernel\ndef twice(x: float) -> float: return 2.0 * x\n"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    compiling, loading = (
        subprocess.run(
            [sys.executable, "-c", COMPILED_BEFORE],
            cwd=tmp_path, env=environment, capture_output=True, text=True, check=True,
        ).stdout.split()
        for _ in range(2)
    )  # fmt: skip
    assert compiling
    assert not loading


LOADED = """
import sys
from teleop_rt.kernels.jit import kernel
import numba, numpy as np

@kernel
def places(row: np.ndarray) -> int:
    total = 0
    for x in row:
        total += np.searchsorted(row, x)
    return total

@kernel
def doubled(x: float) -> float:
    for _ in range(1):
        x = 2.0 * x
    return x

print(places(np.arange(4.0)), places.stats.cache_hits.total(), "scipy" in sys.modules)

@numba.njit(numba.float64(numba.types.FunctionType(numba.float64(numba.float64))))
def called(function):
    return function(8.0)

print(doubled(2.0), called(doubled), doubled.stats.cache_hits.total())
"""


def test_a_loaded_kernel_is_complete_though_its_intermediate_code_is_not_kept(tmp_path):
    program = tmp_path / "loaded.py"
    program.write_text(LOADED)
    assert printed(program) == "6 0 False\n4.0 16.0 0\n"
    assert printed(program) == "6 1 False\n4.0 16.0 1\n", (
        "numba's own search is loaded without scipy"
    )
    (kept,) = (tmp_path / "cache").rglob("*doubled*.nbc")
    (_, _, (_, intermediate)), *_ = pickle.loads(kept.read_bytes())  # noqa: S301 - our own
    module = binding.parse_bitcode(intermediate)
    steps = [len(list(block.instructions)) for one in module.functions for block in one.blocks]
    assert steps == [2, 2, 2], "an entry only stops the process: nothing of the loop is here"
