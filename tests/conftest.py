import functools
import gc
import io
import os
import pickle
import resource
import sys
from importlib.metadata import entry_points

# As the program does: threads of linear algebra on cores that are busy wait for each other.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import pytest
from browser import headless_chromium
from cases import OPTION
from hypothesis import settings
from lean_install import without_pages
from numba.np import numpy_support

from teleop_rt.cli import main
from teleop_rt.config.yaml_file import ConfigLoader
from teleop_rt.contact.effects import user
from teleop_rt_drivers.canopen import eds, eds_file
from teleop_rt_drivers.simulated import dictionary

# The same draws each time; others with --hypothesis-profile=default.
settings.register_profile("same draws", derandomize=True, database=None, deadline=None)
settings.load_profile("same draws")


MANY_TEXTS = 100

COLLECT_AFTER = 20_000
"""Objects made since the last collection: after Python's 700, collections take 7 % of the suite."""

LONGEST = (
    *("trial/test_close_loop", "test_drawn_hands", "view/test_docs", "test_package"),
    *("trial/test_lockstep_trial", "study/test_delay", "view/test_run_report"),
    *("test_offline_commands", "drivers/test_drivetrain", "trial/test_close_loop_command"),
    *("view/test_pages_in_browser", "view/test_in_browser", "view/test_live_served", "test_jit"),
    *("drivers/test_trial_on_every_rig", "drivers/test_operator_device", "slave/test_supervision"),
    *("master/test_closed_loop", "faults/test_every_row", "trial/test_any_hand"),
    *("study/test_studies", "drivers/test_actuator_handles", "test_schema", "study/test_chapter4"),
    *("slave/test_first_contact_with_slave", "master/test_hand_from_outside", "api/test_notebook"),
    *("test_same_hand", "trial/test_breathing", "realtime/test_recording_bombs"),
    *("master/test_rendered_effects", "offline/test_many_recordings", "service/test_daemon"),
    *("drivers/test_actuators",),
    *("diagnosis/test_foreign", "diagnosis/test_confirmed_on_blocks", "diagnosis/test_diagnose"),
    *("diagnosis/test_not_noise", "diagnosis/test_noise", "diagnosis/test_linkage"),
    *("diagnosis/test_surface", "diagnosis/test_second", "diagnosis/test_steps"),
    *("diagnosis/test_measured", "diagnosis/test_noise_colours", "diagnosis/test_held"),
    *("diagnosis/test_discrepancy", "diagnosis/test_pairs"),
    *("diagnosis/test_detectable", "diagnosis/test_dropouts", "diagnosis/test_filtered"),
    *("diagnosis/test_reading", "diagnosis/test_report", "diagnosis/test_beginning"),
    *("diagnosis/test_relaxing", "diagnosis/test_work"),
)
"""Modules of 38 to 5 s of processor time, which begin first: no core then waits for one alone.

The first diagnoses and the second does not: from an empty cache a diagnosis compiles for half a
minute, and beside each other two would.
"""


def pytest_addoption(parser):
    """Add the option that plays all values of a parameter."""
    parser.addoption(
        OPTION, action="store_true", help="play further cases that take a test the same way"
    )


def pytest_configure():
    """Collect no garbage while tests are collected: it would take a third of that time."""
    gc.disable()


def pytest_collection_finish():
    """Begin to collect garbage, seldom, and leave imported modules alone: they stay to the end."""
    gc.freeze()
    gc.set_threshold(COLLECT_AFTER)
    gc.enable()


def pytest_collection_modifyitems(config, items):
    """Begin with the longest modules, so that no core waits for one of them alone at the end.

    Leave out further cases that take a test the same way where nobody asks for them.
    """
    if not config.getoption(OPTION):
        further = [item for item in items if item.get_closest_marker("further_case")]
        config.hook.pytest_deselected(items=further)
        items[:] = [item for item in items if not item.get_closest_marker("further_case")]
    rank = {f"tests/{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.nodeid.partition("::")[0], len(rank)))


@pytest.fixture
def files_end_at():
    """Let the disk refuse all that goes beyond so many bytes of a file."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="session", autouse=True)
def each_eds_is_parsed_once():
    """Parse the same text for the same node once: a thousand benches read the same three.

    Each caller gets a dictionary of its own; a text that is refused is parsed, and refused, again.
    """
    parse = eds.import_eds

    @functools.cache
    def parsed(text, node_id):
        return pickle.dumps(parse(io.StringIO(text), node_id))

    def import_eds(source, node_id):
        return pickle.loads(parsed(source.read(), node_id))  # noqa: S301 - our own

    with pytest.MonkeyPatch.context() as patch:
        for module in (eds, dictionary):
            patch.setattr(module, "import_eds", import_eds)
        patch.setattr(eds_file, "check", functools.cache(eds_file.check))
        yield


@pytest.fixture(scope="session", autouse=True)
def each_config_is_composed_once():
    """Compose the nodes of the same YAML once: a thousand tests load the same rigs.

    Data are built of the nodes again for each caller; a text that is refused is refused again.
    """
    compose = ConfigLoader.get_single_node

    def get_single_node(loader):
        text = loader.buffer  # whole, at its beginning
        if text not in composed:
            if len(composed) == MANY_TEXTS:  # by a test that draws them
                composed.clear()
            composed[text] = compose(loader)
        return composed[text]

    composed = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ConfigLoader, "get_single_node", get_single_node)
        yield


@pytest.fixture(scope="session", autouse=True)
def each_path_is_searched_for_effects_once():
    """Search a path for installed effects once: each of a thousand slaves would do it again."""

    @functools.cache
    def found(_path, group):
        return entry_points(group=group)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(user, "entry_points", lambda group: found(tuple(sys.path), group))
        yield


@pytest.fixture(scope="session", autouse=True)
def each_record_has_its_type_made_once():
    """Make numba's type of the same records once: each slave and master binds kernels to twenty."""
    make = numpy_support.from_dtype

    @functools.cache
    def made(dtype, _is_aligned, _scalar):  # neither of which two equal dtypes must share
        return make(dtype)

    def from_dtype(given):  # also a scalar's class
        dtype = np.dtype(given)
        return made(dtype, dtype.isalignedstruct, dtype.type)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numpy_support, "from_dtype", from_dtype)
        yield


@pytest.fixture(scope="session", autouse=True)
def each_field_of_a_record_is_found_by_its_name():
    """Let compiled code of numpy find a record's field: its Python takes five times as long.

    Kernels that are not compiled do little else: it took a third of the time of the rules.
    """
    own = frozenset(dir(np.record))
    get, put = np.record.__getattribute__, np.record.__setattr__
    field, keep = np.void.__getitem__, np.void.__setitem__

    def get_field(record, name):
        if name in own:
            return get(record, name)
        try:
            value = field(record, name)
        except ValueError:
            return get(record, name)  # its error names the missing field
        return get(record, name) if isinstance(value, np.void) else value

    def set_field(record, name, value):
        if name in own:
            put(record, name, value)
            return
        try:
            keep(record, name, value)
        except ValueError:
            put(record, name, value)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np.record, "__getattribute__", get_field)
        patch.setattr(np.record, "__setattr__", set_field)
        yield


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """Call the command line in this process; returns exit code, output and errors."""
    monkeypatch.chdir(tmp_path)

    def calling(*arguments):
        monkeypatch.setattr(sys, "argv", ["teleop-rt", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return end.value.code or 0, captured.out, captured.err

    return calling


@pytest.fixture
def no_pages():
    """Draw no report and no page of a diagnosis: that takes longer than most runs."""
    with without_pages():
        yield


@pytest.fixture(scope="session")
def chromium():
    """Give one headless browser for all pages; a test that needs it is skipped where none is."""
    with headless_chromium() as driver:
        yield driver
