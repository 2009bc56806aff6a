"""The pages that the product leaves: how large, and how soon they show something in a browser."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from teleop_rt_dev.bench.live import OURS, browser, refusal
from teleop_rt_dev.bench.measure import Row, row, take_all_cores
from teleop_rt_dev.paths import SILICONE

FIRST_PAINT = """
const [paint] = performance.getEntriesByName("first-contentful-paint");
return paint ? paint.startTime : null;
"""
FIGURES_SHOWN = """
const done = arguments[0], page = document.documentElement;
const shown = () => (page.dataset.shown ? done(performance.now()) : setTimeout(shown, 5));
shown();
"""
LARGEST_MB, LATEST_PAINT_S = 5, 1
PATIENCE_S = 60  # for a page's last figure, so that a late one is measured and not lost


def run(rounds: int) -> list[Row]:
    """Make a run, a comparison and a diagnosis, and open their pages; two minutes."""
    if why := refusal():
        return [row(why, "", [])]
    take_all_cores()
    with tempfile.TemporaryDirectory() as name, browser() as driver:
        driver.set_script_timeout(PATIENCE_S)
        found = []
        for title, page in made(Path(name)).items():
            size = [page.stat().st_size / 1e6]
            found.append(row(f"{title}: size", "MB", size, f"<= {LARGEST_MB}"))
            times = [opened(driver, page) for _ in range(rounds)]
            paints, figures = zip(*times, strict=True)
            found.append(row(f"{title}: first paint", "s", paints, f"<= {LATEST_PAINT_S}"))
            found.append(row(f"{title}: figures shown", "s", figures))
        return found


def made(folder: Path) -> dict[str, Path]:
    """Return the pages of the default trial, of two runs compared, and of a diagnosis."""
    run_folder, diagnosis = folder / "run", folder / "diagnosis"
    compared = folder / "compared.html"
    for words in (
        ["run", SILICONE, "--clock", "simulated", "--json", "--out", run_folder],
        ["report", "--compare", run_folder, run_folder, "--out", compared],
        ["diagnose", run_folder, "--json", "--out", diagnosis],
    ):
        subprocess.run([*OURS, *map(str, words)], check=True, stdout=sys.stderr)
    return {
        "report": run_folder / "report.html",
        "comparison": compared,
        "diagnosis": diagnosis / "diagnosis.html",
    }


def opened(driver: Any, page: Path) -> tuple[float, float]:
    """Open a page; return the times [s] of its first words and of its figures."""
    driver.get("about:blank")
    driver.get(page.as_uri())
    figures_ms = driver.execute_async_script(FIGURES_SHOWN)
    return 1e-3 * driver.execute_script(FIRST_PAINT), 1e-3 * figures_ms
