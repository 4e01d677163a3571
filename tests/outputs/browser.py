"""Headless browser, and the data of a page that is drawn in it."""

import base64
import fcntl
import html
import json
import os
import re
import select
import shutil
import subprocess
import time

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
    """Return the data attributes of the body of a page."""
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
    """Return the time and the points that a page has drawn."""
    found = said(page, folder, fragment, *options)
    return float(found["t"]), json.loads(found["points"])


class Tab:
    """A page in a browser without a window, driven through its debugging pipe."""

    def __init__(self, folder, width=1280, height=900):
        assert FOUND is not None
        # The browser reads from its descriptor 3 and writes to its descriptor 4.
        theirs, self._write = os.pipe()
        self._read, others = os.pipe()
        options = (
            *OPTIONS, "--remote-debugging-pipe", f"--user-data-dir={folder}",
            f"--window-size={width},{height}",
        )  # fmt: skip

        def numbered():
            first, second = (
                fcntl.fcntl(x, fcntl.F_DUPFD, 10) for x in (theirs, others)
            )
            os.dup2(first, 3)
            os.dup2(second, 4)

        self._browser = subprocess.Popen(
            [FOUND, *options, "about:blank"], pass_fds=(3, 4),
            preexec_fn=numbered,  # noqa: PLW1509  no thread of the tests holds a lock here
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(theirs)
        os.close(others)
        self._rest, self._count, self.messages = b"", 0, []
        targets = self.send("Target.getTargets", own=False)["targetInfos"]
        target = next(t["targetId"] for t in targets if t["type"] == "page")
        attached = self.send(
            "Target.attachToTarget", own=False, targetId=target, flatten=True
        )
        self._session = attached["sessionId"]
        for room in ("Page", "Runtime", "Log"):
            self.send(f"{room}.enable")
        self.size(width, height)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._browser.kill()
        self._browser.wait()
        os.close(self._read)
        os.close(self._write)

    def send(self, method, *, own=True, **given):
        """Send a command; return its result."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": given}
        if own:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + 60 * PATIENCE
        while True:
            found = self._next(end)
            if found.get("id") == self._count:
                assert "error" not in found, found["error"]
                return found["result"]
            self._note(found)

    def _next(self, end):
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._read], [], [], end - time.monotonic())
            assert ready, "the browser does not answer"
            new = os.read(self._read, 1 << 20)
            assert new, "the browser has ended"
            self._rest += new
        first, _, self._rest = self._rest.partition(b"\0")
        return json.loads(first)

    def _note(self, found):
        """Store the errors and warnings that the page reports."""
        given = found.get("params", {})
        if found.get("method") == "Runtime.exceptionThrown":
            details = given["exceptionDetails"]
            self.messages.append(
                details.get("exception", {}).get("description", details["text"])
            )
        if found.get("method") == "Log.entryAdded":
            self.messages.append(given["entry"]["text"])

    def size(self, width, height, *, dark=False, still=True):
        self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height,
            deviceScaleFactor=1, mobile=width < 600,
        )  # fmt: skip
        features = [
            {"name": "prefers-color-scheme", "value": "dark" if dark else "light"},
            {"name": "prefers-reduced-motion",
             "value": "reduce" if still else "no-preference"},
        ]  # fmt: skip
        self.send("Emulation.setEmulatedMedia", features=features)

    def open(self, address):
        """Open an address, and wait until the page shows a state or an error."""
        # The page before goes first, with what it still asks of an ended server.
        self.send("Page.navigate", url="about:blank")
        self.wait("location.href === 'about:blank'")
        self.messages.clear()
        self.send("Page.navigate", url=address)
        self.wait("document.body && (document.body.dataset.state || "
                  "document.body.dataset.error)")  # fmt: skip

    def run(self, script):
        """Return the value of an expression; of a promise, once it is resolved."""
        done = self.send(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in done:
            details = done["exceptionDetails"]
            raise RefusedError(
                details.get("exception", {}).get("description", str(details))
            )
        return done["result"].get("value")

    def wait(self, condition, seconds=20.0):
        """Wait until an expression is true."""
        for _ in range(int(50 * seconds * PATIENCE)):
            if self.run(f"Boolean({condition})"):
                return
            time.sleep(0.02)
        pytest.fail(f"never: {condition}; {self.messages}")

    @property
    def state(self):
        return json.loads(self.run("document.body.dataset.state"))

    @property
    def error(self):
        return self.run("document.body.dataset.error || ''")

    def mouse(self, kind, x, y):
        """Press, move or release the left button at a pixel."""
        name = {
            "press": "mousePressed",
            "move": "mouseMoved",
            "release": "mouseReleased",
        }
        self.send(
            "Input.dispatchMouseEvent", type=name[kind], x=x, y=y, button="left",
            buttons=0 if kind == "release" else 1, clickCount=1,
        )  # fmt: skip

    def picture(self, path):
        found = self.send("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(found["data"]))


class RefusedError(Exception):
    """A promise of the page that was rejected, or an exception there."""
