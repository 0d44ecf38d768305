"""The browser in which pages are tested: the system's Chromium, driven by Playwright, without a window.

Run as a program, this file tells whether it starts; .ci/setup does so. The exit code is 0 if it does, 3 if there is no
Chromium, and 1 with the reason on stderr otherwise.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ARGUMENTS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""No graphics card is needed."""
NOT_FOUND = 3


class NoBrowserError(Exception):
    """No browser starts here; the text says why and what to do."""


def find_chromium() -> str | None:
    """The path of the system's Chromium."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


@contextmanager
def running_chromium() -> Iterator[Any]:
    """A browser that runs.

    Raises:
        NoBrowserError: None is there, or it does not start.
    """
    path = find_chromium()
    if path is None:
        raise NoBrowserError("no Chromium is installed: apt-get install chromium")
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError as error:
        raise NoBrowserError("Playwright is not installed: make test installs it") from error
    manager = sync_playwright()
    try:
        driver = manager.__enter__()
    except (
        Exception
    ) as error:  # Playwright's own program ends at once, for which it has no error of one kind.
        raise NoBrowserError(
            f"Playwright does not start ({_line(error)}): apt-get install libatomic1"
        ) from error
    try:
        try:
            browser = driver.chromium.launch(executable_path=path, args=list(ARGUMENTS))
            browser.new_page().close()
        except Error as error:
            raise NoBrowserError(f"{path} does not start: {_line(error)}") from error
        yield browser
        browser.close()
    finally:
        manager.__exit__(None, None, None)


def _line(error: Exception) -> str:
    return (str(error) or type(error).__name__).strip().splitlines()[0]


def main() -> int:
    """Try it."""
    try:
        with running_chromium():
            return 0
    except NoBrowserError as error:
        print(error, file=sys.stderr)
        return NOT_FOUND if find_chromium() is None else 1


if __name__ == "__main__":
    sys.exit(main())
