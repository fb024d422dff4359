"""The system's Chromium, headless, with software rendering, as the tests of pages drive it."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, sync_playwright

from viewer.picture import CHROMIUM, FLAGS


@contextmanager
def chromium() -> Iterator[Browser]:
    """Give a browser that is closed at the end."""
    program = next(filter(None, map(shutil.which, CHROMIUM)), None)
    assert program, "these tests drive the system's Chromium: install the package chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        yield browser
        browser.close()
