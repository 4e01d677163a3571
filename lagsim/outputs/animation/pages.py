"""The page that explores a model, from the scripts and styles of the animation."""

from __future__ import annotations

import base64
import hashlib
import re

from lagsim.outputs.animation import COMMON, filled, part

# In this order: each script uses the ones before it.
LIVE = (*COMMON, "live.js", "explore.js")
_SCRIPT = re.compile(rb"<script>(.*?)</script>", re.DOTALL)


def explorer(title: str) -> bytes:
    """Return the HTML page of a model whose motions a server computes.

    Parameters
    ----------
    title : str
        The name of the model.
    """
    return filled(
        title, kind="explore", scripts=LIVE, more=part("explore.html"),
        styles=("page.css", "explore.css"), policy="base-uri 'none'",
    )  # fmt: skip


def policy(page: bytes) -> str:
    """Return the Content-Security-Policy of a page: its own script and server alone."""
    [script] = _SCRIPT.findall(page)
    digest = base64.b64encode(hashlib.sha256(script).digest()).decode()
    return (
        f"default-src 'none'; script-src 'sha256-{digest}'; "
        "style-src 'unsafe-inline'; img-src data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
