"""The command, called in this process."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import Any

import pytest

from lagsim.cli import main


@dataclass(frozen=True)
class Called:
    """What a call of the command gave."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The document on stdout: one, and nothing else."""
        return json.loads(self.out)


@pytest.fixture
def lagsim(monkeypatch, capsys, tmp_path):
    """Give a function that calls `lagsim` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)  # where these tests run

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["lagsim", *map(str, arguments)])
        capsys.readouterr()
        code = main()
        out, err = capsys.readouterr()
        return Called(code, out, err)

    return call


@pytest.fixture
def write(tmp_path):
    """Give a function that writes a model file, and gives its name."""

    def write(text, name="model.yaml"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return name

    return write
