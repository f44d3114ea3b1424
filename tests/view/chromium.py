"""A real browser for pages of ours: what is drawn, and whether it changes."""

from __future__ import annotations

import base64
import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from PIL import Image

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next((path for path in map(shutil.which, BROWSERS) if path), None)
FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
WINDOW = {"width": 900, "height": 600}
PAGE_TIMEOUT_S = 60  # s that a page may take on a machine with much else to do


@contextmanager
def chromium() -> Iterator[Any]:
    """Yield a browser; a test that has none is skipped."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no chromium on PATH")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@contextmanager
def opened(browser: Any, url: str, *allowed: str, **options: Any) -> Iterator[Any]:
    """Yield a page that is ready; in the end it has complained of nothing and fetched nothing.

    Args:
        browser: The browser.
        url: The page.
        allowed: How the addresses begin that it may fetch nevertheless.
        options: Of the browser's context, such as its color_scheme.
    """
    context = browser.new_context(**{"viewport": WINDOW, **options})
    page = context.new_page()
    page.set_default_timeout(1000 * PAGE_TIMEOUT_S)
    problems: list[str] = []
    own = (url, "data:", "blob:", *allowed)
    page.on("console", lambda m: problems.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda r: None if r.url.startswith(own) else problems.append(r.url))
    page.goto(url)
    wait(page, "window.rpctl && window.rpctl.ready")
    yield page
    context.close()
    assert problems == []


def wait(page: Any, condition: str) -> None:
    """Wait until a condition holds; Playwright's own wait runs text, which the page forbids."""
    for _ in range(20 * PAGE_TIMEOUT_S):
        if page.evaluate(f"Boolean({condition})"):
            return
        page.wait_for_timeout(50)
    pytest.fail(f"after {PAGE_TIMEOUT_S} s still not: {condition}")


def picture(page: Any, viewer: str) -> np.ndarray[Any, Any]:
    """Return what a viewer (an expression) draws (h, w, 4), without what lies over it."""
    script = f"(() => {{ {viewer}.render(); return {viewer}.renderer.domElement.toDataURL(); }})()"
    data = base64.b64decode(page.evaluate(script).partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA")).astype(int)


def picture_at(page: Any, time: float) -> np.ndarray[Any, Any]:
    """Return what a report's scene draws (h, w, 4) at a time, s."""
    page.evaluate("(time) => { rpctl.pause(); rpctl.seek(time); }", time)
    return picture(page, "rpctl.viewer")


# Return the texts of those elements of a selector that are cut off, by themselves or the window.
CLIPPED = """(selector) => [...document.querySelectorAll(selector)].filter((element) => {
  const { left, right } = element.getBoundingClientRect();
  return element.scrollWidth > element.clientWidth + 1 || left < 0 || right > innerWidth;
}).map((element) => element.textContent)"""


def covering(page: Any, scene: str) -> list[str]:
    """Return the texts of the buttons and boxes that lie over what a selector shows."""
    script = """(selector) => {
      const scene = document.querySelector(selector).getBoundingClientRect();
      return [...document.querySelectorAll("button, select, input, label")].filter((each) => {
        const { left, right, top, bottom } = each.getBoundingClientRect();
        return right > left && left < scene.right && right > scene.left && top < scene.bottom
          && bottom > scene.top;
      }).map((each) => each.textContent); }"""
    return list(page.evaluate(script, scene))


def changed(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> int:
    """Return how many pixels differ so that the eye sees it."""
    return int((np.abs(a - b).max(axis=2) > 24).sum())
