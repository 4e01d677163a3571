"""A real browser, without a window: what a page has drawn."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
FOUND = next((path for name in NAMES if (path := shutil.which(name))), None)

needs_browser = pytest.mark.skipif(
    FOUND is None, reason=f"no browser on PATH: {', '.join(NAMES)}"
)


def shown(page, folder, fragment=""):
    """Give the time and the points that a page has drawn."""
    assert FOUND is not None
    command = [FOUND, *OPTIONS, f"--user-data-dir={folder}", "--dump-dom"]
    command.append(f"{page.resolve().as_uri()}{fragment}")
    done = subprocess.run(command, capture_output=True, timeout=60, check=True)
    document = done.stdout.decode()
    [body] = re.findall(r"<body[^>]*>", document)
    said = dict(re.findall(r'data-(\w+)="([^"]*)"', body))
    return float(said["t"]), json.loads(html.unescape(said["points"]))
