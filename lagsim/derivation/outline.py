"""What a derivation tells a reader, and in which order; a subclass sets the type."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.derivation.names import Name
from lagsim.derivation.writer import Writer

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.derivation.content import Condition, Conserved, Content, Force, Line
    from lagsim.derivation.writer import Style

    Row = tuple[str, Any]  # what stands on the left, and the expression that it equals
    Rows = Sequence[Sequence[str]]  # of a matrix, written
    Entry = tuple[str, str, str]  # of a matrix: the names of row and column; written

# Digits of decimal numbers.
DIGITS = 6


class Outline:
    """The sections of a derivation.

    Parameters
    ----------
    content
        What is told.
    style
        How expressions look.
    signs
        By what it stands for, how it is written: the letters `T V L F G h`, `minus`,
        with places for names `slope`, `rate`, `Q f b K Qc`, and sentences; of some
        with ` held` where there are constraints.
    """

    # What fits on a line, with how much between two entries of a matrix.
    room, between = 0, 0

    def __init__(
        self, content: Content, style: Style, signs: Mapping[str, str]
    ) -> None:
        x = content.translation
        self.c, self.names, self.signs = content, style.names, signs
        self.write = Writer(style, x.names, x.rank, decimals=x.substitute)
        self.lines: list[str] = []

    def told(self) -> list[str]:
        """Write all sections; give the lines."""
        self._energies()
        if self.c.has_forces:
            self._forces()
        self._equations([(line, self._terms(line)) for line in self.c.lines])
        self._matrix_form()
        multipliers = self.c.translation.multipliers
        for k, lam in zip(self.c.constraints, multipliers, strict=True):
            self._title(f"Constraint {k.name} ({k.kind})")
            self._constraint(k)
            if k.law:
                self._law(k, lam)
        self._solution()
        if self.c.conserved:
            self._title(self.signs["conserved"])
        for item in self.c.conserved:
            self._conserved(item)
        self._gauss()
        return self.lines

    def sign(self, key: str, *names: str) -> str:
        """Give how something is written, with these names in it."""
        return self.signs[key].format(*names)

    def show(self, q: str, order: int = 0) -> str:
        """Give a coordinate or its derivative."""
        return self.names.show(Name(q, order))

    def _phrase(self, key: str) -> str:
        return self.signs[f"{key} held" if self.c.constraints else key]

    # Sections

    def _energies(self) -> None:
        c, head = self.c, self.signs["L"]
        self._title("Energies")
        rows: list[Row] = []
        if c.kinetic is not None and c.potential is not None:
            T, V = self.signs["T"], self.signs["V"]
            rows += [(T, c.kinetic), (V, c.potential)]
            head = f"{head} = {T} {self.signs['minus']} {V}"
        rows.append((head, c.lagrangian))
        if c.dissipation is not None:
            rows.append((self.signs["F"], c.dissipation))
        self._rows(rows)
        kept = c.translation.kept
        if kept:
            self._where([(self.write(k.symbol), k.value) for k in kept])

    def _forces(self) -> None:
        self._title("Generalized forces by virtual work")
        for force in self.c.forces:
            self._force(force)
        self._rows(
            [
                (self.sign("Q", self.show(line.coordinate)), line.terms["Q"])
                for line in self.c.lines
            ]
        )

    def _terms(self, line: Line) -> list[Row]:
        q, v = (self.show(line.coordinate, k) for k in (0, 1))
        labels = {"Q": self.sign("Q", q)}
        for letter in "TVL":
            of = self.signs[letter]
            labels[f"d{letter}_dq"] = self.sign("slope", of, q)
            labels[f"ddt_d{letter}_dqdot"] = self.sign("rate", of, v)
        return [(labels[k], e) for k, e in line.terms.items()]

    def _matrix_form(self) -> None:
        c = self.c
        self._title(self._phrase("matrix form"))
        self._say(self._phrase("motion"))
        names = [self.show(line.coordinate) for line in c.lines]
        self._matrix("M", c.M, names, names)
        self._rows([(self.sign("f", q), e) for q, e in zip(names, c.f, strict=True)])
        if c.constraints:
            labels = [self._label(k.name) for k in c.constraints]
            self._matrix("A", [k.A for k in c.constraints], labels, names)
            rows = zip(labels, c.constraints, strict=True)
            self._rows([(self.sign("b", label), k.b) for label, k in rows])

    def _matrix(
        self,
        letter: str,
        rows: Sequence[Sequence[Any]],
        labels: Sequence[str],
        names: Sequence[str],
    ) -> None:
        """Write a matrix as a square where it fits, else entry by entry."""
        written = [[self.write(e) for e in row] for row in rows]
        widths = [
            max(map(self._width, column)) for column in zip(*written, strict=True)
        ]
        if sum(widths) + self.between * len(widths) <= self.room:
            self._square(letter, written)
        else:
            symmetric = labels is names
            entries = [
                (labels[i], names[j], e)
                for i, row in enumerate(written)
                for j, e in enumerate(row)
                if e != "0" and (j >= i or not symmetric)
            ]
            self._entries(letter, entries, self.signs["symmetric"] * symmetric)

    def _solution(self) -> None:
        solved = self.c.solution
        if solved is None:
            return
        self._title("Accelerations")
        rows = [(self.write(s), e) for s, e in solved.steps]
        of = zip(self.c.lines, solved.accelerations, strict=True)
        rows += [(self.show(line.coordinate, 2), e) for line, e in of]
        multipliers = self.c.translation.multipliers
        found = zip(multipliers, solved.multipliers, strict=False)
        self._rows(rows + [(self.write(s), e) for s, e in found])

    def _gauss(self) -> None:
        principle, x = self.c.gauss, self.c.translation
        if principle is None:
            return
        self._title("Gauss's principle")
        self._say(self._phrase("principle"))
        free = [self.names.show(Name(q.name, 0, "unconstrained")) for q in x.q]
        rows = [(self.signs["G"], principle.G)]
        self._rows(rows + list(zip(free, principle.a or (), strict=False)))
        if not self.c.constraints:
            return
        self._say(self.signs["gain"])
        names = [self.show(q.name) for q in x.q]
        labels = [self._label(k.name) for k in self.c.constraints if not k.law]
        self._rows(
            [
                (self.sign("K", q, label), e)
                for q, row in zip(names, principle.K or (), strict=False)
                for label, e in zip(labels, row, strict=True)
            ]
            + [
                (self.sign("Qc", q), e)
                for q, e in zip(names, principle.Qc or (), strict=False)
            ]
        )

    # How it looks

    def _label(self, name: str) -> str:
        """Give the name of a constraint."""
        return name

    def _width(self, text: str) -> int:
        return len(text)

    def _title(self, text: str) -> None: ...
    def _say(self, text: str) -> None: ...
    def _rows(self, rows: Sequence[Row]) -> None: ...
    def _where(self, rows: Sequence[Row]) -> None: ...
    def _force(self, force: Force) -> None: ...
    def _equations(self, lines: Sequence[tuple[Line, list[Row]]]) -> None: ...
    def _constraint(self, k: Condition) -> None: ...
    def _law(self, k: Condition, multiplier: Any) -> None: ...
    def _conserved(self, item: Conserved) -> None: ...
    def _square(self, letter: str, rows: Rows) -> None: ...
    def _entries(self, letter: str, rows: Sequence[Entry], also: str) -> None: ...
