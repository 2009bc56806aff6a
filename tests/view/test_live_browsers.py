"""Frames of the live page: composed once, shared out among browsers, complete for each."""

import base64
import json

import numpy as np
import pytest

pytest.importorskip("bokeh")

from teleop_rt.view.live.feed import Feed
from teleop_rt.view.live.frames import Frames
from teleop_rt.view.live.server import FULL_RATE_BROWSERS, Audience
from teleop_rt.view.live.source import RecordingSource


class Browser:
    """A line that keeps its messages, as the page does."""

    def __init__(self):
        self.free, self.frames, self.rows, self.row = True, [], {}, None

    def send(self, text):
        self.frames.append(text)
        for name, sent in json.loads(text)["sources"].items():
            held = {} if sent["replace"] else self.rows[name]
            for column, packed in sent["columns"].items():
                values = np.frombuffer(base64.b64decode(packed), "<f8")
                held[column] = np.append(held.get(column, []), values)[-sent["keep"] :]
            self.rows[name] = held


class Counted(Frames):
    """Frames that count how often they are composed."""

    composed = 0

    def next(self, note=""):
        self.composed += 1
        return super().next(note)

    def whole(self, note=""):
        self.composed += 1
        return super().whole(note)


@pytest.fixture
def stage(recorded):
    """Give the server of a page, on a recording whose time is stepped by hand."""
    now = [0.0]
    feed = Feed(RecordingSource(recorded, lambda: now[0]), 10.0)
    frames = Counted(feed)
    audience = Audience(frames)

    def tick(count=1):
        for _ in range(count):
            now[0] += 0.04
            feed.poll()
            feed.judge()
            audience.tick()

    return feed, frames, audience, tick


def test_plots_name_their_units_and_parameters_as_the_report_does(stage):
    feed, _, audience, tick = stage
    browser = Browser()
    audience.join(browser)
    tick(5)
    assert estimators_in(browser)["selected"] == -1
    tick(60)
    plots = plots_in(browser)
    assert plots["plot_force"]["label"] == "force [N]"
    assert plots["plot_position"]["label"] == "position [mm]"
    estimators = estimators_in(browser)
    assert estimators["names"][0] == "Kelvin-Voigt, RLS"
    assert estimators["selected"] == feed.health.selected == 0
    assert estimators["parameters"] == {
        "0": [
            {"title": "k of Kelvin-Voigt, RLS; band: ± 2 σ", "label": "k [N/m]"},
            {"title": "b of Kelvin-Voigt, RLS; band: ± 2 σ", "label": "b [N s/m]"},
        ]
    }
    shown = 1e3 * feed.shown["/slave"].columns["position"]
    np.testing.assert_array_equal(browser.rows["slave"]["position"], shown)


def plots_in(browser):
    """Return the last description of each plot that a browser received."""
    sent = {}
    for text in browser.frames:
        sent |= json.loads(text)["plots"]
    return sent


def estimators_in(browser):
    """Return the last description of the estimators that a browser received."""
    sent = [json.loads(text) for text in browser.frames]
    return [frame["estimators"] for frame in sent if "estimators" in frame][-1]


def test_each_browser_chooses_an_estimator_and_gets_its_rows_from_their_beginning(stage):
    feed, _, audience, tick = stage
    one, other = Browser(), Browser()
    audience.join(one)
    audience.join(other)
    tick(60)
    assert set(estimators_in(one)["parameters"]) == {"0"}
    one.row, other.row = 2, 10_000  # no estimator has that row
    tick(10)
    assert set(estimators_in(one)["parameters"]) == {"0", "2"}
    assert estimators_in(one)["parameters"]["2"][2]["label"] == "n [-]"
    window = feed.shown["/estimates/hunt-crossley/direct/rls"]
    assert one.rows["estimate 2"]["t"].size > 5
    assert one.rows["estimate 2"]["t"].size == pytest.approx(window.size, abs=5)
    one.row = None
    tick(5)
    held = one.rows["estimate 2"]["t"].size
    tick(20)
    assert one.rows["estimate 2"]["t"].size == held  # nobody looks: nothing is sent
    assert one.rows["estimate 0"]["t"].size > held


def test_frames_are_composed_once_however_many_look(stage):
    _, frames, audience, tick = stage
    browsers = [Browser() for _ in range(FULL_RATE_BROWSERS)]
    for browser in browsers:
        audience.join(browser)
    tick(20)
    assert frames.composed == 20 + 1
    assert all(len(browser.frames) == 20 for browser in browsers)
    assert len({text for browser in browsers for text in browser.frames}) == 20
    assert not any("browsers look" in text for text in browsers[0].frames)


def test_beyond_a_stated_number_the_frames_are_shared_out_and_the_page_says_so(stage):
    _, frames, audience, tick = stage
    browsers = [Browser() for _ in range(2 * FULL_RATE_BROWSERS + 1)]
    for browser in browsers:
        audience.join(browser)
    tick(60)
    assert frames.composed == 20 + 1
    assert all(len(browser.frames) == 20 for browser in browsers)
    assert f"{len(browsers)} browsers look: 8 frames/s for each" in browsers[-1].frames[0]
    for browser in browsers[1:]:
        audience.leave(browser)
    tick(10)
    assert len(browsers[0].frames) == 30
    assert json.loads(browsers[0].frames[-1])["words"].get("note", "") == ""


def test_who_comes_late_or_lags_ends_up_with_what_the_others_have(stage):
    feed, _, audience, tick = stage
    first, lagging, late = Browser(), Browser(), Browser()
    audience.join(first)
    audience.join(lagging)
    tick(8)
    lagging.free = False
    tick(7)
    audience.join(late)
    tick(7)
    lagging.free = True
    tick(14)
    assert len(lagging.frames) == 8 + 14
    for other in (lagging, late):
        for name in ("slave", "master", "residual", "estimate 0"):
            for column, values in first.rows[name].items():
                np.testing.assert_array_equal(other.rows[name][column], values)
    shown = feed.shown["/slave"].columns
    np.testing.assert_array_equal(first.rows["slave"]["filtered_force"], shown["filtered_force"])
