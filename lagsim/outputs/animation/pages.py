"""The page that explores a model, from the scripts and styles of the animation."""

from __future__ import annotations

import base64
import hashlib
import re
import zlib
from typing import Any

from lagsim.outputs.animation import COMMON, filled, page_part
from lagsim.outputs.manifest import encode

# In this order: each script uses the ones before it.
LIVE = (*COMMON, "live.js", "explore.js")
HELD = (*COMMON, "file.js", "explore.js")
WORKER = ("numbers.js", "start.js", "lengths.js", "dragging.js", "film.js", "worker.js")
_SCRIPT = re.compile(rb"<script>(.*?)</script>", re.DOTALL)


def explorer(title: str) -> bytes:
    """Return the HTML page of a model whose motions a server computes.

    Parameters
    ----------
    title : str
        The name of the model.
    """
    return filled(
        title, kind="explore", scripts=LIVE, more=page_part("explore.html"),
        styles=("page.css", "explore.css"), policy="base-uri 'none'",
    )  # fmt: skip


def compressed(content: bytes) -> str:
    """Return bytes in the form that the page unpacks: deflated, in base64."""
    return base64.b64encode(zlib.compress(content, 9)).decode()


def holding(
    about: dict[str, Any], content: bytes, module: bytes, mathml: bytes
) -> bytes:
    """Return the HTML page of a model that computes its motions itself.

    Parameters
    ----------
    about : dict
        The model as the page shows it: name, description, sliders.
    content, module, mathml : bytes
        Data of the page's worker, the WebAssembly module of the run, and the equations.
    """
    text = encode(about).decode().replace("<", "\\u003c")
    worker = "\n".join(['"use strict";', *map(page_part, WORKER)])
    data = "".join(
        f'<script type="{kind}" id="{name}">{given}</script>\n'
        for name, kind, given in (
            ("model", "application/json", text),
            ("content", "text/plain", compressed(content)),
            ("module", "text/plain", compressed(module)),
            ("mathml", "text/plain", compressed(mathml)),
            ("worker", "text/plain", compressed(worker.encode())),
        )
    )

    def page(script: str) -> bytes:
        return filled(
            str(about["name"]), kind="explore", scripts=HELD, data=data,
            more=page_part("explore.html"), styles=("page.css", "explore.css"),
            policy=f"default-src 'none'; script-src {script} 'wasm-unsafe-eval'; "
            "worker-src blob:; style-src 'unsafe-inline'; img-src data:; "
            "base-uri 'none'; form-action 'none'",
        )  # fmt: skip

    return page(_digest(page("")))


def _digest(page: bytes) -> str:
    """Return the source expression of the script of a page."""
    [script] = _SCRIPT.findall(page)
    return f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'"


def policy(page: bytes) -> str:
    """Return the Content-Security-Policy of a page: its own script and server alone."""
    return (
        f"default-src 'none'; script-src {_digest(page)}; "
        "style-src 'unsafe-inline'; img-src data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
