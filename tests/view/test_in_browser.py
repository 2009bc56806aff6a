"""The live page in a real browser: it shows the run, and the console stays clean."""

import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest
from browser import (
    PATIENCE_S,
    WIDTHS,
    console_errors,
    overflow,
    points,
    resize,
    text,
    tips,
    until,
)
from page_checks import check_names, contrast_failures

from teleop_rt.cli.wiring import open_bench
from teleop_rt.realtime.ring_folder import describe, new_ring_folder
from teleop_rt.slave.faults import State
from teleop_rt.trial.bench import Bench
from teleop_rt.trial.estimators import recording_metadata
from teleop_rt.trial.lockstep_run import LockstepTrial, run_lockstep
from teleop_rt_dev.trial.files import SILICONE, silicone
from teleop_rt_drivers import opening

pytest.importorskip("bokeh")


@pytest.fixture
def browser(chromium):
    """Give the browser with an empty page and an empty console."""
    chromium.get("about:blank")
    console_errors(chromium)
    return chromium


@pytest.fixture
def simulated():
    """Give a trial that is stepped by hand, and its simulated rig, published in a ring folder."""
    rigs = []

    def with_rig(trial, now_ns):
        axis, rig = opening.open_lock_step(trial.rig, trial.plant, now_ns, trial.seed)
        rigs.append(rig)
        return Bench(axis, rig.truth)

    with new_ring_folder() as ring_folder:
        trial = LockstepTrial(silicone(), SILICONE.parent, with_rig, ring_folder)
        describe(ring_folder, recording_metadata(trial.trial))
        trial.slave.configure()
        yield trial, rigs[0]


@contextmanager
def served(*words):
    """Give the address of the live page, served by a process of its own, and that process."""
    command = [sys.executable, "-m", "teleop_rt", "live", *map(str, words), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        address = re.search(r"http://\S+", server.stdout.readline()).group()
        try:
            yield address, server
            server.terminate()
            server.wait(PATIENCE_S)
        finally:
            server.kill()


@pytest.fixture
def page():
    """Give the live page of this process."""
    with served("--beside", os.getpid()) as shown:
        yield shown


def test_the_live_page_follows_a_trial_and_shows_a_fault_with_its_next_step(
    browser, simulated, page
):
    trial, rig = simulated
    address, server = page

    def advance():
        for _ in range(100):
            if trial.slave.safety.state != State.FAULT:
                trial.step()

    browser.get(f"{address}?theme=light")
    until(browser, lambda: "RUN" in text(browser, "chain").partition("aria-current")[2], advance)
    assert "silicone_cube" in text(browser, "about")
    assert "no fault" in text(browser, "fault")
    first = text(browser, "values")
    until(browser, lambda: text(browser, "values") != first, advance)
    until(browser, lambda: "in contact" in text(browser, "values"), advance)
    until(browser, lambda: points(browser, "parameters", "t") > 0, advance)
    until(browser, lambda: points(browser, "slave", "filtered_force") > 100, advance)
    until(browser, lambda: points(browser, "master", "rendered_force") > 100, advance)

    rig.inject("mute", "force sensor")
    until(browser, lambda: "fault: samples lost" in text(browser, "fault"), advance)
    shown = text(browser, "fault")
    assert 'class="lamp bad"' in shown
    assert "leave the simulated rig, which lacked a processor, a core" in shown
    assert console_errors(browser) == []

    server.send_signal(signal.SIGTERM)
    server.wait()
    until(browser, lambda: browser.find_element("id", "gone").is_displayed())


def test_before_data_arrive_the_page_waits_and_shows_no_axes(browser, page, simulated):
    trial, _ = simulated
    address, _ = page
    browser.get(f"{address}?theme=light")
    plots = browser.find_element("id", "plots")
    waiting = browser.find_element("id", "waiting")
    until(browser, lambda: "silicone_cube" in text(browser, "about"))
    assert waiting.text == "Waiting for data …"
    assert plots.value_of_css_property("visibility") == "hidden"
    until(browser, lambda: not waiting.is_displayed(), trial.step)
    assert plots.value_of_css_property("visibility") == "visible"
    assert console_errors(browser) == []


def test_a_browser_may_come_and_go_pause_and_choose_its_theme(browser, simulated, page):
    trial, _ = simulated
    address, _ = page

    def advance():
        for _ in range(100):
            trial.step()

    browser.get(f"{address}?theme=dark")
    until(browser, lambda: "silicone_cube" in text(browser, "about"), advance)
    ground = "return getComputedStyle(document.body).backgroundColor"
    assert browser.execute_script(ground) == "rgb(20, 24, 28)"
    browser.get("about:blank")
    for _ in range(10):
        advance()
    browser.get(f"{address}?theme=light")
    assert browser.execute_script(ground) == "rgb(255, 255, 255)"
    # Rows published while nobody looked; nothing more is published while this waits.
    until(browser, lambda: points(browser, "slave", "t") > 75)

    keys = pytest.importorskip("selenium.webdriver.common.keys")
    body = browser.find_element("tag name", "body")
    body.send_keys(keys.Keys.SPACE)
    assert browser.find_element("id", "pause").get_attribute("aria-pressed") == "true"
    shown = "return Bokeh.documents[0].get_model_by_name('slave').data['t'].at(-1)"
    until(browser, lambda: "paused" in text(browser, "frames"), advance)
    paused = browser.execute_script(shown)
    for _ in range(20):
        advance()
        assert browser.execute_script(shown) == paused
    body.send_keys(keys.Keys.SPACE)
    until(browser, lambda: browser.execute_script(shown) > paused + 1.0, advance)
    assert console_errors(browser) == []


def test_a_band_ends_where_it_is_unknown_and_how_an_estimate_began_stretches_no_axis(browser, page):
    address, _ = page
    browser.get(f"{address}?theme=light")
    nan = "NaN"
    rows = f"{{p0: [9, 5, {nan}, {nan}, 7], low0: [{nan}, 4, {nan}, {nan}, 6], "
    rows += f"high0: [{nan}, 6, {nan}, {nan}, 8]}}"
    shown = browser.execute_script(f"const s = closed({rows}); return [s.low0, s.high0]")
    assert shown == [[5, 4, 5, 7, 6], [5, 6, 5, 7, 8]]
    extent = "return [extent([[4, 6]], [90, 5, 8]), extent([[]], [90, 5]), extent([[]], [])]"
    assert browser.execute_script(extent) == [[4, 8], [5, 90], None]
    spiky = "const v = new Float64Array(100).fill(-2); v[7] = 900; v[8] = NaN; return robust(v)"
    assert browser.execute_script(spiky) == [-3, 3]
    assert browser.execute_script("return robust(new Float64Array([NaN]))") is None


SEEK = """
const slider = document.getElementById('seek');
slider.value = arguments[0];
for (const name of ['input', 'change']) slider.dispatchEvent(new Event(name));
"""
CHOOSE = """
const choice = document.getElementById(arguments[0]);
choice.value = arguments[1];
choice.dispatchEvent(new Event('change'));
"""


def test_a_recording_is_sought_and_its_window_estimator_and_curves_are_chosen(browser, tmp_path):
    actions = pytest.importorskip("selenium.webdriver.common.action_chains")
    run_lockstep(silicone("duration_s=4.0"), SILICONE, open_bench, tmp_path, lambda _s: None)
    with served(tmp_path / "recording.mcap") as (address, _):
        browser.get(f"{address}?theme=light")
        until(browser, lambda: points(browser, "slave", "filtered_force") > 10)
        last = "return model('slave').data.t.at(-1)"
        browser.execute_script("document.getElementById('pause').click()")
        for place_s in (3.0, 1.0, 3.5):
            browser.execute_script(SEEK, place_s)
            at_place = pytest.approx(place_s, abs=0.1)
            until(browser, lambda at=at_place: browser.execute_script(last) == at)

        browser.execute_script(CHOOSE, "window", "2.0")
        shown = "const r = model('plot_force').x_range; return r.end - r.start"
        assert browser.execute_script(shown) == pytest.approx(2.0)

        title = "return [0, 1, 2].map(n => model(`plot_parameter${n}`).title.text)"
        until(browser, lambda: "Kelvin-Voigt" in browser.execute_script(title)[0])
        browser.execute_script(CHOOSE, "estimator", "2")
        until(browser, lambda: browser.execute_script(title)[2].startswith("n of Hunt-Crossley"))
        until(browser, lambda: points(browser, "parameters", "p2") > 10)

        shown = "return model('plot_force').renderers.filter(one => one.visible)"
        drawn = f"{shown}.map(one => one.name.split('.')[1])"
        curves = ["filtered_force", "predicted_force", "rendered_force", "force"]
        assert browser.execute_script(drawn) == curves[:3]
        for name in ("force", "predicted_force"):
            browser.find_element("css selector", f"[data-curve$='.{name}'].key").click()
        assert browser.execute_script(drawn) == ["filtered_force", "rendered_force", "force"]

        plot = browser.find_element("css selector", ".whole .bk-Figure")
        actions.ActionChains(browser).move_to_element(plot).perform()
        until(browser, lambda: re.search(r"filtered: *-?\d+\.\d{4}", tips(browser)))
        assert "rendered (master)" in tips(browser)

        for width in WIDTHS:
            resize(browser, width)
            until(browser, lambda: overflow(browser) == 0)  # plots follow the window a frame later
            assert check_names(browser) == []
            assert contrast_failures(browser) == []
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        assert console_errors(browser) == []
