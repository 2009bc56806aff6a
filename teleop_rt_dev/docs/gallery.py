"""Take pictures of every page that the program makes, at two widths, light and dark.

`scripts/docs gallery` runs the tutorial's commands first; `scripts/docs gallery RUNS` uses a folder
of runs. `scripts/docs` then puts the pictures on the page Gallery.
"""

from __future__ import annotations

import base64
import io
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image
from selenium.webdriver.support.wait import WebDriverWait

from teleop_rt_dev.docs.pictures import (
    PATIENCE_S,
    TUTORIAL,
    chromium,
    commands_of,
    live_address,
    look,
    run_command,
)
from teleop_rt_dev.paths import ROOT

GALLERY = ROOT / "build" / "gallery"
WIDTHS_PX = (400, 1400)  # of a telephone and of a desk
SCHEMES = ("light", "dark")
TALLEST_PX = 9000  # of a picture: a longer page goes on with more of the same tables
QUALITY = 80  # of WebP, in percent: text stays sharp
SHOWN_S = 8.0  # of a playback, before the live page is taken
SETTLED_MS = 700  # figures follow a change of width within
STUDIES = (  # short ones: their pages look as those of long ones do
    "excitation --duration 1",
    "noise --seeds 1 --duration 2",
    "time-varying --seeds 1 --duration 4",
    "approach --round-trip-ms 150,500 --hand-mm-per-s 40",
    "chapter4 --duration 4 --cube-s 4",
    "delay --seeds 1 --round-trip-ms 0,150 --loss 0",
)
LOOP = "close-loop --recording hidden/recording.mcap --test closed/first/recording.mcap"


def main(arguments: Sequence[str]) -> int:
    """Make the runs where none are given, and take the pictures of all their pages."""
    with runs_of(arguments) as runs, chromium() as browser:
        GALLERY.mkdir(parents=True, exist_ok=True)
        for old in GALLERY.glob("*.webp"):
            old.unlink()
        for page in sorted(runs.rglob("*.html")):
            look(browser, page)
            take(browser, "-".join(page.relative_to(runs).with_suffix("").parts))
        for recording in sorted(runs.rglob("recording.mcap"))[:1]:
            take_live(browser, recording)
        print(f"{len(list(GALLERY.glob('*.webp')))} pictures in {GALLERY}: look through them")
    return 0


@contextmanager
def runs_of(given: Sequence[str]) -> Iterator[Path]:
    """Give a folder of runs: the one that is named, or that of the tutorial and a study."""
    if given:
        runs = Path(given[0]).resolve()
        if not any(runs.rglob("*.html")):
            raise SystemExit(f"gallery: {given[0]}: no folder with pages; give a folder of runs")
        yield runs
        return
    with TemporaryDirectory() as name:
        place = Path(name)
        (place / "config").symlink_to(ROOT / "config")
        for words in commands_of(TUTORIAL.read_text(encoding="utf-8")):
            run_command(words, place)
        for study in STUDIES:
            out = f"study-{study.split()[0]}"
            run_command(["teleop-rt", "study", *study.split(), "--out", out], place / "runs")
        run_command(["teleop-rt", *LOOP.split(), "--out", "closed-recording"], place / "runs")
        yield place / "runs"


def take(browser: Any, name: str) -> None:
    """Keep pictures of the page that is open, at every width and on either ground."""
    for scheme in SCHEMES:
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
        for width in WIDTHS_PX:
            picture(browser, f"{name}-{width}-{scheme}", width)


def take_live(browser: Any, recording: Path) -> None:
    """Keep pictures of the live page while it plays a recording."""
    command = [sys.executable, "-m", "teleop_rt", "live", str(recording), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            address = live_address(server)
            for scheme in SCHEMES:
                browser.get(f"{address}?theme={scheme}")
                WebDriverWait(browser, PATIENCE_S).until(full)
                for width in WIDTHS_PX:
                    picture(browser, f"live-{width}-{scheme}", width)
        finally:
            server.terminate()


def full(browser: Any) -> bool:
    """Return whether the live page has a window's worth of a run."""
    last = "return typeof held === 'undefined' ? 0 : held.slave?.t.at(-1) ?? 0"
    return bool(browser.execute_script(last) > SHOWN_S)


def picture(browser: Any, name: str, width: int) -> None:
    """Keep a page at a width, from its top to its end or to the tallest that is taken."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.execute_async_script(f"setTimeout(arguments[0], {SETTLED_MS})")
    height = browser.execute_script("return document.documentElement.scrollHeight")
    clip = {"x": 0, "y": 0, "width": width, "height": min(height, TALLEST_PX), "scale": 1}
    asked = {"captureBeyondViewport": True, "clip": clip}
    png = base64.b64decode(browser.execute_cdp_cmd("Page.captureScreenshot", asked)["data"])
    with Image.open(io.BytesIO(png)) as image:
        image.convert("RGB").save(GALLERY / f"{name}.webp", quality=QUALITY)
