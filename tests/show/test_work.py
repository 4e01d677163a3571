"""A derivation takes work in proportion to the equations that it writes."""

from __future__ import annotations

import subprocess
import sys

import pytest

from lagsim.mechanics.equations import derive
from lagsim.model.reader import read
from lagsim.show.lagrange import content
from lagsim.show.text import as_text
from tests.support import ROOT


def sines(n):
    whole = " + ".join(f"q{j}" for j in range(n))
    return [f"sin({whole} + {k})" for k in range(15)]


def products_of_sines(n):
    names = [f"q{j}" for j in range(n)]
    return [
        f"sin({' + '.join(names[k:] + names[:k])})*cos({' + '.join(names[: k + 1])})"
        for k in range(n)
    ]


def nested_choices(n):
    choice = "q0"
    for j in range(n):
        choice = f"{'min' if j % 2 else 'max'}({choice}, {j + 1}*q{j})"
    return [choice]


def derived(terms, n):
    names = "".join(f"  q{j}: {{}}\n" for j in range(n))
    kinetic = " + ".join(f"q{j}_dot^2/2" for j in range(n))
    start = ", ".join(f"q{j}: 0.1" for j in range(n))
    text = f"""
coordinates:
{names}
energy: {{kinetic: {kinetic}, potential: "{" + ".join(terms)}"}}
initial: {{{start}}}
"""
    return content(derive(read(text, "model.yaml"), chained=False))


def work(terms, n):
    """Give the calls that a derivation makes for each letter that it writes."""
    calls = 0

    def counted(_, event, __):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(counted)
    try:
        written = as_text(derived(terms, n))
    finally:
        sys.setprofile(None)
    return calls / len(written)


@pytest.mark.parametrize(
    "shape",
    [
        sines,
        pytest.param(products_of_sines, marks=pytest.mark.slow),
        pytest.param(nested_choices, marks=pytest.mark.slow),
    ],
)
def test_twice_the_coordinates_take_no_more_work_for_each_letter(shape):
    # In a process of its own: what others have left in sympy's caches is not counted.
    name = shape.__name__
    code = (
        f"from tests.show.test_work import {name} as shape, work\n"
        "work(shape(2), 2)  # what sympy makes once\n"
        "print(*(work(shape(n), n) for n in (9, 18)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    few, many = map(float, done.stdout.split())
    assert many < 1.15 * few
