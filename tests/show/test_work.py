"""A derivation takes work in proportion to the equations that it writes."""

import functools
import subprocess
import sys

import pytest

from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read
from lagsim.show.lagrange import derived
from lagsim.show.text import as_text
from tests.support import ROOT


def turned(n, k):
    return " + ".join(f"q{(j + k) % n}" for j in range(n))


SHAPES = {
    "sines": lambda n: " + ".join(f"sin({turned(n, 0)} + {k})" for k in range(15)),
    "products": lambda n: " + ".join(
        f"sin({turned(n, k)})*cos({turned(k + 1, 0)})" for k in range(n)
    ),
    "choices": lambda n: functools.reduce(
        lambda inner, j: f"{'min' if j % 2 else 'max'}({inner}, {j + 1}*q{j})",
        range(n), "q0",
    ),
}  # fmt: skip


def derivation(potential, n):
    names = [f"q{j}" for j in range(n)]
    text = f"""
coordinates: {{{", ".join(f"{q}: {{}}" for q in names)}}}
energy:
  kinetic: {" + ".join(f"{q}_dot^2/2" for q in names)}
  potential: "{potential}"
initial: {{{", ".join(f"{q}: 0.1" for q in names)}}}
"""
    return derived(derive(read(text, "model.yaml"), chained=False))


def work(potential, n):
    """Return the number of calls of a derivation per letter of its text."""
    calls = 0

    def counted(_, event, __):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(counted)
    try:
        written = as_text(derivation(potential, n))
    finally:
        sys.setprofile(None)
    return calls / len(written)


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_twice_the_coordinates_take_no_more_work_for_each_letter(shape):
    # In a process of its own: what others have left in sympy's caches is not counted.
    code = (
        "from tests.show.test_work import SHAPES, work\n"
        f"shape = SHAPES[{shape!r}]\n"
        "work(shape(2), 2)  # what sympy makes once\n"
        "print(*(work(shape(n), n) for n in (9, 18)))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    few, many = map(float, done.stdout.split())
    assert many < 1.15 * few
