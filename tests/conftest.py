"""What tests of several folders share."""

from __future__ import annotations

import signal

import pytest


@pytest.fixture
def heeded_signals():
    """Heed SIGINT and SIGTERM as in a foreground job, whoever started pytest.

    Under `trap '' INT`, or with `&` in a script, both pytest and what it starts would
    ignore them.
    """
    before = {
        kind: signal.signal(kind, heeded)
        for kind, heeded in (
            (signal.SIGINT, signal.default_int_handler),
            (signal.SIGTERM, signal.SIG_DFL),
        )
    }
    yield
    for kind, handler in before.items():
        signal.signal(kind, handler)
