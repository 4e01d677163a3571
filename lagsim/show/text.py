"""A derivation as plain text: Unicode with dots, or ASCII in the model language.

The outline, sections and their order, is that of LaTeX, too.
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
from typing import TYPE_CHECKING, Any

from lagsim.show.content import ASCII, UNICODE, conditions, in_ascii
from lagsim.show.names import ModelNames, Name, UnicodeNames
from lagsim.show.printers import ModelPrinter, TextPrinter

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.show.content import Condition, Conserved, Content, Line
    from lagsim.show.printers import Printer

    # What stands on the left, the expression that it equals, and what follows.
    Row = tuple[str, Any] | tuple[str, Any, str]
    Rows = Sequence[Sequence[str]]  # of a matrix, written


WIDTH = 100


class Outline:
    """The sections of a derivation, as plain text.

    Parameters
    ----------
    content
        The derivation.
    write
        Prints expressions.
    signs
        How each symbol or phrase is written: the letters `T V L F G h`, `minus`,
        with places for names `slope`, `rate`, `Q f b K Qc`, and sentences; of some
        with ` held` where there are constraints.
    """

    # What fits on a line, with how much between two entries of a matrix.
    room, between = WIDTH - 8, 3

    def __init__(
        self, content: Content, write: Printer, signs: Mapping[str, str]
    ) -> None:
        self.c, self.names, self.signs = content, write.names, signs
        self.write = write
        self.lines: list[str] = []

    def document(self) -> list[str]:
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
            on = self.show(force.on)
            written = self._inline(self.write(force.force))
            self._say(f"force on {self._inline(on)}: {written}")
            if not force.direction.is_Symbol:
                self._rows([(on, force.direction)])
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
                (self.sign("entry", letter, labels[i], names[j]), e)
                for i, row in enumerate(rows)
                for j, e in enumerate(row)
                if e != 0 and (j >= i or not symmetric)
            ]
            self._rows(entries)
            also = self.signs["symmetric"] * symmetric
            bold = self._inline(self.sign("matrix", letter))
            self._say(f"other entries of {bold} are zero{also}")

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

    def _constraint(self, k: Condition) -> None:
        relation = self.signs["at least" if k.kind == "one-sided" else "="]
        rate = [] if k.moving else [k.rate]
        values = [k.function, *rate, k.acceleration]
        rows: list[Row] = list(zip(self._derivatives(k), values, strict=True))
        self._rows([(*rows[0], f" {relation} 0"), *rows[1:]])

    def _law(self, k: Condition, multiplier: Any) -> None:
        given = []
        for word in () if k.moving else ("restitution", "friction", "static", "slip"):
            value = k.law.get(word, ())
            parts = value if isinstance(value, tuple) else (value,)
            texts = [f"{p:g}" if isinstance(p, float) else self.write(p) for p in parts]
            if texts:
                given.append(f"{word}: {', '.join(map(self._inline, texts))}")
        self._given(given)
        gap, *rates = self._derivatives(k)
        called = gap, gap if k.moving else rates[0]
        stated = conditions(k, self.write, multiplier, called, self.statements)
        for about, text in stated.items():
            self._statement(about, text)

    def _conserved(self, item: Conserved) -> None:
        show = self._inline
        names = ", ".join(show(self.show(q)) for q in item.of)
        q = self.show(item.of[0]) if item.of else ""
        total, L = f"{self.signs['T']} + {self.signs['V']}", self.signs["L"]
        still = f"{show(L)} does not depend on {show('t')}"
        if self.c.has_forces:
            still += ", and no force does work"
        function = f"energy function {show(self.sign('function', L))}"
        if self.c.kinetic is not None:
            function += f", which is not {show(total)}"
        why = {
            "energy": f"energy: {still}",
            "energy function": f"{function}: {still}",
            "momentum": f"momentum of {names}: {names} is ignorable, it is not in "
            + show(L),
            "shifted momentum": f"momentum of {names} less a function whose rate is "
            + show(self.sign("slope", L, q)),
            "total momentum": f"total momentum: a shift of {names} does not change "
            + show(L),
            "angular momentum": f"angular momentum: a turn of {names} does not change "
            + show(L),
        }[item.kind]
        if item.definition:
            why += f"; the file calls it {self._plain(item.definition)}"
        left = total if item.kind == "energy" else self.sign(item.kind, q)
        self._rows([(left, item.value)])
        self._say(f"  {why}")

    # How it looks

    def _label(self, name: str) -> str:
        """Give the name of a constraint."""
        return name

    def _inline(self, formula: str) -> str:
        """Give a formula within a sentence."""
        return formula

    _plain = _label
    statements: Mapping[str, str] = UNICODE

    def _width(self, text: str) -> int:
        return _width(text)

    def _title(self, text: str) -> None:
        self.lines += ["", text, "-" * len(text)]

    def _say(self, text: str) -> None:
        self.lines += textwrap.wrap(text, WIDTH - 2, initial_indent="  ",
                                    subsequent_indent="  ")  # fmt: skip

    def _equals(self, left: str, right: Any, tail: str = "") -> None:
        """Write left = right, broken before a sign where it is too long."""
        head = f"  {left} = " if left else "  "
        self._broken_row(head, self.write.terms(right), tail)

    def _broken_row(
        self, head: str, terms: Sequence[tuple[str, str]], tail: str = ""
    ) -> None:
        write = self.write
        line = head
        for k, (sign, text) in enumerate(terms):
            first = write.negative if sign == "-" else ""
            part = (write.minus if sign == "-" else write.plus) if k else first
            if k and _width(line) + _width(part + text) > WIDTH:
                self.lines += _folded(line)
                line = " " * min(max(_width(head) - 2, 4), 24) + part + text
            else:
                line += part + text
        self.lines += _folded(line + tail)

    def _rows(self, rows: Sequence[Row]) -> None:
        for row in rows:
            self._equals(*row)

    def _where(self, rows: Sequence[Row]) -> None:
        for k, (name, *value) in enumerate(rows):
            self._equals(("where " if k == 0 else "      ") + name, *value)

    def _equations(self, lines: Sequence[tuple[Line, list[Row]]]) -> None:
        for line, terms in lines:
            self._title(f"Equation of {self.show(line.coordinate)}")
            width = max(_width(label) for label, *_ in terms)
            for label, *value in terms:
                self._equals(label + " " * (width - _width(label)), *value)
            self.lines.append("")
            self._equation(line.left, line.right)

    def _equation(self, left: Any, right: Any) -> None:
        terms = self.write.terms(left)
        tail = self.write(right)
        if sum(_width(text) + 3 for _, text in terms) + _width(tail) > WIDTH:
            self._broken_row("  ", terms)
            self._broken_row("      = ", self.write.terms(right))
        else:
            self._broken_row("  ", terms, f" = {tail}")

    def _square(self, letter: str, rows: Rows) -> None:
        widths = [max(map(_width, column)) for column in zip(*rows, strict=True)]
        for k, row in enumerate(rows):
            cells = "   ".join(
                e + " " * (w - _width(e)) for e, w in zip(row, widths, strict=True)
            )
            head = f"{letter} = " if k == 0 else " " * (len(letter) + 3)
            self.lines.append(f"  {head}[ {cells} ]")

    def _derivatives(self, k: Condition) -> list[str]:
        if k.moving:
            return ["rate" if k.kind == "one-sided" else "", "d/dt of it"]
        letter = "gap" if k.kind == "one-sided" else "g"
        return [letter, f"d{letter}/dt", self.signs["twice"]]

    def _given(self, given: Sequence[str]) -> None:
        for text in given:
            self._say(text)

    def _statement(self, about: str, text: str) -> None:
        self._say(f"{about}: {text}")


_SIGNS = {
    "minus": "−", "=": "=", "at least": "≥", "slope": "∂{}/∂{}",
    "rate": "d/dt ∂{}/∂{}", "twice": "d²/dt²", "matrix": "{}", "entry": "{}[{}, {}]",
    "F": "dissipation F", "G": "G", "Q": "Q_{}", "f": "f[{}]", "b": "b[{}]",
    "K": "K[{}, {}]", "Qc": "Qc_{}", "conserved": "Conserved",
    "matrix form": "Matrix form: M q̈ = f",
    "matrix form held": "Matrix form: M q̈ = f + Aᵀ λ,  A q̈ = b",
    "motion": "", "motion held": "", "symmetric": ", and M is symmetric",
    "principle": "q̈ makes G = (q̈ − a)ᵀ M (q̈ − a)/2 least; "
    "a = M⁻¹ f is the acceleration without constraints",
    "principle held": "q̈ makes G = (q̈ − a)ᵀ M (q̈ − a)/2 least, subject to A q̈ = b; "
    "a = M⁻¹ f is the acceleration without constraints",
    "gain": "Qc = K (A a − b), K = −Aᵀ (A M⁻¹ Aᵀ)⁻¹",
    "function": "Σ q̇ ∂{0}/∂q̇ − {0}", "energy function": "h", "momentum": "p_{}",
    "shifted momentum": "shifted momentum", "total momentum": "total momentum",
    "angular momentum": "angular momentum",
}  # fmt: skip


def as_text(content: Content, *, ascii_only: bool = False) -> str:
    """Give a derivation as plain text."""
    x = content.translation
    plain = x.own_names
    names: Any = ModelNames(plain) if ascii_only else UnicodeNames(plain)
    write = ModelPrinter(x, names) if ascii_only else TextPrinter(x, names)
    signs = in_ascii(_SIGNS) if ascii_only else dict(_SIGNS)
    shown = {names.show(Name(n)) for n in plain}
    # The letters of mechanics give way to the file's names.
    words = {"T": "kinetic", "V": "potential", "L": "lagrangian"}
    signs |= {k: word if k in shown else k for k, word in words.items()}
    model = content.translation.equations.model
    head = f"{model.name}: {model.description}" if model.description else model.name
    lines = textwrap.wrap(" ".join(head.split()), WIDTH)
    page = Outline(content, write, signs)
    page.statements = ASCII if ascii_only else UNICODE
    lines += page.document()
    for note in content.notes:
        lines += ["", *textwrap.wrap(f"Note: {note}.", WIDTH)]
    # Composed letters where there are any: ü, not u and two dots.
    return unicodedata.normalize("NFC", "\n".join(lines)) + "\n"


def _width(text: str) -> int:
    """Give how many columns a text takes; dots above take none."""
    return len(text) - sum(map(bool, map(unicodedata.combining, text)))


# Before a sign or a relation, else between factors.
_SIGN = re.compile(r"(?<=\S) (?=[-+−=≥≤<>] )")
_SPACE = re.compile(r"(?<=\S) (?=\S)")


def _folded(line: str) -> list[str]:
    """Break a line that is too long, within as few parentheses as can be."""
    lines: list[str] = []
    margin = len(line) - len(line.lstrip())
    start, indent = margin, margin
    while True:
        # What is looked at is no longer than a line with its combining marks.
        head = " " * indent + line[start : start + 4 * WIDTH]
        fits = _cut(head)
        at = _break(head, fits, margin) if fits < len(head) else 0
        if not at:
            return [*lines, " " * indent + line[start:]]
        lines.append(head[:at])
        margin = min(margin + 4, 28) if len(lines) == 1 else margin
        start, indent = start + at + 1 - indent, margin


def _break(line: str, fits: int, margin: int) -> int:
    """Give where a line is broken of which so much fits; 0 where it cannot be."""
    depth, depths = 0, []
    for c in line[: fits + 1]:
        depth += (c in "([") - (c in ")]")
        depths.append(depth)
    for least in (WIDTH // 2, margin + 8):
        for sign in (_SIGN, _SPACE):
            places = [m.start() for m in sign.finditer(line)]
            fit = [x for x in places if least <= x <= fits]
            if fit:
                return min(fit, key=lambda x: (depths[x], -x))
    return 0


def _cut(line: str) -> int:
    """Give how many characters of it fit; marks above letters take no column."""
    columns = 0
    for k, c in enumerate(line):
        columns += not unicodedata.combining(c)
        if columns > WIDTH:
            return k
    return len(line)
