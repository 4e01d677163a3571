"""Writes a function of the graph as straight-line code.

Long functions are cut into pieces that pass values through scratch memory in p, so that
compile time grows in proportion to length.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE
from lagsim.native.graph import keys, sincos
from lagsim.native.graph.lines import CIRCULAR, Lines, exponent_of, number

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.native.graph.keys import Layout

CLEAR = "llvm.memset.p0.i64"
# An array of a function, and an index there.
Place = tuple[str, int]


def hoisted(g: Graph, roots: Sequence[int], moving: set[int]) -> list[int]:
    """Give the operations without `moving` variables that others, or roots, use."""
    used, varying = set(roots), set[int]()
    for n in g.cone(roots):
        if n in moving or any(a in varying for a in g.args[n]):
            varying.add(n)
            used.update(g.args[n])
    return sorted(n for n in used if n not in varying and g.args[n])


def ordered(
    g: Graph, roots: Collection[int], places: Mapping[int, object]
) -> list[int]:
    """Give what must be evaluated, stopping at what `prepare` has computed.

    Sines and cosines come early and side by side: first those of angles that wait
    for none, then those that wait for these.
    """
    order = g.cone(roots, places)
    depth: dict[int, int] = {}  # what is not in it waits for none
    rounds: dict[int, list[int]] = {}
    for n in order:
        waits = 0 if n in places else max([depth.get(a, 0) for a in g.args[n]] or (0,))
        if g.ops[n] in CIRCULAR and n not in places:
            waits += 1
            rounds.setdefault(waits, []).append(n)
        if waits:
            depth[n] = waits
    sorted_: dict[int, None] = {}
    for k in sorted(rounds):
        angles = [g.args[n][0] for n in rounds[k]]
        sorted_ |= dict.fromkeys(g.cone(angles, {**places, **sorted_}))
        sorted_ |= dict.fromkeys(rounds[k])
    return list(sorted_ | dict.fromkeys(order))


class Writer(Lines):
    """Writes one function, or those that it consists of.

    signature : of the function, as it is defined and called
    """

    signature = "double %t, ptr %y, ptr %p, ptr %out"

    def __init__(
        self,
        g: Graph,
        layout: Layout,
        scratch: int,
        *,
        contract: bool = False,
    ) -> None:
        super().__init__()
        self.g = g
        self.layout = layout
        self.contract = contract
        self.scratch = scratch
        self.scratch_used = 0
        self._sums: dict[int, int] = {}

    def function(
        self,
        name: str,
        stores: Sequence[tuple[int, Place]],
        places: Mapping[int, Place],
        *,
        more: str = "",
        linkage: str = "",
        cleared: int = 0,
    ) -> None:
        """Write it.

        Parameters
        ----------
        stores
            Nodes, and where they go.
        places
            What needs no evaluation, and where it is found.
        more
            Arrays besides those of the signature.
        cleared
            So many numbers of `out` are set to 0 before any is stored.
        """
        signature = self.signature + more
        order = ordered(self.g, [node for node, _ in stores], places)
        pieces = [
            order[i : i + keys.PIECE] for i in range(0, len(order), keys.PIECE)
        ] or [[]]
        at_end: dict[int, list[Place]] = {}
        for node, place in stores:
            at_end.setdefault(node, []).append(place)
        self._sums = self._fused(pieces, places, at_end)
        passed = self._passed(pieces, places)
        names = [name] if len(pieces) == 1 else [
            f"{name}.{i}" for i in range(len(pieces))
        ]  # fmt: skip
        for piece_name, piece in zip(names, pieces, strict=True):
            kind = linkage if piece_name == name else "internal "
            head = f"define {kind}void @{piece_name}({signature}) {{"
            self.lines.append(head)
            if len(pieces) == 1:
                self._clear(cleared)
            self._piece(piece, places, passed, at_end)
            self.lines += ["ret void", "}"]
        if len(pieces) > 1:
            self.lines.append(f"define {linkage}void @{name}({signature}) {{")
            self._clear(cleared)
            self.lines += [f"call void @{p}({signature})" for p in names]
            self.lines += ["ret void", "}"]

    def _clear(self, numbers: int) -> None:
        if numbers:
            self.declared.add(f"declare void @{CLEAR}(ptr, i8, i64, i1)")
            size = 8 * numbers
            self.lines.append(f"call void @{CLEAR}(ptr %out, i8 0, i64 {size}, i1 0)")

    def _fused(
        self,
        pieces: Sequence[Sequence[int]],
        places: Mapping[int, Place],
        kept: Collection[int],
    ) -> dict[int, int]:
        """Give the sums that take in a product which nothing else uses: -> it.

        Told here and not left to LLVM, whose choice nobody knows.
        """  # fmt: skip
        g, found = self.g, dict[int, int]()
        if not self.contract:
            return found
        made = [[n for n in piece if n not in places] for piece in pieces]
        uses = Counter(a for piece in made for n in piece for a in g.args[n])
        for piece in made:
            alone = {
                n for n in piece if g.ops[n] == "mul" and uses[n] == 1 and n not in kept
            }
            for n in piece:
                if g.ops[n] in ("add", "sub"):
                    products = [a for a in g.args[n] if a in alone]
                    found |= dict(zip([n], products[::-1], strict=False))
        return found

    def _passed(
        self, pieces: Sequence[Sequence[int]], places: Mapping[int, Place]
    ) -> dict[int, int]:
        """Give the index in p of operations that a later piece uses."""
        home = {n: i for i, piece in enumerate(pieces) for n in piece}
        passed: dict[int, int] = {}
        for i, piece in enumerate(pieces):
            for n in piece:
                for a in self.g.args[n] if n not in places else ():
                    earlier = home.get(a, i) < i and a not in places
                    if earlier and self.g.args[a] and a not in passed:
                        passed[a] = self.scratch + len(passed)
        self.scratch_used = max(self.scratch_used, len(passed))
        return passed

    def _piece(
        self,
        piece: Sequence[int],
        places: Mapping[int, Place],
        passed: Mapping[int, int],
        at_end: Mapping[int, Sequence[Place]],
    ) -> None:
        here: dict[int, str] = {}
        inside = set(self._sums.values())

        def operand(n: int) -> str:
            if n not in here:
                here[n] = self._leaf(n, places, passed)
            return here[n]

        for at, n in enumerate(piece):
            if self.g.args[n] and n not in places and n not in inside:
                if self.g.ops[n] in CIRCULAR and n not in here:
                    self._circular(piece[at:], places, here, operand)
                elif n in self._sums:
                    here[n] = self._sum(n, self._sums[n], operand)
                elif n not in here:
                    operands = [operand(a) for a in self.g.args[n]]
                    exponent = exponent_of(self.g, n)
                    here[n] = self.operation(self.g.ops[n], exponent, operands)
                if n in passed:
                    self._store(self._number(n, here[n]), ("p", passed[n]))
            for place in at_end.get(n, ()):
                self._store(self._number(n, operand(n)), place)

    def _sum(self, n: int, product: int, operand: Callable[[int], str]) -> str:
        """Write a sum or difference with one of its products inside."""
        g = self.g
        x, y = (operand(a) for a in g.args[product])
        [other] = [operand(a) for a in g.args[n] if a != product]
        if g.ops[n] == "sub" and g.args[n][1] == product:
            x = self.negated(x)
        elif g.ops[n] == "sub":
            other = self.negated(other)
        return self.fused(x, y, other)

    def _circular(
        self,
        nodes: Sequence[int],
        places: Mapping[int, Place],
        here: dict[int, str],
        operand: Callable[[int], str],
    ) -> None:
        """Write the sines and cosines that `nodes` begin with, of several angles."""
        g = self.g
        together: list[int] = []
        angles: dict[int, int] = {}
        for n in nodes:
            done = n in places or g.ops[n] not in CIRCULAR
            if done or g.args[n][0] in together:
                break
            angle = g.args[n][0]
            if angle not in angles and len(angles) == sincos.LANES:
                break
            angles.setdefault(angle, len(angles))
            together.append(n)
        wanted = [(g.ops[n], angles[g.args[n][0]]) for n in together]
        values = self.circular([operand(angle) for angle in angles], wanted)
        here.update(zip(together, values, strict=True))

    def _leaf(
        self, n: int, places: Mapping[int, Place], passed: Mapping[int, int]
    ) -> str:
        g = self.g
        if g.ops[n] == CONSTANT:
            x = g.value(n)
            assert x is not None
            return number(x)
        if g.ops[n] == TRUTH:
            return "true" if g.payload(n) else "false"
        if n in places:
            value = self._load(places[n])
        elif g.ops[n] == VARIABLE:
            return self._variable(str(g.payload(n)))
        else:
            value = self._load(("p", passed[n]))
        if g.args[n] and OPERATIONS[g.ops[n]].condition:
            return self.line(f"fcmp one double {value}, {number(0.0)}")
        return value

    def _variable(self, name: str) -> str:
        if name == "t":
            return "%t"
        if name in self.layout.y:
            return self._load(("y", self.layout.y[name]))
        return self._load(("p", self.layout.p[name]))

    def _number(self, n: int, value: str) -> str:
        """Write 1 or 0 for a truth value."""
        if self.g.args[n] and OPERATIONS[self.g.ops[n]].condition:
            return self.line(f"uitofp i1 {value} to double")
        return value

    def _load(self, place: Place) -> str:
        return self.line(f"load double, ptr {self._address(place)}")

    def _store(self, value: str, place: Place) -> None:
        self.lines.append(f"store double {value}, ptr {self._address(place)}")

    def _address(self, place: Place) -> str:
        array, k = place
        return self.line(f"getelementptr inbounds double, ptr %{array}, i64 {k}")
