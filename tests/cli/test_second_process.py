"""Commands that compile with a second process."""

from __future__ import annotations

import os
import sys

import pytest

from lagsim import cli
from lagsim.native.link import ahead


def number() -> bytes:
    return str(os.getpid()).encode()


@pytest.mark.skipif(not ahead.is_possible(), reason="no second process")
@pytest.mark.parametrize("watched", [True, False])
@pytest.mark.parametrize("name", ["run", "fit", "explore", "sweep"])
def test_commands_without_threads_compile_with_a_second_process(
    name: str, watched: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["lagsim", name, "model.yaml"])
    monkeypatch.setattr(cli, "is_watched", lambda: watched)
    with cli._helped():
        made = ahead.start(number)()
    assert (made != number()) == (watched and name in ("run", "fit"))
    assert ahead.start(number)() == number()
