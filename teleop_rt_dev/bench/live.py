"""Cost of the live page for the loop, and its speed: one daemon, unwatched and watched in turn.

The daemon is disarmed, so that a machine which holds it up does not end it: it senses, estimates,
records and sends as ever. Unwatched, the server of the page is stopped and the browser empty;
watched, a headless chromium on this very machine draws the page, and has to share its cores: a
tablet beside it costs less. Frames are counted in the browser, where they are drawn; of the whole
page, with a master and a model, while a recording is played. A process that only counts, in the
browser's place, shows the cost of any work on the other core for the loop on this machine.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.realtime.ring import RingReader
from teleop_rt.service.place import places
from teleop_rt.signals import SLAVE, columns
from teleop_rt_dev.bench.measure import Row, row, take_all_cores
from teleop_rt_dev.paths import SILICONE

OURS = [sys.executable, "-m", "teleop_rt"]
MOST_PAIRS = 6  # with a page and without one, so that the bench ends within three minutes
WINDOW_S = 8.0  # 8000 ticks at 1 kHz: the p99 has 80 beyond it
SETTLING_S = 3.0  # left out after a page or a daemon has begun
PATIENCE_S = 60.0  # for a page's first frame, on a busy machine too
RECORDED_S = 8.0  # in each second of which the frames drawn are counted
_READ_S = 0.2  # between reads of the ring


def run(rounds: int) -> list[Row]:
    """Watch a daemon now and then, and a recording; two minutes or three."""
    if why := refusal():
        return [row(why, "", [])]
    take_all_cores()
    with tempfile.TemporaryDirectory() as name, browser() as driver:
        found = _of_a_daemon(Path(name), driver, min(rounds, MOST_PAIRS))
        return [*found, _of_a_recording(Path(name), driver)]


def refusal() -> str:
    """Say why nothing can be measured; empty where it can."""
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        return "skipped: no browser (apt install chromium chromium-driver)"
    try:
        import bokeh  # noqa: F401, PLC0415 - only its presence counts
        import selenium  # noqa: F401, PLC0415 - as above
    except ImportError as error:
        return f"skipped: {error.name} is not installed"
    return ""


def _of_a_daemon(folder: Path, driver: Any, pairs: int) -> list[Row]:
    environment = os.environ | {"TELEOP_RT_RUN_DIR": str(folder / "place")}
    with ExitStack() as stack:
        ring = stack.enter_context(daemon(folder, environment))
        address, server = stack.enter_context(page(environment))
        alone, busy, watched, rates = [], [], [], []
        for _ in range(pairs):
            server.send_signal(signal.SIGSTOP)
            driver.get("about:blank")
            alone.append(window(ring))
            with counting():
                busy.append(window(ring))
            server.send_signal(signal.SIGCONT)
            look(driver, address)
            began, began_s = drawn(driver), time.monotonic()
            watched.append(window(ring))
            rates.append((drawn(driver) - began) / (time.monotonic() - began_s))
    found = []
    for name, unit in (("missed", "of 1000"), ("wake_p99", "us"), ("work_p50", "us")):
        for label, windows in (("alone", alone), ("beside", busy), ("watched", watched)):
            printed = f"{name.replace('_', ' ')}, {label}"
            found.append(row(printed, unit, [one[name] for one in windows]))
    both = list(zip(alone, watched, strict=True))
    costs = [two["work_p50"] / one["work_p50"] for one, two in both]
    beside = [two["work_p50"] / one["work_p50"] for one, two in zip(alone, busy, strict=True)]
    more = [two["missed"] - one["missed"] for one, two in both]
    return [
        *found,
        row("work of a tick, watched / alone", "ratio", costs, "<= 1.1"),
        row("work of a tick, beside a process that counts / alone", "ratio", beside),
        row("more ticks missed while watched", "of 1000", more, "<= 0"),
        row("frames drawn of a daemon", "1/s", rates, ">= 20"),
    ]


@contextmanager
def counting() -> Iterator[None]:
    """Keep a core busy with a process that has nothing to do with the loop."""
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        try:
            yield
        finally:
            process.kill()


def _of_a_recording(folder: Path, driver: Any) -> Row:
    """Return how often the page of a whole trial is drawn: with a master and a model."""
    words = ["run", SILICONE, "--clock", "simulated", "--duration", RECORDED_S + SETTLING_S]
    run_folder = folder / "run"
    subprocess.run(
        [*OURS, *map(str, words), "--json", "--out", str(run_folder)],
        check=True,
        capture_output=True,
    )
    with page(os.environ, str(run_folder)) as (address, _):
        look(driver, address)
        rates = []
        for _ in range(round(RECORDED_S)):
            began, began_s = drawn(driver), time.monotonic()
            time.sleep(1.0)
            rates.append((drawn(driver) - began) / (time.monotonic() - began_s))
    return row("frames drawn of a run that is played back", "1/s", rates, ">= 20")


@contextmanager
def daemon(folder: Path, environment: Mapping[str, str]) -> Iterator[RingReader]:
    """Run a simulated rig and its daemon; give the daemon's ring."""
    key = str(folder / "link.key")
    subprocess.run([*OURS, "keygen", key], check=True, capture_output=True)
    trial = [str(SILICONE), "--set", f"rig.axis.bus.channel=bench-{secrets.token_hex(4)}"]
    trial += ["--set", f"link.slave_port={20000 + secrets.randbelow(10000)}"]
    with ExitStack() as stack:
        for name, more in (("sim", []), ("slave", ["--key", key])):
            words = [name, *trial, "--out", str(folder / name), *more]
            _, printed = stack.enter_context(_started(words, environment))
            if "ready" not in printed:
                raise RuntimeError(f"{name} did not begin")
        yield RingReader(places(environment)[0].ring_folder / "slave.ring")


@contextmanager
def page(
    environment: Mapping[str, str], *recording: str
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serve the live page; give its address and its server."""
    with _started(["live", *recording, "--port", "0"], environment) as (server, printed):
        address = re.search(r"http://\S+/", printed)
        if address is None:
            raise RuntimeError("the live page did not begin")
        yield address.group(), server


@contextmanager
def _started(
    words: list[str], environment: Mapping[str, str]
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start a process of ours; give it with its first line."""
    process = subprocess.Popen([*OURS, *words], stdout=subprocess.PIPE, text=True, env=environment)
    try:
        yield process, process.stdout.readline() if process.stdout else ""
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.communicate()


def window(ring: RingReader) -> dict[str, float]:
    """Return statistics of the loop's ticks in the next seconds, the first of them left out."""
    time.sleep(SETTLING_S)
    ring.read()
    pieces = []
    until = time.monotonic() + WINDOW_S
    while time.monotonic() < until:
        time.sleep(_READ_S)
        pieces.append(ring.read())
    rows, at = np.concatenate(pieces), columns(SLAVE)
    ticks = rows[:, at["tick"]]
    expected = ticks[-1] - ticks[0] + 1
    return {
        "missed": 1000.0 * float(expected - ticks.size) / float(expected),
        "wake_p99": float(np.nanquantile(rows[:, at["wake_latency_us"]], 0.99)),
        "work_p50": float(np.nanmedian(rows[:, at["work_us"]])),
    }


def look(driver: Any, address: str) -> None:
    """Open the page, and wait until it draws."""
    driver.get(f"{address}?theme=light")
    until = time.monotonic() + PATIENCE_S
    while drawn(driver) < 1:
        if time.monotonic() > until:
            raise RuntimeError(f"nothing was drawn in {PATIENCE_S:.0f} s")
        time.sleep(0.1)
    time.sleep(SETTLING_S)


def drawn(driver: Any) -> int:
    """Return how many frames the page has drawn."""
    return int(driver.execute_script("return typeof drawn === 'undefined' ? 0 : drawn"))


@contextmanager
def browser() -> Iterator[Any]:
    """Give a headless chromium with an empty page."""
    from selenium import webdriver  # noqa: PLC0415 - not everywhere

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-proxy-server"):
        options.add_argument(argument)
    options.add_argument("--window-size=1180,820")
    driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        yield driver
    finally:
        driver.quit()
