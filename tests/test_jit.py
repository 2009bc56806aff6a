import fcntl
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.errors import NumbaError

from teleop_rt import contact
from teleop_rt.estimation import bank_kernels, cycle, solvers
from teleop_rt.estimation.layout import WHOLE
from teleop_rt.estimation.state import new_state
from teleop_rt.kernels import compile_lock, jit
from teleop_rt.kernels.inner import Cache
from teleop_rt.kernels.jit import cache_root, fingerprint, kernel, machine, sources_of

PROGRAM = """
import sys
import teleop_rt.estimation.filters, teleop_rt.estimation.pipeline, teleop_rt.kernels.jit

@teleop_rt.kernels.jit.kernel
def twice(x: float) -> float:
    return 2.0 * x

twice(21.0)
teleop_rt.estimation.filters.design("svf", 40.0, 1e-3)
print(teleop_rt.kernels.jit._ROOT, *{"scipy.linalg", "cffi"} & set(sys.modules))
"""

TWICE = """
from teleop_rt.kernels.jit import kernel

@kernel
def twice(x: float) -> float:
    return 2.0 * x
"""

TICKS = """
from collections import Counter
from numba.core.dispatcher import Dispatcher
from teleop_rt.config.trial import EstimationConfig
from teleop_rt.kernels.inner import Kernel
from teleop_rt.study.delay_world import Cell, World, trial_of
from teleop_rt.trial.sides import make_slave

late, compile_for = [], Dispatcher._compile_for_args
unbound, call = Counter(), Dispatcher.__call__

def spied(self, *values, **keys):
    late.append(self.py_func.__name__)
    return compile_for(self, *values, **keys)

def counted(self, *values, **keys):
    unbound[self.py_func.__name__] += 1
    return call(self, *values, **keys)

cell = Cell("model-mediated", "silicone", 0.0, 0.0, 1)
whole = EstimationConfig(
    models=("kelvin-voigt", "mass-spring-damper", "hunt-crossley"),
    regressions=("direct", "algebraic"),
    solvers=("rls", "sprls", "ni-sprls", "gn-vff-rls", "iec"),
)
world = World(
    cell,
    lambda *parts, **options: make_slave(*parts, **{**options, "log_estimates": True}),
    trial_of(cell).model_copy(update={"estimation": whole}),
)
Dispatcher._compile_for_args, Kernel.__call__ = spied, counted
while world.onset_tick is None or world.tick < world.onset_tick + 500:
    world.step()
world.close()
print(late)
print([name for name, times in unbound.items() if times > world.tick // 100])
"""
"""A slave and a master in a process of their own: here other tests have compiled already."""


@pytest.fixture(scope="module")
def ticks():
    """The kernels that were compiled late in a run, and those that were often called unbound."""
    done = subprocess.run([sys.executable, "-c", TICKS], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_no_kernel_is_compiled_or_loaded_in_a_tick(ticks):
    assert ticks[0] == "[]"


def test_no_kernel_of_many_ticks_finds_out_the_types_of_its_arguments_in_each(ticks):
    assert ticks[1] == "[]"


@kernel
def refused(*_values: float) -> float:
    return float(np.zeros(1)[0])


@kernel
def passed(*_values):
    """Stand in for a kernel of which nothing is expected here: to compile it takes seconds."""


@kernel
def agreed(*_values):
    """Stand in for such a kernel that returns whether all is well."""
    return True


VECTOR, MATRIX, FLAGS = numba.float64[::1], numba.float64[:, ::1], numba.uint8[::1]
STATE = numba.typeof(new_state()[0]).dtype
ROW = (VECTOR, VECTOR, VECTOR, numba.float64, numba.float64, numba.int64)
BANK = (MATRIX, MATRIX, numba.int64[::1], MATRIX, VECTOR, VECTOR, FLAGS)


@pytest.mark.parametrize(
    ("caller", "types", "left_out", "others"),
    [
        (
            cycle.estimate,
            (STATE,),
            ["fill_algebraic", "weigh_terms", "integrate_filtered"],
            {"bank_step": passed, "fill_direct": passed, "judge": passed},
        ),
        (
            bank_kernels.row_step,
            ROW,
            ["integral_step"],
            {"recursive_step": agreed, "judge_readiness": agreed, "score_step": passed},
        ),
        (solvers.recursive_step, ROW, ["forgetting_step", "perturb", "gradient_step"], {}),
        (
            bank_kernels.bank_step,
            BANK,
            ["step_of_two", "step_of_three"],
            {"step_of_any": passed},
        ),
    ],
    ids=["estimate", "row", "solver", "bank"],
)
def test_a_bank_that_is_not_whole_compiles_no_kernel_that_it_does_not_use(
    monkeypatch, caller, types, left_out, others
):
    for name, stand_in in (dict.fromkeys(left_out, refused) | others).items():
        assert name in caller.py_func.__globals__
        monkeypatch.setitem(caller.py_func.__globals__, name, stand_in)

    def compile_with(whole):
        numba.jit(**jit._OPTIONS)(caller.py_func).compile((*types, numba.typeof(whole)))

    compile_with(None)
    with pytest.raises(NumbaError):
        compile_with(WHOLE)


def test_a_kernel_computes_what_its_source_says():
    @kernel
    def twice(x: float) -> float:
        return 2.0 * x

    assert twice(21.0) == 42.0


@kernel
def scaled_sum(values, factor):
    total = 0.0
    for value in values:
        total += factor * value
    return total


def test_a_bound_kernel_computes_what_the_kernel_does_of_its_arrays_and_other_numbers():
    values = np.array([1.0, 2.0, 3.0])
    code = jit.bound(scaled_sum, (values,), 1.0)
    assert code(2.0) == scaled_sum(values, 2.0) == 12.0
    values[0] = 2.0
    assert code(3.0) == 21.0


@pytest.mark.parametrize("values", [np.ones((2, 3)), np.ones(6, np.float32), np.ones((4, 2))[:, 0]])
def test_a_bound_kernel_reads_an_array_as_what_it_is(values):
    @kernel
    def last(array, factor):
        return factor * array.size

    assert jit.bound(last, (values,), 1.0)(2.0) == 2.0 * values.size


def test_no_array_can_come_with_each_call():
    with pytest.raises(TypeError, match="bound"):
        jit.bound(scaled_sum, (), np.zeros(1), 1.0)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="without the compiler it is the function")
@pytest.mark.parametrize("other", [np.zeros(3), [1.0], None, "one"])
def test_a_bound_kernel_refuses_what_it_would_misread(other):
    code = jit.bound(scaled_sum, (np.zeros(1),), 1.0)
    with pytest.raises(TypeError):
        code(other)


def test_a_kernel_that_allocates_is_refused():
    @kernel
    def copied(x: np.ndarray) -> float:
        return float(np.zeros(x.size)[0])

    with pytest.raises(NumbaError):
        copied(np.ones(3))


def test_a_kernels_sources_are_its_file_and_all_of_ours_that_it_imports(tmp_path):
    user = tmp_path / "user.py"
    user.write_text(
        "import os\nfrom teleop_rt.kernels.jit import kernel\nfrom teleop_rt.contact import (\n"
        "    base_effects,\n)\n"
    )
    found = sources_of(user)
    folder = Path(contact.__file__).parent
    assert found >= {user, Path(jit.__file__), folder / "base_effects.py", folder / "effect.py"}
    assert Path(os.__file__) not in found


def forget_files():
    """Read files again, as the next process does."""
    for remembered in (fingerprint, jit.sources_of, jit._read):
        remembered.cache_clear()


def test_the_fingerprint_follows_the_contents_of_what_is_imported(tmp_path, monkeypatch):
    (tmp_path / "teleop_rt_example").mkdir()
    for name, text in {
        "__init__": "",
        "layout": "WIDTH = 3\n",
        "kernels": "from teleop_rt_example.layout import WIDTH\n",
    }.items():
        (tmp_path / "teleop_rt_example" / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "teleop_rt_example" / "kernels.py"
    before = fingerprint(file)
    forget_files()
    assert fingerprint(file) == before
    (tmp_path / "teleop_rt_example" / "layout.py").write_text("WIDTH = 4\n")
    forget_files()
    assert fingerprint(file) != before


def loaded(file):
    """Import a file by its path, as a module of its own."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def hits(file):
    """Call the kernel `twice` of a file; return how often its code came from the cache."""
    forget_files()
    machine.cache_clear()
    twice = loaded(file).twice
    assert twice(21.0) == 42.0
    return sum(twice.stats.cache_hits.values())


@pytest.fixture
def kernel_in(tmp_path, monkeypatch):
    """Return a writer of kernels into a package or a plain folder; their cache is empty."""
    (tmp_path / "cache").mkdir()
    monkeypatch.setattr(jit, "_ROOT", tmp_path / "cache")

    def writing(folder, package):
        place = tmp_path / folder / package
        place.mkdir(parents=True)
        if package.startswith("teleop_rt"):
            (place / "__init__.py").touch()
        file = place / "kernels.py"
        file.write_text(TWICE)
        return file

    return writing


def test_equal_code_of_a_package_in_two_folders_is_compiled_once(kernel_in):
    first, second = (kernel_in(folder, "teleop_rt_example") for folder in ("clone", "wheel"))
    assert (hits(first), hits(first), hits(second)) == (0, 1, 1)


@pytest.fixture
def lock_held(kernel_in):
    """Return a kernel's file, and the lock that a process holds which compiles that kernel."""
    file = kernel_in("clone", "teleop_rt_example")
    folder = jit.kernel_folder(file)
    folder.mkdir()
    with (folder / f"twice-{TWICE[: TWICE.index('@')].count(chr(10)) + 1}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield file, lock


def test_a_kernel_that_another_process_compiles_is_waited_for_and_loaded(lock_held, monkeypatch):
    file, lock = lock_held

    def other_process_ends(_seconds):
        fcntl.flock(lock, fcntl.LOCK_UN)
        assert hits(file) == 0

    monkeypatch.setattr(compile_lock.time, "sleep", other_process_ends)
    assert hits(file) == 1


def test_the_first_kernel_of_an_empty_cache_is_compiled_under_its_lock(kernel_in, monkeypatch):
    """Its folder was made only with its code, so that two processes both compiled the bank."""
    file, held = kernel_in("clone", "teleop_rt_example"), []
    load = Cache.load_overload

    def loading(cache, *asked):
        (lock,) = jit.kernel_folder(file).glob("twice-*.lock")
        with lock.open() as another, pytest.raises(BlockingIOError):
            fcntl.flock(another, fcntl.LOCK_EX | fcntl.LOCK_NB)
        held.append(lock)
        return load(cache, *asked)

    monkeypatch.setattr(Cache, "load_overload", loading)
    assert hits(file) == 0
    assert held


def test_a_process_that_was_stopped_while_compiling_holds_up_no_other_for_long(
    lock_held, monkeypatch
):
    file, _ = lock_held
    monkeypatch.setattr(compile_lock, "_given_up", False)  # and as it was, afterwards
    monkeypatch.setattr(compile_lock, "LONGEST_WAIT_S", 0.0)
    assert hits(file) == 0
    monkeypatch.setattr(compile_lock, "LONGEST_WAIT_S", 1e9)
    monkeypatch.setattr(compile_lock.time, "sleep", lambda _: pytest.fail("waited again"))
    assert hits(file) == 1


def test_equal_files_of_a_user_in_two_folders_never_share_code(kernel_in):
    first, second = (kernel_in(folder, "mine") for folder in ("a", "b"))
    assert (hits(first), hits(second), hits(first)) == (0, 0, 1)


def test_another_processor_or_numba_and_checked_indices_compile_anew(kernel_in, monkeypatch):
    file = kernel_in("clone", "teleop_rt_example")
    assert (hits(file), hits(file)) == (0, 1)
    with monkeypatch.context() as other:
        other.setattr(numba.config, "CPU_NAME", "generic")
        assert hits(file) == 0
    with monkeypatch.context() as other:
        other.setattr(numba, "__version__", "99.0")
        assert hits(file) == 0
    with monkeypatch.context() as other:
        other.setattr(numba.config, "BOUNDSCHECK", 1)
        assert (hits(file), hits(file)) == (0, 1)
    assert hits(file) == 1


def test_a_cache_that_was_not_used_for_a_month_is_removed(tmp_path):
    for name in ("kernels-old", "kernels-new"):
        (tmp_path / name).mkdir()
    os.utime(tmp_path / "kernels-old", (1e9, 1e9))
    assert cache_root({"NUMBA_CACHE_DIR": str(tmp_path)}) == tmp_path
    assert [path.name for path in tmp_path.iterdir()] == ["kernels-new"]


def test_without_any_folder_to_write_the_program_still_imports_and_loads_no_more(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(blocked / "cache"),
        "HOME": str(blocked),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "None"
