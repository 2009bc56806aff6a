"""What the live page costs the loop, and how fast it is: a trial with and without a browser.

The same real-clock trial runs unwatched and watched in turn, the watching one by a headless
chromium on this very machine, which has to share its cores: a tablet beside it costs less. Frames
are counted in the browser, where they are drawn.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bench_measure import Row, row

TRIAL = Path(__file__).resolve().parents[1] / "config" / "trials" / "silicone_cube.yaml"
SECONDS = 10.0
PAIRS = 2
PATIENCE_S = 60.0
SETTLING_S = 3.0


def refusal() -> str:
    """Say why nothing can be measured; empty where it can."""
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        return "skipped: no browser (apt install chromium chromium-driver)"
    try:
        import bokeh  # noqa: F401, PLC0415 - only looked for
        import selenium  # noqa: F401, PLC0415 - only looked for
    except ImportError as error:
        return f"skipped: {error.name} is not installed"
    return ""


def run(rounds: int) -> list[Row]:
    """Run unwatched and watched in turn."""
    if why := refusal():
        return [row(why, "", [])]
    os.sched_setaffinity(0, range(os.cpu_count() or 1))
    pairs = [(trial(), watched_trial()) for _ in range(min(rounds, PAIRS))]
    found = []
    for name, unit, of in FIGURES:
        for label, place in (("alone", 0), ("watched", 1)):
            found.append(row(f"{name}, {label}", unit, [of(pair[place]) for pair in pairs]))
    more = [missed(watched) - missed(alone) for alone, watched in pairs]
    found.append(row("ticks missed more while watched", "", more, "<= 0"))
    rates = [watched["frames_per_s"] for _, watched in pairs]
    found.append(row("frames drawn by the browser", "1/s", rates, ">= 20"))
    return found


def missed(summary: dict[str, Any]) -> float:
    """Return how many ticks the loop missed."""
    return float(summary["missed_ticks"])


FIGURES: tuple[tuple[str, str, Callable[[dict[str, Any]], float]], ...] = (
    ("ticks missed", "", missed),
    ("wake latency p99", "us", lambda summary: summary["wake_latency_us"]["p99"]),
    ("work p99", "us", lambda summary: summary["work_us"]["p99"]),
)


def trial(*options: str, watch: Callable[[str], float] | None = None) -> dict[str, Any]:
    """Run the trial; return its summary, with what `watch` counted at the page's address."""
    with tempfile.TemporaryDirectory() as name:
        words = [str(TRIAL), "--duration", str(SECONDS), "--json", "--out", f"{name}/run"]
        process = subprocess.Popen(
            [sys.executable, "-m", "teleop_rt", "run", *words, *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"TELEOP_RT_RUN_DIR": f"{name}/place"},
        )
        frames_per_s = watch(_address(process)) if watch else None
        summary = dict(json.loads(process.communicate()[0]))
    return summary | {"frames_per_s": frames_per_s}


def _address(process: subprocess.Popen[str]) -> str:
    for line in process.stderr or ():
        if told := re.search(r"http://\S+/", line):
            return told.group()
    raise RuntimeError("the live page did not begin")


def watched_trial() -> dict[str, Any]:
    """Run the trial with its live page open in a browser."""
    with browser() as driver:

        def watch(address: str) -> float:
            driver.get(f"{address}?theme=light")
            until = time.monotonic() + PATIENCE_S
            while time.monotonic() < until and _drawn(driver) < 1:
                time.sleep(0.1)
            time.sleep(SETTLING_S)
            first, began_s = _drawn(driver), time.monotonic()
            time.sleep(0.5 * SECONDS)
            return (_drawn(driver) - first) / (time.monotonic() - began_s)

        return trial("--live", "--port", "0", watch=watch)


def _drawn(driver: Any) -> int:
    return int(driver.execute_script("return drawn"))


@contextmanager
def browser() -> Iterator[Any]:
    """Give a headless chromium with an empty page."""
    from selenium import webdriver  # noqa: PLC0415 - not everywhere

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-proxy-server"):
        options.add_argument(argument)
    options.add_argument("--window-size=1180,820")
    driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        yield driver
    finally:
        driver.quit()
