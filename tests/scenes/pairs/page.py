"""Text of docs/pairs.md, which `benchmarks/regenerate.py` writes."""

from __future__ import annotations

from tests.scenes.pairs.commands import COMMANDS, FORMULATIONS, METHODS
from tests.scenes.pairs.physical import BY_NAME
from tests.scenes.pairs.scene import PAIRS, REFUSED
from tests.support import ROOT

PAGE = ROOT / "docs" / "pairs.md"
HEAD = """\
# Features in pairs

Which features of a model can be combined. Each feature is a small model with a motion
in closed form. Each pair of features is tested in one file, in two ways:

- *side by side*: the two motions have their own coordinates;
- *coupled*: the first coordinates of both are the sum and the difference of two others,
  so that both features are in the same expressions.

A test passes if

- each feature moves as it does alone, in every row, to 1e-9;
- energy - work is constant;
- the run ends where it should;
- there are no warnings other than those of the features.

The pairs are also tested far from the origin, in a moving frame, in other units of
length, time and mass, at a later start, in another order, and beside a planet, a grain
and a comet. `tests/scenes/pairs` has the tests, and the tables from which this page is
written.

In the tables `+` means tested against the closed form. A number means refused, for the
reason of that number in the list at the end.

## Features

"""
METHODS_HEAD = """
## Methods

Each method with each feature, to 1e-9. Methods with a fixed step take 0.001, and are
compared to 1e-2 (order 1) or 1e-5 (order 2).

"""
FORMULATIONS_HEAD = """
## Formulations

Each formulation with each feature beside a smooth one, to 1e-9.

"""
COMMANDS_HEAD = """
## Commands and outputs

Each command and output with each feature, most with another feature in the same
expressions. `check` counts degrees of freedom. A `sweep` has the bits of single runs, a
resumed run those of an uninterrupted one. A `golden` passes with other methods, and
fails if a number of the file changes by some millionths. `run --animate` plays the
rows. The reference of `bench` equals the closed form to 1e-9. `stability` gives the
eigenvalues of the linearised closed form. The closed form satisfies the equations of
`derive`. `action` is the integral of L over the rows, `gauss.G` that of the constraint
forces, and the `reactions` of free coordinates are 0.

"""
REFUSALS_HEAD = """
## Refusals

"""


def _table(columns, marks):
    rows = ["| | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    rows += [f"| {name} | " + " | ".join(own) + " |" for name, own in marks.items()]
    return "\n".join(rows) + "\n"


def _number(text, notes):
    """Return + for a pair that is not refused, else the number of the refusal."""
    if text is None:
        return "+"
    if text not in notes:
        notes.append(text)
    return str(notes.index(text) + 1)


def _pair(first, second, notes):
    pair = next(p for p in ((first, second), (second, first)) if p in PAIRS)
    return _number(REFUSED[pair].reason if pair in REFUSED else None, notes)


def page():
    """Return the text of docs/pairs.md: matrices, with the half below the diagonal."""
    names, notes = list(BY_NAME), []
    pairs = {}
    for k, first in enumerate(names):
        marks = [_pair(first, second, notes) for second in names[: k + 1]]
        pairs[f"{k + 1} {first}"] = marks + [""] * (len(names) - k - 1)
    methods = {
        name: [_number(METHODS[m].get(name), notes) for m in METHODS] for name in names
    }
    formulations = {
        name: [_number(FORMULATIONS[f].get(name), notes) for f in FORMULATIONS]
        for name in names
        if not BY_NAME[name].formulation
    }
    commands = {
        name: [_number(COMMANDS[c].get(name), notes) for c in COMMANDS]
        for name in names
    }
    reasons = [f"{i}. {text}" for i, text in enumerate(notes, 1)]
    return (
        HEAD
        + _table([str(k) for k in range(1, len(names) + 1)], pairs)
        + METHODS_HEAD
        + _table([f"`{m}`" for m in METHODS], methods)
        + FORMULATIONS_HEAD
        + _table([f"`{f}`" for f in FORMULATIONS], formulations)
        + COMMANDS_HEAD
        + _table([f"`{c}`" for c in COMMANDS], commands)
        + REFUSALS_HEAD
        + "\n".join(reasons)
        + "\n"
    )
