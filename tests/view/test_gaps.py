"""No curve is drawn across a gap of a recording, on paper, on the screen or on the live page."""

import numpy as np
import pytest

from teleop_rt.view.charts import TIME, Chart, Curve, Panel
from teleop_rt.view.gaps import broken_at_gaps, without_held
from teleop_rt.view.glyphs import curve_sources
from teleop_rt.view.html import figures_of
from teleop_rt.view.live.feed import Feed
from teleop_rt.view.live.source import About
from teleop_rt.view.plots import figure_of

PERIOD_S = 0.001
LOST = slice(400, 600)


def chart(x, *, xlabel=TIME):
    curves = tuple(
        Curve(label=name, x=x, y=np.sin(x + place), colour="#000000", band=band)
        for place, (name, band) in enumerate((("a", None), ("b", np.ones(x.size))))
    )
    panel = Panel(ylabel="force [N]", curves=curves)
    return Chart(name="force", label="force", xlabel=xlabel, panels=(panel,))


def times(*, lost=LOST):
    return np.delete(PERIOD_S * np.arange(1000.0), lost)


def test_a_line_ends_at_a_gap_and_begins_again_behind_it():
    first, second = broken_at_gaps(chart(times())).panels[0].curves
    assert first.x is second.x  # one table of the page
    (gap,) = np.flatnonzero(np.isnan(first.y))
    assert np.isnan(second.y[gap])
    assert np.isnan(second.band[gap])
    assert PERIOD_S * 399 < first.x[gap] < PERIOD_S * 600
    assert np.array_equal(np.delete(first.y, gap), np.sin(times()))


@pytest.mark.parametrize(
    ("x", "xlabel"),
    [(times(lost=slice(400, 404)), TIME), (times(), "frequency [Hz]"), (np.zeros(0), TIME)],
)
def test_late_ticks_and_other_axes_are_no_gaps(x, xlabel):
    for curve in broken_at_gaps(chart(x, xlabel=xlabel)).panels[0].curves:
        assert curve.x is x


def test_the_gap_is_on_the_page_and_on_paper():
    made = figures_of([chart(times())])["charts"]["force"]
    (source, column), *_ = curve_sources(made).values()
    assert np.isnan(source.data[column]).sum() == 1
    line = figure_of(made).axes[0].lines[0]
    assert np.isnan(line.get_ydata()).sum() == 1


@pytest.mark.parametrize("lost", [20, 5])
def test_values_held_while_samples_were_lost_are_a_gap_unless_it_is_short(lost):
    valid = np.ones(100)
    valid[40 : 40 + lost] = valid[61::2] = 0.0
    force = np.arange(100.0)
    rows = without_held({"valid": valid, "force": force, "target": force})
    gone = np.isnan(rows["force"])
    assert np.array_equal(np.flatnonzero(gone), 40 + np.arange(lost if lost > 5 else 0))
    assert np.array_equal(rows["force"][~gone], force[~gone])
    assert np.array_equal(rows["target"], force)
    assert without_held({"force": force})["force"] is force  # of an older version


class Rows:
    """A source whose rows come in pieces of 30 ms, of a slave at 1 kHz."""

    name = "made up"
    ended = False

    def __init__(self, stamps_s):
        self.pieces = [stamps_s[first : first + 30] for first in range(0, stamps_s.size, 30)]

    def about(self):
        return About("trial", "rig", "m", "N", (), PERIOD_S, 0.05, 60.0)

    def topics(self):
        return {}

    def read(self):
        if not self.pieces:
            return {}
        stamps_s = self.pieces.pop(0)
        return {"/slave": {"stamp_ns": 1e9 * stamps_s, "force": np.ones(stamps_s.size)}}


@pytest.mark.parametrize("lost", [slice(400, 600), slice(390, 600), slice(0, 0)])
def test_the_live_page_breaks_its_lines_at_rows_that_never_came(lost):
    feed = Feed(Rows(times(lost=lost)), 10.0)
    while feed.source.pieces:
        feed.poll()
    shown = feed.shown["/slave"].columns
    gaps = np.flatnonzero(np.isnan(shown["force"]))
    assert gaps.size == (lost.stop > 0)
    assert np.all(np.diff(shown["stamp_ns"]) > 0)
    assert all(0.38 < 1e-9 * shown["stamp_ns"][gap] < 0.61 for gap in gaps)
