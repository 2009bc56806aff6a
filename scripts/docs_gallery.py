"""Lay out every page that the product makes at three widths, light and dark, to be looked through.

`scripts/docs gallery RUNS OUT` takes the folder of runs that the tutorial leaves.
"""

from __future__ import annotations

import base64
import sys
from html import escape
from pathlib import Path

from docs_pictures import chromium, keep, look

WIDTHS_PX = (400, 800, 1400)
SCHEMES = ("light", "dark")
TALLEST_PX = 9000  # of a picture: the rest of a long page repeats what it begins with
PAGES = ("report.html", "diagnosis.html", "loop.html", "compared.html", "*.html")


def main() -> None:
    """Take the pictures of all pages below a folder, and write index.html beside them."""
    runs, out = (Path(name) for name in sys.argv[1:3])
    out.mkdir(parents=True, exist_ok=True)
    pages = sorted({page for name in PAGES for page in runs.rglob(name)})
    lines = []
    with chromium() as browser:
        for page in pages:
            name = "-".join(page.relative_to(runs).with_suffix("").parts)
            lines.append(f"<h2>{escape(name)} ({page.stat().st_size / 1e6:.1f} MB)</h2>")
            for scheme in SCHEMES:
                for width in WIDTHS_PX:
                    picture = out / f"{name}-{width}-{scheme}.png"
                    keep(taken(browser, page, width, scheme), picture)
                    lines.append(
                        f'<a href="{picture.name}"><img src="{picture.name}" width="300"'
                        f' alt="{escape(picture.stem)}"></a>'
                    )
    head = '<!doctype html><html lang="en"><meta charset="utf-8"><title>Gallery</title>'
    body = f"<h1>Gallery</h1>{''.join(lines)}"
    (out / "index.html").write_text(head + body + "</html>\n", encoding="utf-8")
    print(f"{len(pages)} pages in {out / 'index.html'}")


def taken(browser, page: Path, width: int, scheme: str) -> bytes:
    """Return a page as PNG, from its top to its end or to the tallest that is taken."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    look(browser, page)
    height = browser.execute_script("return document.documentElement.scrollHeight")
    clip = {"x": 0, "y": 0, "width": width, "height": min(height, TALLEST_PX), "scale": 1}
    asked = {"captureBeyondViewport": True, "clip": clip}
    return base64.b64decode(browser.execute_cdp_cmd("Page.captureScreenshot", asked)["data"])


if __name__ == "__main__":
    main()
