"""Fixtures of hunts: lagsim as a process, a folder of failures, a night's seed."""

import datetime as dt
import os
from pathlib import Path

import pytest

from tests.hunt.lagsim_runs import Lagsim


@pytest.fixture
def lagsim(tmp_path):
    with Lagsim(tmp_path) as process:
        yield process


@pytest.fixture
def folder(tmp_path):
    return Path(os.environ.get("HUNT_FOLDER", tmp_path / "failures"))


@pytest.fixture
def seed():
    today = dt.datetime.now(dt.UTC).date().isoformat()
    return os.environ.get("HUNT_SEED", today)
