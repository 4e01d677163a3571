"""The command, called in this process."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import Any

import pytest

from lagsim.cli import main
from lagsim.run.observers.monitors import ResidualMonitor
from tests.blank_pictures import blank_pictures  # noqa: F401  a fixture
from tests.small_scenes import PENDULUM

# The files of the pendulum's golden, by name: stored once in each process.
_GOLDEN: dict[str, bytes] = {}


@dataclass(frozen=True)
class Called:
    """Result of a call of the command."""

    code: int
    out: str
    err: str

    def reports(self, number, *names):
        """Return whether stderr has a message of this number with these names."""
        found = f"[{number}]" in self.err
        return found and all(name in self.err for name in names)

    @property
    def json(self) -> Any:
        """The document on stdout: one, and nothing else."""
        return json.loads(self.out)


@pytest.fixture
def lagsim(monkeypatch, capsys, tmp_path):
    """Return a function that calls `lagsim` in an empty folder.

    `code`, `out`, `err` : the expected exit code and texts.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)  # where these tests run

    def call(*arguments, **expected):
        monkeypatch.setattr(sys, "argv", ["lagsim", *map(str, arguments)])
        capsys.readouterr()
        found = Called(main(), *capsys.readouterr())
        given = {name: getattr(found, name) for name in expected}
        assert given == expected, found.out + found.err
        return found

    return call


@pytest.fixture
def actions(lagsim, monkeypatch, tmp_path):  # noqa: ARG001  it comes before
    """Call the command as GitHub's runner does."""
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_WORKSPACE", str(tmp_path))


@pytest.fixture
def at_rows(monkeypatch):
    """Return a function that registers a call before each block of rows is stored."""

    def at_rows(act):
        def add(self, rows):
            act(rows)
            return taken(self, rows)

        taken = ResidualMonitor.add
        monkeypatch.setattr(ResidualMonitor, "add", add)

    return at_rows


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a model file and returns its name."""

    def write(text, name="model.yaml"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return name

    return write


@pytest.fixture
def stored(lagsim, write, tmp_path):
    """Write the pendulum and its golden; return the name of the model's file."""
    file, folder = write(PENDULUM, "pendulum.yaml"), tmp_path / "golden"
    if not _GOLDEN:
        assert lagsim("golden", file, "--update", "-q").code == 0
        _GOLDEN.update((path.name, path.read_bytes()) for path in folder.iterdir())
    folder.mkdir(exist_ok=True)
    for name, content in _GOLDEN.items():
        (folder / name).write_bytes(content)
    return file
