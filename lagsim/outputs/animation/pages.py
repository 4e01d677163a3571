"""The page that explores a model, from the scripts and styles of the animation."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from typing import TYPE_CHECKING, Any

from lagsim.outputs.animation import COMMON, filled, page_part, wrapped
from lagsim.outputs.manifest import encode

if TYPE_CHECKING:
    from collections.abc import Sequence

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
        title, kind="explore", script=wrapped(LIVE), more=page_part("explore.html"),
        styles=("page.css", "explore.css"), policy="base-uri 'none'",
    )  # fmt: skip


def compressed(content: bytes) -> str:
    """Return bytes as text that the page unpacks: deflated, in base 85.

    The digit `<` is written `.`, so that no digits are a tag of HTML.
    """
    return base64.b85encode(zlib.compress(content, 9)).decode().replace("<", ".")


def holding(
    about: dict[str, Any],
    content: bytes,
    module: bytes,
    tapes: Sequence[tuple[int, int]],
    mathml: bytes,
) -> bytes:
    """Return the HTML page of a model that computes its motions itself.

    Parameters
    ----------
    about : dict
        Name, description and sliders of the model, as the page shows these.
    content, module, mathml : bytes
        Data of the page's worker, the WebAssembly module of the run, and the equations.
    tapes : sequence of (int, int)
        First byte and length of each tape in the module, whose instructions are in the
        order of `native.graph.tapes.by_columns`.
    """
    worker = "\n".join(['"use strict";', *map(page_part, WORKER)])
    script = wrapped(HELD)
    parts = {
        "script": script.encode(), "worker": worker.encode(), "module": module,
        "content": content, "page": encode(about), "mathml": mathml,
    }  # fmt: skip
    given = {"module": f' data-tapes="{json.dumps(tapes)}"'}
    data = "".join(
        f'<script type="text/plain" id="{name}"{given.get(name, "")}>'
        f"{compressed(part)}</script>\n"
        for name, part in parts.items()
    )

    def page(digests: str) -> bytes:
        return filled(
            str(about["name"]), kind="explore", script=page_part("loader.js"),
            data=data, more=page_part("explore.html"),
            styles=("page.css", "explore.css"),
            policy=f"default-src 'none'; script-src {digests} 'wasm-unsafe-eval'; "
            "worker-src blob:; style-src 'unsafe-inline'; img-src data:; "
            "base-uri 'none'; form-action 'none'",
        )  # fmt: skip

    return page(f"{_digest(page(''))} {digest_of(script.encode())}")


def _digest(page: bytes) -> str:
    """Return the hash of a page's script, as a Content-Security-Policy writes it."""
    [script] = _SCRIPT.findall(page)
    return digest_of(script)


def digest_of(script: bytes) -> str:
    """Return the hash of a script, as a Content-Security-Policy writes it."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'"


def policy(page: bytes) -> str:
    """Return the Content-Security-Policy of a page: only its script and its server."""
    return (
        f"default-src 'none'; script-src {_digest(page)}; "
        "style-src 'unsafe-inline'; img-src data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
