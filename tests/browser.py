"""A headless browser; where there is none a test is skipped, unless CI says that it must be."""

import os
import shutil
from contextlib import contextmanager

import pytest

REQUIRED = "TELEOP_RT_BROWSER"
PATIENCE_S = 120
WIDTHS = (400, 800, 1400)
"""Pixels: of a telephone, a half screen, and a whole one."""


@contextmanager
def headless_chromium(width=1280, height=1200):
    """Give a selenium driver of Debian's chromium, which keeps the console's messages."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        reason = "needs Debian's chromium and chromium-driver"
        if os.environ.get(REQUIRED) == "required":
            pytest.fail(f"{reason}; {REQUIRED} says that they are required")
        pytest.skip(reason)
    webdriver = pytest.importorskip("selenium.webdriver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--no-proxy-server",
        f"--window-size={width},{height}",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(options, webdriver.ChromeService(driver))
    try:
        yield browser
    finally:
        browser.quit()


def console_errors(browser):
    """Return the errors that the console has shown since the last call."""
    return [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


def until(browser, condition, advance=lambda: None):
    """Wait until the browser meets a condition; `advance` runs on the trial that it shows."""
    wait = pytest.importorskip("selenium.webdriver.support.wait")
    exceptions = pytest.importorskip("selenium.common.exceptions")

    def shown(_browser):
        advance()
        return condition()

    try:
        return wait.WebDriverWait(browser, PATIENCE_S, poll_frequency=0.05).until(shown)
    except exceptions.TimeoutException:
        said = browser.execute_script("return document.body.innerText")
        pytest.fail(f"not shown in {PATIENCE_S} s; the page says:\n{said}")


def text(browser, name):
    """Return the words of the live page at one place, as HTML."""
    script = f"return document.getElementById('{name}')?.innerHTML ?? ''"
    return str(browser.execute_script(script))


def points(browser, name, column):
    """Return how many values of a column are in the plot of the live page."""
    return int(browser.execute_script(f"return model('{name}').data['{column}']?.length ?? 0"))


def resize(browser, width, scheme="light"):
    """Give pages a width [px] and the ground that the reader prefers."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def overflow(browser):
    """Return by how many pixels a page is wider than its window."""
    page = "document.documentElement"
    return browser.execute_script(f"return {page}.scrollWidth - {page}.clientWidth")


def tips(browser):
    """Return the words of every tooltip that a page shows."""
    words = "return [...document.querySelectorAll('*')].filter(one => one.shadowRoot)"
    return " ".join(browser.execute_script(f"{words}.map(one => one.shadowRoot.textContent)"))
