"""A scene's textbook equations as graph nodes, and compiled for other solvers."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np
import textbook

from lagsim.language.graph import Graph
from lagsim.native.graph.keys import Layout
from lagsim.native.graph.straight_line import generate
from lagsim.native.link.engine import Engine, compile_object
from lagsim.program.signatures import FUNCTION


@dataclass(frozen=True)
class Node:
    """A node of a graph, with the operators of numbers."""

    g: Graph
    n: int

    def _of(self, op, other, *, swapped=False):
        n = other.n if isinstance(other, Node) else self.g.constant(other)
        pair = (n, self.n) if swapped else (self.n, n)
        return Node(self.g, self.g.call(op, *pair))

    def __add__(self, other):
        return self._of("add", other)

    def __sub__(self, other):
        return self._of("sub", other)

    def __mul__(self, other):
        return self._of("mul", other)

    def __truediv__(self, other):
        return self._of("div", other)

    def __radd__(self, other):
        return self._of("add", other, swapped=True)

    def __rsub__(self, other):
        return self._of("sub", other, swapped=True)

    def __rmul__(self, other):
        return self._of("mul", other, swapped=True)

    def __rtruediv__(self, other):
        return self._of("div", other, swapped=True)

    def __neg__(self):
        return Node(self.g, self.g.call("neg", self.n))

    def __pow__(self, power):
        if power == 2:
            return self * self
        assert power == -1.5, power
        return 1.0 / (self * Functions.sqrt(self))


class Functions:
    """Functions of nodes, with which `textbook.OF` builds y' on a graph."""

    @staticmethod
    def sin(x):
        return Node(x.g, x.g.call("sin", x.n))

    @staticmethod
    def cos(x):
        return Node(x.g, x.g.call("cos", x.n))

    @staticmethod
    def sqrt(x):
        return Node(x.g, x.g.call("sqrt", x.n))


def nodes_of(model, names, velocities, parameters):
    """Return a new graph, and the nodes of y' of the scene on it."""
    g = Graph()
    q, v = (
        [Node(g, g.variable(name)) for name in part] for part in (names, velocities)
    )
    found = textbook.OF[model](q, v, parameters, Functions)
    return g, [node.n for node in [*v, *found]]


class Compiled:
    """y' as a native function, alone or beside other IR that calls it.

    Attributes
    ----------
    p : array
        The memory of parameters that the function reads.
    """

    def __init__(self, g, nodes, names, beside=()):
        layout = Layout({name: k for k, name in enumerate(names)}, {}, frozenset(), 0)
        code = generate(g, {"derivative": nodes}, layout)
        objects = [compile_object(code.ir, optimise=False)]
        self.engine = Engine(objects + [compile_object(ir) for ir in beside])
        self.p = np.zeros(max(1, code.p_size))
        self.engine.function("prepare", *FUNCTION)(0.0, None, self.p.ctypes.data, None)
        self._call = self.engine.function("derivative", *FUNCTION)
        self._y, self._out = np.zeros(len(names)), np.zeros(len(names))
        arrays = (self._y, self.p, self._out)
        self._at = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        self.evaluations = 0

    def __call__(self, t, y):
        """Return y' (size,) at time t and state y (size,)."""
        self.evaluations += 1
        self._y[:] = y
        self._call(t, *self._at)
        return self._out.copy()
