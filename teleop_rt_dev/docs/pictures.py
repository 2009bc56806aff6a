"""Make the pictures of the documentation, by the very commands that its tutorial names."""

from __future__ import annotations

import argparse
import io
import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from selenium import webdriver
from selenium.webdriver.support.wait import WebDriverWait

from teleop_rt_dev.paths import ROOT

PICTURES = ROOT / "docs" / "pictures"
TUTORIAL = ROOT / "docs" / "tutorial.md"
COLOURS = 192  # of a palette of 256 at most: more would not be seen
PATIENCE_S = 120  # for a page that plays 12 s, on a busy machine too


def main(arguments: Sequence[str]) -> int:
    """Run the tutorial, look, and keep the pictures."""
    parser = argparse.ArgumentParser(prog="teleop-rt-dev docs pictures", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=PICTURES)
    parser.add_argument("--still", action="store_true", help="no live page, which plays for 12 s")
    chosen = parser.parse_args(arguments)
    pictures = chosen.folder
    pictures.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as name, chromium() as browser:
        place = Path(name)
        (place / "config").symlink_to(ROOT / "config")
        for words in commands_of(TUTORIAL.read_text(encoding="utf-8")):
            run_command(words, place)
        runs = place / "runs"
        first, hidden = runs / "first", runs / "hidden"
        look(browser, first / "report.html")
        keep(browser.get_screenshot_as_png(), pictures / "report.png")
        for chart, picture in (("felt", "run.png"), ("force", "force.png")):
            figure = browser.find_element("css selector", f"figure[data-chart={chart}]")
            browser.execute_script("arguments[0].scrollIntoView()", figure)
            keep(figure.screenshot_as_png, pictures / picture)
        look(browser, hidden / "report.html")
        keep(browser.get_screenshot_as_png(), pictures / "inadequate.png")
        keep((hidden / "diagnosis" / "residual.png").read_bytes(), pictures / "diagnosis.png")
        if not chosen.still:
            live(browser, first, pictures / "live.png")
    return 0


def commands_of(tutorial: str) -> list[list[str]]:
    """Return the words of each command of the tutorial, in its order."""
    lines = re.findall(r"^    ((?:teleop-rt|scripts/run) .*)$", tutorial, re.MULTILINE)
    return [shlex.split(line) for line in lines]


def run_command(words: list[str], place: Path) -> None:
    """Run a command of the tutorial in a folder, or end with its exit code."""
    print("$", *words, flush=True)
    program, *arguments = words
    if program == "scripts/run":  # its environment stands already: the trial remains
        arguments = ["run", "config/trials/silicone_cube.yaml", *arguments]
    command = [sys.executable, "-m", "teleop_rt", *arguments]
    done = subprocess.run(command, check=False, cwd=place)
    if done.returncode and not was_late(words, place):
        sys.exit(done.returncode)


def was_late(words: list[str], place: Path) -> bool:
    """Whether a run on the real clock was ended by a machine that holds the loop up."""
    summary = place / words[-1] / "summary.json"
    if not summary.is_file():
        return False
    ended = json.loads(summary.read_text(encoding="utf-8")).get("safety", {})
    late: bool = ended.get("fault", {}).get("name") == "late_ticks"
    if late:
        print("ended by this machine in late_ticks: its picture is not needed", flush=True)
    return late


@contextmanager
def chromium() -> Iterator[webdriver.Chrome]:
    """Give a headless browser; exit code 2 where there is none."""
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if program is None or driver is None:
        print("needs chromium: apt install chromium chromium-driver", file=sys.stderr)
        sys.exit(2)
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(argument)
    options.add_argument("--window-size=1180,900")
    browser = webdriver.Chrome(options, webdriver.ChromeService(driver))
    try:
        yield browser
    finally:
        browser.quit()


def look(browser: webdriver.Chrome, page: Path) -> None:
    """Open a page and wait until its figures are drawn."""
    browser.get(page.as_uri())
    shown = (
        "return document.documentElement.dataset.shown === 'true'"
        " || document.getElementById('figures') === null"
    )
    WebDriverWait(browser, PATIENCE_S).until(lambda b: b.execute_script(shown))
    browser.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0], 300))")


def live(browser: webdriver.Chrome, run: Path, picture: Path) -> None:
    """Keep the live page of a run that is played back, once its window is full."""
    command = [sys.executable, "-m", "teleop_rt", "live", str(run), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            browser.get(f"{live_address(server)}?theme=light")
            last = "return typeof held === 'undefined' ? 0 : held.slave?.t.at(-1) ?? 0"
            WebDriverWait(browser, PATIENCE_S).until(lambda b: b.execute_script(last) > 12.0)
            keep(browser.get_screenshot_as_png(), picture)
        finally:
            server.terminate()


def live_address(server: subprocess.Popen[str]) -> str:
    """Return where a live page is served, or end."""
    shown = re.search(r"http://\S+", server.stdout.readline() if server.stdout else "")
    if shown is None:
        sys.exit("the live page did not begin")
    return shown.group()


def keep(png: bytes, path: Path) -> None:
    """Write a picture with few colours: text and lines stay sharp, the file small."""
    with Image.open(io.BytesIO(png)) as image:
        image.convert("RGB").quantize(COLOURS, kmeans=1).save(path, optimize=True)
