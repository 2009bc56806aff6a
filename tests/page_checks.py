"""Accessibility of a page: names, labels, language and contrast.

The rules are those of WCAG 2.1 AA that a program can decide; axe-core would fetch its script.
"""

import pytest
from browser import WIDTHS, console_errors, overflow, resize, until

_NAMES = """
const found = [];
const say = (fault, node) => found.push(fault + ': ' + node.outerHTML.slice(0, 80));
if (!document.documentElement.lang) found.push('no language');
if (!document.title.trim()) found.push('no title');
if (document.querySelectorAll('h1').length !== 1) found.push('not one h1');
if (!document.querySelector('main')) found.push('no main');
for (const one of document.querySelectorAll('img:not([alt])')) say('no alt', one);
for (const one of document.querySelectorAll('svg:not([aria-hidden=true])'))
  if (!one.getAttribute('aria-label')) say('no label', one);
for (const one of document.querySelectorAll('button, a, select, input, summary')) {
  const label = one.labels?.[0]?.innerText ?? one.getAttribute('aria-label')
    ?? (one.innerText || one.querySelector('img')?.alt);
  if (!label?.trim()) say('no name', one);
}
for (const one of document.querySelectorAll('th'))
  if (!one.innerText.trim()) say('an empty heading', one);
for (const one of document.querySelectorAll('[tabindex]'))
  if (one.tabIndex > 0) say('out of the order of focus', one);
for (const one of document.querySelectorAll('.wide'))
  if (one.scrollWidth > one.clientWidth && one.tabIndex < 0) say('scrolls without a key', one);
const ids = [...document.querySelectorAll('[id]')].map((one) => one.id);
ids.filter((id, place) => ids.indexOf(id) < place).forEach((id) => found.push('twice: ' + id));
let level = 1;
for (const one of document.querySelectorAll('h1, h2, h3, h4')) {
  const next = Number(one.tagName[1]);
  if (next > level + 1) say('a level skipped', one);
  level = next;
}
return [...new Set(found)];
"""

_CONTRAST = """
const parts = (colour) => colour.match(/[\\d.]+/g).map(Number);
const shine = ([r, g, b]) => [r, g, b].map((one) => one / 255)
  .map((one) => one <= 0.03928 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4)
  .reduce((sum, one, place) => sum + one * [0.2126, 0.7152, 0.0722][place], 0);
const ground = (node) => {
  for (; node instanceof Element; node = node.parentElement) {
    const colour = getComputedStyle(node).backgroundColor;
    if (colour.startsWith('rgb') && (parts(colour)[3] ?? 1) > 0.99) return parts(colour);
  }
  return [255, 255, 255];
};
const found = new Set();
for (const node of document.querySelectorAll('main *, header *, footer *')) {
  const words = [...node.childNodes].some((one) => one.nodeType === 3 && one.data.trim());
  if (!words || !node.checkVisibility() || node.closest('svg, .screen, .bk-Figure')) continue;
  const look = getComputedStyle(node);
  if (!look.color.startsWith('rgb')) continue;
  const [a, b] = [shine(parts(look.color)), shine(ground(node))].sort((x, y) => y - x);
  const size = parseFloat(look.fontSize);
  const large = size >= 24 || (size >= 18.66 && look.fontWeight >= 700);
  const ratio = (a + 0.05) / (b + 0.05);
  if (ratio < (large ? 3 : 4.5)) found.add(ratio.toFixed(2) + ': ' + node.outerHTML.slice(0, 80));
}
return [...found];
"""


def check_names(driver):
    """Return the elements that lack a name, a label, a language or its place among the headings."""
    return driver.execute_script(_NAMES)


def contrast_failures(driver):
    """Return the words whose contrast against their ground is below WCAG's 4.5 (large: 3)."""
    return driver.execute_script(_CONTRAST)


_SHOWN = """
const figures = document.getElementById('figures');
return figures === null || document.documentElement.dataset.shown === 'true';
"""
_FOCUSABLE = """
return [...document.querySelectorAll('button, a[href], select, input, summary, [tabindex="0"]')]
  .filter((one) => one.checkVisibility() && !one.disabled).length;
"""
_FETCHED = """
return performance.getEntriesByType('resource').map(one => one.name)
  .filter(one => !one.startsWith('data:') && !one.startsWith('file:'));
"""


_FOCUSED = """
const host = document.activeElement;
if (host === document.body || host === document.documentElement) return null;
let one = host;
while (one.shadowRoot?.activeElement) one = one.shadowRoot.activeElement;
const shown = getComputedStyle(one), box = one.getBoundingClientRect();
return {
  name: one.outerHTML.slice(0, 80),
  seen: one.checkVisibility() && box.width > 0 && box.height > 0,
  ring: shown.outlineStyle !== 'none' && parseFloat(shown.outlineWidth) >= 1,
  place: [...document.querySelectorAll('*')].indexOf(host),
};
"""
_KEYS = 300  # more than any page has stops


def focus_failures(driver):
    """Return the faults of the stops of the tabulator key, from the top to the last one.

    Each stop is visible, has a ring, and follows the one before it in the document.
    """
    keys = pytest.importorskip("selenium.webdriver.common.keys").Keys
    chains = pytest.importorskip("selenium.webdriver.common.action_chains")
    driver.execute_script("window.scrollTo(0, 0); document.activeElement.blur()")
    found, last, stops = [], -1, 0
    for _ in range(_KEYS):
        chains.ActionChains(driver).send_keys(keys.TAB).perform()
        one = driver.execute_script(_FOCUSED)
        if one is None or one["place"] < last:
            break
        stops += one["place"] > last
        last = one["place"]
        found += [f"{lack}: {one['name']}" for lack in ("seen", "ring") if not one[lack]]
    focusable = driver.execute_script(_FOCUSABLE)
    if stops < focusable:
        found.append(f"{stops} stops of the tabulator key for {focusable} elements")
    return found


def look(driver, page, width=1400, scheme="light"):
    """Open a page at a width and on a ground; return once its figures are shown."""
    resize(driver, width, scheme)
    if driver.current_url != page.as_uri():
        driver.get(page.as_uri())
    until(driver, lambda: driver.execute_script(_SHOWN))


def page_failures(driver, page):
    """Return the faults of a page at any width and on either ground, each as a line."""
    driver.get("about:blank")  # a live page that an earlier test left calls its server again
    console_errors(driver)
    found = []
    for width in WIDTHS:
        look(driver, page, width)
        if too_wide := overflow(driver):
            found.append(f"{too_wide} px wider than {width} px")
        found += check_names(driver)
    found += focus_failures(driver)
    for scheme in ("light", "dark"):
        look(driver, page, scheme=scheme)
        found += [f"contrast, {scheme}: {one}" for one in contrast_failures(driver)]
    found += [f"fetched: {one}" for one in driver.execute_script(_FETCHED)]
    return list(dict.fromkeys(found)) + console_errors(driver)
