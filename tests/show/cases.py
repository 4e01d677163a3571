"""Shipped models, derived once, and values, for the tests of this folder."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any

import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read
from lagsim.show import has_many_rows
from lagsim.show.lagrange import derived
from lagsim.show.printers import as_json
from lagsim.show.symbols import symbol
from tests.support import MODELS, SHIPPED, shipped
from tests.sympy_oracle import reads

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.mechanics.equations import Equations
    from lagsim.show import Content

# What sympy reads.
READ = [name for name in SHIPPED if reads(MODELS / f"{name}.yaml")]
# Their equations fill pages: some seconds each.
LONG = ("andrews", "bicycle", "rolling-disk-steady")
EACH = [
    pytest.param(name, marks=[pytest.mark.slow] if name in LONG else [])
    for name in SHIPPED
]


@functools.cache
def equations_of(name: str) -> Equations:
    model = shipped(name)
    return derive(model, chained=has_many_rows(model), trees=False)


@functools.cache
def content_of(name: str) -> Content:
    return derived(equations_of(name))


@functools.cache
def content_with_everything(name: str) -> Content:
    return derived(equations_of(name), with_gauss=True)


@functools.cache
def document_of(name: str) -> dict[str, Any]:
    return as_json(content_of(name))


def small(text: str, **options: bool) -> Content:
    return derived(derive(read(text, "model.yaml")), **options)


def numbers(texts: list[str], values: Mapping[str, float]) -> list[float]:
    """Read expressions by the parser of model files; return their values."""
    g = Graph()
    nodes = [parse(text).build(g, g.variable) for text in texts]
    return evaluate(g, nodes, {**values, "pi": math.pi})


def known(document: Mapping[str, Any], values: Mapping[str, float]) -> dict[str, float]:
    """Return the values with those of the definitions that keep their names."""
    found = dict(values)
    for name, text in document["definitions"].items():
        found[name] = numbers([text], found)[0]
    return found


def kept(c: Content) -> dict[tuple[str, ...], Any]:
    """Return the conserved quantities by their coordinates, the energy by ()."""
    return {tuple(k["of"]): k for k in c.document["conserved"]}


class Letters:
    """Symbols by their names: `s.theta_dot`."""

    def __getattr__(self, name: str) -> Any:
        return symbol(name)


s = Letters()
