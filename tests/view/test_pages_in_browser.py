"""Every page that a run leaves, in one browser: figures answer, nothing overflows, dark is dark."""

import io
import json
import re
import sys
from itertools import product

import numpy as np
import pytest
from browser import tips, until
from page_checks import contrast_failures, look, page_failures
from PIL import Image

from teleop_rt.cli import main
from teleop_rt.cli.reporting import felt_of
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.answers.residuals import residuals_of
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays
from teleop_rt.study import excitation
from teleop_rt.study.sweep_report import write_study
from teleop_rt_dev.paths import SILICONE

pytest.importorskip("bokeh")
pytest.importorskip("matplotlib")

from teleop_rt.study.delay_report import write_report as write_delay_page
from teleop_rt.view.diagnosis_page import write
from teleop_rt.view.loop_page import write_loop_page


def command(*words):
    """Run a command of the program in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["teleop-rt", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
    assert not end.value.code


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Give every page that a run leaves, by name."""
    place = tmp_path_factory.mktemp("pages")
    run = place / "run"
    command("run", SILICONE, "--clock", "simulated", "--duration", 4, "--json", "--out", run)
    compared = place / "compare.html"
    command("report", "--compare", *[run] * 10, "--out", compared)
    cases = excitation.cases(duration_s=1.0)
    write_study(place, "excitation", [excitation.evaluate(case) for case in cases])
    write_delay_page(place, {("direct", "foam"): 0.5}, list(delay_cells()))
    return {
        "report": run / "report.html",
        "compare": compared,
        "loop": loop_page(place, run),
        "diagnosis": diagnosis_page(place / "diagnosis"),
        "excitation": place / "excitation.html",
        "delay": place / "delay.html",
    }


def delay_cells():
    """Give the cells of a delay study, as it reports them."""
    modes, environments = ("model-mediated", "direct", "tdpa", "four-channel"), ("foam", "stiff")
    for mode, environment, trip_ms in product(modes, environments, (0.0, 150.0, 1000.0)):
        stable = mode != "direct" or trip_ms == 0.0
        yield {
            "mode": mode,
            "environment": environment,
            "round_trip_ms": trip_ms,
            "loss": 0.1,
            "seed": 1,
            "stable": stable,
            "unstable_because": [] if stable else ["gives energy"],
            "nrmse": 0.01 + 1e-4 * trip_ms,
            "nrmse_transient": None,
            "lag_ms": 0.5 * trip_ms,
            "energy_min_J": -0.01,
            "models_sent": 120,
            "impedance": {"frequency_hz": [1.0, 3.0], "felt": [90.0, 80.0], "true": [100.0, 90.0]},
        }


HANDLED = {
    "name": "second_layer",
    "where": "rendered to the operator",
    "how": "its amplitude is estimated on-line beside the model's parameters",
}


def loop_page(place, run):
    """Write the page of a closed loop whose two fresh runs are one and the same."""
    for name in ("before", "after"):
        (place / name).symlink_to(run)
    error = {"before": 0.08, "after": 0.001}
    answer = {
        "trial": "silicone_cube",
        "base": {"model": "kelvin-voigt"},
        "effects": [
            {
                "name": "second_layer",
                "belongs_to": "environment",
                "parameters": {"depth": {"value": 0.013, "std": 1e-5, "unit": "m"}},
            }
        ],
        "verdict": "named",
        "withdrawn": None,
        "fresh": {
            "slave": {"free_run": error, "on_line": error},
            "master": error,
            "handled": [HANDLED],
        },
        "seconds": 12.0,
        "phases": [{"name": "diagnosis", "seconds": 9.0}],
    }
    return write_loop_page(answer, place, felt_of)


def diagnosis_page(folder):
    """Write the page of a diagnosis that had one effect to choose from."""
    t = np.arange(4000) * 1e-3
    x = 0.006 + 0.004 * np.sin(5.0 * t) + 0.001 * np.sin(17.0 * t)
    v = np.gradient(x, t)
    noise = np.random.default_rng(1).normal(0.0, 0.05, t.size)
    recording = from_arrays("rubbed", t, x, 3000.0 * x + 20.0 * v + 2.0 * np.sign(v) + noise)
    effects = tuple(effect for effect in LIBRARY if effect.name == "coulomb_friction")
    found = diagnose(recording, "kelvin-voigt", surface=0.0, effects=effects)
    answer = json.loads(json.dumps(found.answer))  # all that the page reads beside the residuals
    return write(answer, residuals_of(found, recording.units), folder)[0]


PLOT = "Bokeh.documents.at(-1).get_model_by_name"


NAMES = ("report", "compare", "loop", "diagnosis", "excitation", "delay")


@pytest.mark.parametrize("name", NAMES, scope="module")  # both look at a page while it is open
def test_a_page_fits_its_window_and_has_names_contrast_and_no_network(chromium, pages, name):
    assert page_failures(chromium, pages[name]) == []
    assert pages[name].stat().st_size < 5_000_000


@pytest.mark.parametrize("name", NAMES[:4], scope="module")
def test_every_figure_of_a_page_is_drawn(chromium, pages, name):
    look(chromium, pages[name], 400)
    shown = "return [...document.querySelectorAll('.screen > div')].map(d => d.offsetHeight)"
    assert len(chromium.execute_script(shown)) >= 3
    # On another ground they are drawn again, a moment after the browser has turned to it.
    until(chromium, lambda: min(chromium.execute_script(shown)) > 40)


def test_dark_is_dark_and_a_figure_changes_with_its_page(chromium, pages):
    grounds = {"light": "rgb(255, 255, 255)", "dark": "rgb(20, 24, 28)"}
    colours = {"light": "#0072B2", "dark": "#56B4E9"}
    drawn = (
        f"return {PLOT}('force-0').renderers.find(r => r.name?.startsWith('measured, filtered'))"
    )
    for scheme in ("light", "dark"):
        look(chromium, pages["report"], scheme=scheme)
        ground = chromium.execute_script("return getComputedStyle(document.body).backgroundColor")
        assert ground == grounds[scheme]
        until(
            chromium,
            lambda scheme=scheme: (
                chromium.execute_script(f"{drawn}.glyph.line_color.value") == colours[scheme]
            ),
        )
        assert contrast_failures(chromium) == []


def test_a_drawn_picture_of_a_study_is_dark_on_a_dark_page(chromium, pages):
    brightness = {}
    for scheme in ("light", "dark"):
        look(chromium, pages["excitation"], scheme=scheme)
        taken = chromium.find_element("css selector", "figure img").screenshot_as_png
        brightness[scheme] = np.median(np.asarray(Image.open(io.BytesIO(taken)).convert("L")))
    assert brightness["light"] > 240
    assert brightness["dark"] < 50


def test_words_in_a_cell_keep_room_and_rows_of_a_comparison_keep_their_line(chromium, pages):
    look(chromium, pages["loop"], 400)
    prose = chromium.find_element("css selector", "td.prose")
    assert prose.size["width"] >= 200
    look(chromium, pages["compare"], 1400)
    row = chromium.find_elements("css selector", "table.sortable tbody tr")[1].find_elements(
        "css selector", "th, td"
    )
    chromium.execute_script("arguments[0].append(document.createElement('br'), '+12 %')", row[1])
    top = (
        "const r = document.createRange(); r.selectNodeContents(arguments[0]);"
        "return r.getBoundingClientRect().top"
    )
    name, figure = (chromium.execute_script(top, cell) for cell in row[:2])
    assert name == pytest.approx(figure, abs=3)


def test_all_columns_of_a_comparison_are_in_a_window_of_1300_px(chromium, pages):
    look(chromium, pages["compare"], 1300)
    region = chromium.find_element("css selector", ".wide:has(table.sortable)")
    model = "arguments[0].querySelectorAll('tbody td')[1]"
    longest = "Mass-spring-damper, algebraic + NI-SPRLS"
    chromium.execute_script(f"{model}.lastChild.textContent = '{longest}'", region)
    widths = "return [arguments[0].scrollWidth, arguments[0].clientWidth]"
    needed, given = chromium.execute_script(widths, region)
    assert 1088 < needed <= given  # of a table that a page of prose would cut


def test_the_pointer_shows_values_and_zoom_moves_the_linked_axes(chromium, pages):
    actions = pytest.importorskip("selenium.webdriver.common.action_chains")
    look(chromium, pages["report"])
    plot = chromium.find_element("css selector", "#screen-force-0")
    chromium.execute_script("arguments[0].scrollIntoView({block: 'center'})", plot)
    actions.ActionChains(chromium).move_to_element(plot).perform()
    until(chromium, lambda: "predicted (model)" in tips(chromium))
    shown = tips(chromium)
    assert re.search(r"time \[s\].*measured, raw.*?-?\d+\.\d", shown)
    assert "rendered (master)" in shown
    limits = "const r = %s(arguments[0]).x_range; return [r.start, r.end]"
    before = chromium.execute_script(limits % PLOT, "position-0")
    moved = f"{PLOT}('force-0').x_range.setv({{start: 1.0, end: 1.5}})"
    chromium.execute_script(moved)
    assert chromium.execute_script(limits % PLOT, "position-0") == [1.0, 1.5] != before
    whole = chromium.execute_script(limits % PLOT, "energy-0")
    assert whole[1] - whole[0] > 3.0


def test_a_key_hides_its_curve_and_a_figure_is_saved_as_a_table(chromium, pages):
    look(chromium, pages["report"])
    visible = f"return {PLOT}('force-0').renderers.filter(r => r.name === 'rendered (master)')"
    key = chromium.find_element("css selector", "[data-chart=force] [data-curve^=rendered]")
    for shown in (False, True):
        chromium.execute_script("arguments[0].click()", key)
        assert chromium.execute_script(f"{visible}.map(r => r.visible)") == [shown]
    table = "return table(document.querySelector('[data-chart=position] [data-save=csv]'))"
    header, first, *rest = chromium.execute_script(table).splitlines()
    assert header == 'x,"asked for (master)","measured (slave)","surface"'
    assert len(rest) > 3000
    assert float(first.split(",")[0]) == 0.0
    svg = "return saved.svg(document.querySelector('[data-chart=position] [data-save=svg]'))[0]"
    assert chromium.execute_script(svg).startswith("<svg")


def test_a_heading_sorts_the_runs(chromium, pages):
    look(chromium, pages["compare"])
    order = "return [...document.querySelectorAll('.sortable tbody th')].map(h => h.innerText)"
    runs = list("ABCDEFGHIJ")
    assert chromium.execute_script(order) == runs
    heading = chromium.find_element("css selector", ".sortable th button")
    for expected in (runs, runs[::-1]):
        chromium.execute_script("arguments[0].click()", heading)
        assert chromium.execute_script(order) == expected
