"""Guesses of relations that only rounding meets, and of relations with far roots."""

from __future__ import annotations

import pytest

from lagsim.admissibility.point import Point
from tests.admissibility.scenes import codes, judged, scene


@pytest.mark.parametrize("other", ["", "m", "far"])
@pytest.mark.parametrize("guess", ["-1", "0.3", "1", "40"])
@pytest.mark.parametrize(
    "relation",
    [
        "x = sqrt(1 + x^2)",
        "x - 3 = hypot(0.01, x - 3)",
        "0.001*x = sqrt(1e-6 + 1e-6*x^2)",
        "x + 5 = sqrt(1 + (x + 5)^2)",
        "sqrt(x^2 + 1) - sqrt(x^2) = 0",
        "1/(1 + x^2) = 0",
    ],
)
def test_a_guess_that_runs_away_is_no_answer(relation, guess, other):
    """No number meets any of these, though all do so at infinity.

    Nor does it with a heavy bystander, or one far from the origin.
    """
    initial = {"x": f"{{guess: {guess}}}"}
    if other:
        initial["z"] = "1e9" if other == "far" else "1"
    kinetic = "x_dot^2/2 + 1e9*z_dot^2/2" if other == "m" else ""
    start = judged(scene(relation, initial, kinetic=kinetic))
    assert not start.admissible


@pytest.mark.parametrize(
    ("relation", "guess", "root"),
    [
        ("x = 1e7", "1", 1e7),
        ("x/1e9 = 3", "1", 3e9),
        ("x = sqrt(1 + x^2) - 1e-3", "1", (1.0 - 1e-6) / 2e-3),
        ("(x - 1)^2 = 0", "2", 1.0),
        ("x*exp(-x) = 0", "0.4", 0.0),
        ("(x + 1e9) - 1e9 = 3", "0", 3.0),
        ("log(x) = 12", "1", 162754.79141900392),
    ],
)
def test_a_root_however_far_is_one(relation, guess, root):
    start = judged(scene(relation, {"x": f"{{guess: {guess}}}"}))
    assert start.admissible
    assert start.state.q[0] == pytest.approx(root, rel=1e-6, abs=1e-6)


def test_why_a_guess_is_none():
    start = judged(scene("x = sqrt(1 + x^2)", {"x": "{guess: 1}"}))
    assert "other-roots" not in codes(start)
    assert "diverges" in start.unsolved


@pytest.mark.parametrize("guess", ["3e4", "1e5", "3e5"])
@pytest.mark.parametrize("least", [Point.LARGE, 1])
def test_a_guess_that_runs_away_from_afar(guess, least, monkeypatch):
    """Where few steps lead to what rounding meets; in sparse matrices, too."""
    monkeypatch.setattr(Point, "LARGE", least)
    start = judged(scene("x = sqrt(1 + x^2)", {"x": f"{{guess: {guess}}}"}))
    assert "diverges" in start.unsolved
