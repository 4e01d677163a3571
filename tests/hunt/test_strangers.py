"""No model file, whatever stands in it, gives a traceback or the exit of a bug."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import warnings

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lagsim.cli import main
from tests.hunt.strangers import files, options

# 0: done, 1: inadmissible, 2: unusable. A bug is 70.
CALM = (0, 1, 2)

hunted = settings(
    deadline=None, database=None, derandomize=True, print_blob=True,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip


@pytest.fixture
def said(tmp_path, monkeypatch):
    """Give a function that calls the command on a text; its exit code and stderr."""
    monkeypatch.chdir(tmp_path)
    model = tmp_path / "model.yaml"

    def call(text, line, *more):
        model.write_text(text, encoding="utf-8")
        command, *rest = line
        monkeypatch.setattr(sys, "argv", ["lagsim", command, model.name, *rest, *more])
        err, out = io.StringIO(), io.TextIOWrapper(io.BytesIO())
        with (
            contextlib.redirect_stdout(out), contextlib.redirect_stderr(err),
            warnings.catch_warnings(),
        ):  # fmt: skip
            warnings.simplefilter("ignore")  # as the process of the command does
            return main(), err.getvalue()

    return call


def hunt(said, examples, lines=options):
    @settings(hunted, max_examples=examples)
    @given(files(), lines)
    def calm(text, line):
        code, err = said(text, line)
        assert code in CALM, err
        assert "Traceback" not in err
        # What is refused is told; stdout is for `--json`.
        assert code != 2 or err or "--json" in line or "json" in line

    calm()


def test_no_file_is_a_bug(said):
    hunt(said, 60)


@pytest.mark.slow
def test_no_file_is_a_bug_of_many(said):
    # Not `derive`: nothing bounds how long sympy takes for one of so many.
    hunt(said, 600, st.sampled_from((("check",), ("check", "--json"))))


@pytest.mark.nightly
@pytest.mark.timeout(3600)  # 0.2 s each on an idle machine
def test_no_file_is_a_bug_of_very_many(said):
    hunt(said, int(os.environ.get("LAGSIM_HUNT_STRANGERS", "2000")))


@pytest.mark.slow
def test_no_run_is_a_bug(said):
    short = ("--duration", "0.01", "--output-step", "0.001", "--error-bar", "never")
    lines = st.sampled_from(((), ("--animate",), ("--method", "radau")))

    @settings(hunted, max_examples=60)
    @given(files(), lines)
    def calm(text, line):
        code, err = said(text, ("run", "-o", "out", "--no-plots", *short, *line))
        assert code in (*CALM, 3), err
        assert "Traceback" not in err

    calm()
