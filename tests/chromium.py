"""The system's Chromium without a display. A machine without it skips; in CI that is a failure."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def launched(*options: str) -> Iterator[Any]:
    """A browser, closed after use; ``SOFTWARE`` are its options to draw in space."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        words = "no Chromium: apt-get install chromium"
        if os.environ.get("CI"):
            pytest.fail(words)
        pytest.skip(words)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", *options]
        browser = playwright.chromium.launch(executable_path=program, args=arguments)
        yield browser
        browser.close()
