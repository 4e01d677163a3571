"""Numbers that doubles hardly hold, and a system that has no more to give."""

import errno
import os

import pytest

from lagsim.cli import _faults
from lagsim.native.link import cache, engine
from tests.small_scenes import PENDULUM, scene
from tests.support import refused

FREE = scene("x: 2, y: 1", "x", simulation="duration: 1")


def test_a_run_too_short_to_be_divided(lagsim, write):
    model = write(FREE.replace("duration: 1", "duration: 5e-324"))
    for command in ("run", "check", "golden"):
        called = lagsim(command, model, code=2)
        assert called.reports("E129", "model.yaml:4:24:", "4.94066e-324")


# NumPy's warnings are silent in the process of the command, which says it in words.
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("inertia", "rows"),
    [
        # A step of Newton's method, a mass matrix, the rows: none of them in doubles.
        ("1e200", "1e200*x^20 + exp(100*y) = 1e300"),
        ("1e-200", "1e300*x*y + 1e-300*y^3 = 1e154"),
        ("1e308", "1e160*exp(x^4) + 1e-160*tan(y) = 1"),
        ("1e-308", "1e308*x^100 = 1e308*y"),
    ],
)
def test_a_start_that_doubles_do_not_hold(lagsim, write, inertia, rows):
    text = FREE.replace("(x_dot^2 + y_dot^2)/2", f"{inertia}*x_dot^2/2 + y_dot^2/2")
    called = lagsim("check", write(f"{text}constraints: {{c: '{rows}'}}\n"))
    assert called.code in (1, 2)
    assert "Traceback" not in called.err


# NumPy's warnings are silent in the process of the command, which says it in words.
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_contact_whose_multiplier_doubles_do_not_hold(lagsim, write):
    text = FREE + "constraints: {c: {relation: 1e-160*x >= 0, restitution: 0}}\n"
    called = lagsim("run", write(text.replace("n: 1", "n: 3")), "--no-plots", code=3)
    assert called.reports("E503", "t = 2.0")


@pytest.mark.slow
@pytest.mark.drawn
def test_a_point_of_the_scene_that_is_nowhere(lagsim, write):
    text = FREE + "definitions: {p: sqrt(-1 - x^2)}\nscene: {points: {a: [p, x]}}\n"
    called = lagsim("run", write(text), "-o", "out")
    assert (called.code, "Traceback" in called.err) == (0, False)


@pytest.mark.parametrize("form", ["text", "latex", "json", "python"])
@pytest.mark.parametrize(
    "potential",
    [
        "if(if(x < 1, x, 2*y) < 2, x^2, if(x > 3, x, 0))",
        "if(not if(x < 1, x, y) < 2 or x = y, x, y)",
        "(-8)^(1/3)*x + (-x^2 - 1)^0.5 + (x - 3)^(x/2)",
        "x^y^x + y*x^(y + 2)",
        "hypot(min(t, 1e308), 1e300)*x",
    ],
)
def test_equations_of_unusual_expressions(lagsim, write, potential, form):
    text = FREE.replace("potential: x", f"potential: '{potential}'")
    called = lagsim("derive", write(text), "--format", form)
    assert called.code in (0, 2)
    assert "Traceback" not in called.err
    assert called.out or called.err


@pytest.mark.slow
def test_a_condition_in_a_condition_is_written_with_and_and_or(lagsim, write):
    text = FREE.replace("potential: x", "potential: 'if(if(x < 1, y, t) < 2, x, 0)'")
    called = lagsim("derive", write(text), "--ascii")
    assert "x < 1" in called.out
    assert "y < 2" in called.out


@pytest.mark.slow
def test_a_processor_that_nobody_knows(lagsim, write, monkeypatch):
    monkeypatch.setenv(engine.CPU_VARIABLE, "foo")
    called = lagsim("run", write(FREE), "--no-plots")
    assert (called.code, called.reports("E904", "foo")) == (2, True)
    engine._demand_known("generic")
    with refused("unknown-cpu"):
        engine._demand_known("no such")


def test_an_object_that_is_that_of_another_is_not_used(tmp_path):
    cache._write(tmp_path / "a.object", "a", b"code")
    assert cache._read(tmp_path / "a.object", "a") == b"code"
    assert cache._read(tmp_path / "a.object", "b") is None


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (MemoryError(), "not enough memory"),
        (OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)), "not enough memory"),
        (ImportError("x.so: failed to map segment from it"), "not enough memory"),
        (RuntimeError("can't start new thread"), "not enough memory"),
        (OSError(errno.EMFILE, os.strerror(errno.EMFILE), "x"), "too many files"),
    ],
)
def test_a_system_that_has_no_more_to_give(lagsim, write, monkeypatch, error, told):
    def raises(*_):
        raise error

    monkeypatch.setattr("lagsim.plan.plan.make_plan", raises)
    called = lagsim("run", write(PENDULUM))
    assert (called.code, "Traceback" in called.err) == (_faults.STARVED_EXIT, False)
    assert told in called.err


def test_a_guess_whose_square_is_no_number(lagsim, write):
    # Warnings are errors here, and would be bugs of lagsim's.
    start = "x: {guess: 1e200}, y: {guess: 1e180}"
    text = scene(start, constraints="c: x^2 + y^2 = 1e300")
    called = lagsim("check", write(text), code=2)
    assert called.reports("E221", "`x^2`", "`c`", " inf ")
