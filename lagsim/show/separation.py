"""Lagrange's equations in the definitions of the file, by virtual separation.

Written out, the equations of an arm of seven joints have millions of operations. Each
definition u(q, t) in the energies is therefore treated as a coordinate of its own, with
a constraint to its expression and the reaction R_u, and each definition w of velocities
has a momentum p_w = dL/dw. With p_u = dL/du', from the last definition to the first,

    p_w = dL/dw + sum_v p_v dv/dw,    Q_w = -dF/dw + sum_v Q_v dv/dw + ...,
    R_u = d/dt p_u - dL/du - Q_u - sum_c lambda_c dg_c/du + sum_v R_v dv/du,

where sums are over the definitions v that contain w, or u, and L, F, p, Q and g include
their dependence on all w. The equation of a coordinate q has the form of R_u = 0.
Each definition is differentiated once, so the total length is proportional to that of
the definitions.

Source: C. Lanczos, The Variational Principles of Mechanics, section III.5; the sign of
R is that of `mechanics.equations`. The order of the sums is reverse accumulation (A.
Griewank, A. Walther, Evaluating Derivatives, section 3.2).
"""

from __future__ import annotations

from dataclasses import replace
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING

from lagsim import limits
from lagsim.language.columns import MULTIPLIER
from lagsim.language.derivatives import pulled, pulled_within, tangent
from lagsim.language.elements import gathered
from lagsim.language.graph import CONSTANT, VARIABLE
from lagsim.language.names import rate_of
from lagsim.mechanics.constraints import Flow
from lagsim.model.model import Level
from lagsim.show import has_many_rows
from lagsim.show.names import PrintedName
from lagsim.show.symbols import Extent, extent_of, physics_of, together, written_out
from lagsim.show.tidy import too_long

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from lagsim.language.derivatives import Gradient
    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model


Found = dict[str, int]
"""Definitions of variables: name -> node."""

# Equations of more operations, written out, are given in the definitions of the file
# where energies are written with their rates.
LONGEST = 2_500


def words_of(model: Model) -> dict[int, PrintedName]:
    """Return the definitions by which long equations are written, the "words".

    The result maps nodes of definitions and of their rates to names, in the order of
    evaluation. A definition within a frame or body has a name without the section, such
    as `arm.2.xy`, if that name is free.
    """
    g = model.graph
    velocities = [rate_of(c.name) for c in model.coordinates]
    flow = Flow(g, [c.name for c in model.coordinates], velocities, model.states)
    taken = {x.name for x in (*model.definitions, *model.parameters, *model.variables)}
    cone = frozenset(g.cone(physics_of(model)))
    found: dict[int, PrintedName] = {}
    named = [(d, d.name) for d in model.definitions]
    for d in model.hidden:
        short = d.name.partition(".")[2]
        named.append((d, d.name if short in taken else short))
        taken.add(named[-1][1])
    moving = [d.node for d, _ in named if d.level is Level.POSITION]
    rates = dict(zip(moving, tangent(g, moving, flow.forward), strict=True))
    for d, name in named:
        nodes = [d.node]
        if d.level is Level.POSITION:
            nodes.append(rates[d.node])
        if d.level is Level.OUTPUT or cone.isdisjoint(nodes):
            continue
        for order, node in enumerate(nodes):
            if g.ops[node] not in (CONSTANT, VARIABLE):
                found.setdefault(node, PrintedName(name, order))
    return dict(sorted(found.items()))


def refuse_long(model: Model, words: Mapping[int, PrintedName]) -> None:
    """Refuse a model whose energies are too long even in its definitions.

    words : names of the nodes of definitions, see `words_of`.

    Raises
    ------
    InputError
    """
    extent = _extent(model.graph, physics_of(model), words)
    if extent.refused:
        size = extent.operations
        about = f"{size:.2g} operations" if size < 1e12 else "no end of operations"
        raise too_long(
            f"the energies, written out, have {about}, nested {extent.depth} deep, and "
            f"{extent.most} terms in a sum or product, and the limits are "
            f"{limits.WRITTEN_OPERATIONS:,}, {limits.WRITTEN_DEPTH} and "
            f"{limits.WRITTEN_TERMS:,}"
        )


def _extent(g: Graph, nodes: Iterable[int], words: Iterable[int]) -> Extent:
    """Return the joint extent of nodes and of the definitions of words.

    Within all of these, words are symbols.

    words : nodes of definitions.
    """
    words, nodes = list(words), list(nodes)
    found = dict.fromkeys(words, Extent(1, 1))
    extents = written_out(g, [*nodes, *(a for n in words for a in g.args[n])], found)
    return together([*extents[: len(nodes)], *(extent_of(g, n, found) for n in words)])


def is_long(e: Equations, words: Mapping[int, PrintedName]) -> bool:
    """Whether equations are written in the definitions of the file.

    They are if they would be too long otherwise.

    words : names of the nodes of definitions, see `words_of`.
    """
    if has_many_rows(e.model) or gathered(e.graph):
        return True
    physics = physics_of(e.model)
    if words and _extent(e.graph, physics, ()).refused:
        return True
    moving = e.graph.dependent(physics, e.velocities).intersection(words)
    nodes = [*physics, *e.f, *(x for row in e.M for x in row)]
    length = together(written_out(e.graph, nodes, {})).operations
    return bool(moving) and length > LONGEST


class Separation:
    """Lagrange's equations in the definitions ("words") of a model, as nodes.

    Parameters
    ----------
    e
        The equations; their graph gets variables for momenta, forces and reactions.
    words
        Names of nodes, see `words_of`.

    Attributes
    ----------
    names : dict
        Name of a new variable -> its displayed name.
    momenta, forces, reactions : dict
        Definitions of each p, Q and R: name -> node, ordered by dependence.
    rates : dict
        Definitions of the rates of words and momenta that occur, which are variables as
        well, ordered by dependence.
    equations : list of (int, int, int)
        For each coordinate the nodes p, left and Q (with multipliers): left = Q.
    """

    def __init__(self, e: Equations, words: Mapping[int, PrintedName]) -> None:
        self._e, self._g, self._words, self._flow = e, e.graph, words, e.flow
        g, flow = e.graph, e.flow
        definitions = (*e.model.definitions, *e.model.hidden)
        slow = {d.node for d in definitions if d.level is Level.POSITION}
        moving = g.dependent(words, e.q)
        positions = [n for n in words if n in slow and n in moving]
        self._speeds = [n for n in words if not (n in slow or words[n].order)]
        self._held = positions
        self._rate = dict(zip(flow.positions, flow.rates, strict=True))
        found = tangent(g, positions, flow.forward)
        self._rate |= zip(positions, found, strict=True)
        # Of positions with the same velocity the first has its momentum.
        self._owner = {v: n for n, v in reversed(self._rate.items())}
        self._still = frozenset(self._rate)
        self._moving = frozenset((*self._owner, *self._speeds))
        self.names: dict[str, PrintedName] = {}
        # Rates by which all is differentiated in time; of words they are variables.
        accelerations = map(g.variable, e.accelerations)
        self._seed = flow.forward | dict(zip(flow.rates, accelerations, strict=True))
        self._seed |= {n: self._rate[n] for n in positions}
        for n in (n for n in words if n in self._moving):
            name = replace(words[n], order=words[n].order + 1)
            self._seed[n] = self._variable(name)
        self.momenta: Found = {}
        self.forces: Found = {}
        self.reactions: Found = {}
        self.equations = self._separated()
        self.rates = self._rates_of_words()

    def _variable(self, name: PrintedName) -> int:
        """Return a new variable with the displayed name `name`."""
        called = f"{name.kind}.{name.base}" if name.kind else name.base
        called = rate_of(called, name.order)
        self.names[called] = name
        return self._g.variable(called)

    def _back(self, kind: str, found: Gradient, variables: frozenset[int]) -> Found:
        """Carry derivatives from definitions of velocities back to their variables.

        Parameters
        ----------
        kind : str
            Kind of the new variables: `momentum` or `force`.
        found : dict of int to int
            Derivative by each definition and variable, as nodes; updated.
        variables : frozenset of int
            The nodes of variables.

        Returns
        -------
        dict of str to int
            Definitions of the new variables: name -> node.
        """
        made: Found = {}
        for n in reversed(self._speeds):
            if n in found:
                made |= self._chain_derivative(kind, n, found.pop(n), found, variables)
        return made

    def _chain_derivative(
        self, kind: str, n: int, node: int, found: Gradient, variables: frozenset[int]
    ) -> Found:
        """Carry the derivative by one definition to the variables that it contains.

        Parameters
        ----------
        kind : str
            Kind of a new variable: `momentum` or `force`.
        n, node : int
            Nodes of the definition, and of the derivative by it, which becomes a new
            variable if it is an operation.
        found : dict of int to int
            Derivatives by variables, updated.
        variables : frozenset of int
            The nodes of variables.

        Returns
        -------
        dict of str to int
            Definition of the new variable: name -> node; {} without one.
        """
        g, word = self._g, self._words[n]
        made: Found = {}
        if g.ops[node] not in (VARIABLE, CONSTANT):
            name = self._variable(PrintedName(word.base, word.order, kind))
            made[str(g.payload(name))] = node
            node = name
        for v, slope in pulled_within(g, n, node, variables).items():
            found[v] = g.call("add", found.get(v, g.zero), slope)
        return made

    def _separated(self) -> list[tuple[int, int, int]]:
        """Compute momenta, forces and reactions of all words, the named definitions.

        Return for each coordinate the nodes p, left and Q, see `equations`.
        """
        g, model, flow = self._g, self._e.model, self._flow
        every = self._still | self._moving
        slopes = pulled(g, {model.lagrangian: g.one}, every)
        self.momenta = self._back("momentum", slopes, every)
        for name in [*self.momenta]:
            of = self.names[name]
            self._seed[g.variable(name)] = self._variable(replace(of, order=1))
        fixed, moved = self._applied()
        self.forces = self._back("force", moved, self._moving)
        carried: Gradient = {}
        found = {}
        for n in (*reversed(self._held), *flow.positions):
            v = self._rate[n]
            own_velocity = self._owner[v] == n
            p = slopes.get(v, g.zero) if own_velocity else g.zero
            own = g.call("sub", tangent(g, [p], self._seed)[0], slopes.get(n, g.zero))
            left = g.call("add", own, carried.get(n, g.zero))
            force = moved.get(v, g.zero) if own_velocity else g.zero
            Q = g.call("add", fixed.get(n, g.zero), force)
            found[n] = p, left, Q
            R = g.call("sub", left, Q)
            if n in self._words and g.zero != R:
                self.reactions |= self._chain_derivative(
                    "reaction", n, R, carried, self._still
                )
        return [found[n] for n in flow.positions]

    def _applied(self) -> tuple[Gradient, Gradient]:
        """Return the generalized forces of forces, constraints and dissipation.

        The two results map variables to nodes: forces along positions, and along
        velocities.
        """
        g, model = self._g, self._e.model
        fixed: Gradient = {}
        moved: Gradient = {}
        acting = [(f.direction, f.node, f.level) for f in model.forces]
        for c in model.constraints:
            node, multiplier = c.relation.node, g.variable(MULTIPLIER.of(c.name))
            holonomic = not g.depends([node]) & self._flow.velocities
            level = Level.POSITION if holonomic else Level.VELOCITY
            acting.append((node, multiplier, level))
        if model.dissipation is not None:
            acting.append((model.dissipation, g.constant(-1.0), Level.VELOCITY))
        for direction, weight, level in acting:
            still = level is Level.POSITION
            found, variables = (fixed, self._still) if still else (moved, self._moving)
            for v, slope in pulled(g, {direction: weight}, variables).items():
                found[v] = g.call("add", found.get(v, g.zero), slope)
        return fixed, moved

    def _rates_of_words(self) -> Found:
        """Return definitions of the time derivatives of words that occur: name -> node.

        Words are the named definitions of the file. The result is ordered by
        dependence.
        """
        g, nodes = self._g, [x for line in self.equations for x in line]
        nodes += [*self.reactions.values(), *self.momenta.values()]
        of = {str(g.payload(rate)): n for n, rate in self._seed.items()
              if g.ops[rate] == VARIABLE}  # fmt: skip
        values = {g.variable(name): node for name, node in self.momenta.items()}
        found: Found = {}
        stack = sorted(g.depends(nodes) & self.names.keys())
        while stack:
            name = stack.pop()
            if name not in found and name in of:
                n = of[name]
                # a copy without it would take time for each name
                own = self._seed.pop(n)
                found[name] = tangent(g, [values.get(n, n)], self._seed)[0]
                self._seed[n] = own
                stack += sorted(g.depends([found[name]]) & self.names.keys())
        needs = {
            name: sorted(g.depends([node]) & found.keys())
            for name, node in found.items()
        }
        return {name: found[name] for name in TopologicalSorter(needs).static_order()}
