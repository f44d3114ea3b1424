"""Headless Chromium, found and driven; only films and stills need it."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rpctl.errors import RpctlError

BROWSER_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
BROWSER_FLAGS = (
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)  # WebGL without a graphics card
NO_BROWSER = (
    "films and stills are drawn by Chromium or Chrome, and none was found; run: playwright install "
    "chromium, or install your system's package"
)


def require_browser() -> None:
    """Raise if no browser is found; called before anything is computed for a page.

    Raises:
        RpctlError: Playwright or a browser is missing.
    """
    with _driver() as driver:
        _executable(driver)


@contextmanager
def open_page(html: str, width: int, height: int) -> Iterator[Any]:
    """Open a page in headless Chromium, cut off from the network; yields Playwright's page.

    Args:
        html: The page.
        width: Of the window, pixels.
        height: Of the window, pixels.

    Raises:
        RpctlError: Playwright or a browser is missing, or the page fails.
    """
    from playwright.sync_api import Error

    try:
        with _driver() as driver:
            browser = driver.chromium.launch(
                executable_path=_executable(driver), args=list(BROWSER_FLAGS), handle_sigint=False
            )
            try:
                size = {"width": width, "height": height}
                page = browser.new_page(viewport=size, offline=True, color_scheme="light")
                page.set_content(html)
                yield page
            finally:
                browser.close()
    except Error as error:
        raise RpctlError(f"the browser failed: {error.message.splitlines()[0]}") from None


@contextmanager
def _driver() -> Iterator[Any]:
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise RpctlError("films and stills need more: pip install 'rpctl[film]'") from None
    starting = sync_playwright()
    with _interrupts_blocked():
        driver = starting.__enter__()
    try:
        yield driver
    finally:
        starting.__exit__(None, None, None)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Let processes that start meanwhile ignore Ctrl-C; this process closes them in order."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _executable(driver: Any) -> str:
    """Return the browser: the system's, or the one that Playwright installed."""
    candidates = (*map(shutil.which, BROWSER_NAMES), driver.chromium.executable_path)
    for path in candidates:
        if path and Path(path).is_file():
            return str(path)
    raise RpctlError(NO_BROWSER)
