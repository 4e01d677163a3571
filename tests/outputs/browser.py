"""A real browser, without a window: what a page has drawn."""

import html
import json
import re
import shutil
import subprocess

import pytest

from tests.patience import PATIENCE

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
FOUND = next((path for name in NAMES if (path := shutil.which(name))), None)

needs_browser = pytest.mark.skipif(
    FOUND is None, reason=f"no browser on PATH: {', '.join(NAMES)}"
)


def said(page, folder, fragment="", *options):
    """Give what the body of a page says of itself: its data attributes."""
    assert FOUND is not None
    command = [FOUND, *OPTIONS, *options, f"--user-data-dir={folder}", "--dump-dom"]
    command.append(f"{page.resolve().as_uri()}{fragment}")
    done = subprocess.run(
        command, capture_output=True, timeout=60 * PATIENCE, check=True
    )
    [body] = re.findall(r"<body[^>]*>", done.stdout.decode())
    found = re.findall(r'data-(\w+)="([^"]*)"', body)
    return {name: html.unescape(text) for name, text in found}


def shown(page, folder, fragment="", *options):
    """Give the time and the points that a page has drawn."""
    found = said(page, folder, fragment, *options)
    return float(found["t"]), json.loads(found["points"])
