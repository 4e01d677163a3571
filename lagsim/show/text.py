"""A derivation as plain text: Unicode with dots, or ASCII in the model language.

A LaTeX document (`latex`) has the outline defined here: the sections and their order.
"""

from __future__ import annotations

import itertools
import math
import re
import textwrap
import unicodedata
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import sympy as sp

from lagsim.show import (
    ASCII,
    UNICODE,
    always,
    conditions,
    in_ascii,
    on_velocities,
)
from lagsim.show.names import (
    LETTERS_OF_MEMBERS,
    ModelNames,
    PrintedName,
    UnicodeNames,
    indexed,
)
from lagsim.show.printers import ModelPrinter, TextPrinter
from lagsim.show.symbols import symbol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.show import Content
    from lagsim.show.printers import Printer

    # The left side, the expression that it equals, and the text after it.
    Row = tuple[str, Any] | tuple[str, Any, str]
    Rows = Sequence[Sequence[str]]  # the written entries of a matrix
    Part = dict[str, Any]  # a part of the document
    Named = tuple[PrintedName, tuple[Any, ...]]  # the parts of a row
    from collections.abc import Iterable, Sequence

    from lagsim.show.symbols import Translation


WIDTH = 100


def _width(text: str) -> int:
    """Return the number of columns of a text; combining marks have no width."""
    return len(text) - sum(map(bool, map(unicodedata.combining, text)))


class Outline:
    """The sections of a derivation, as plain text.

    Parameters
    ----------
    content
        The derivation.
    write
        Prints expressions.
    signs
        Notation of symbols and phrases by key: the letters `T V L F G h`, `minus`,
        templates with names `slope`, `rate`, `Q f b K Qc`, and sentences; some keys
        have a second form with the suffix ` held`, for models with constraints.
    """

    # Width of a line, and of the space between two entries of a matrix.
    room, between = WIDTH - 8, 3

    def __init__(
        self, content: Content, write: Printer, signs: Mapping[str, str]
    ) -> None:
        (self.x, self.c), self.names, self.signs = content, write.names, signs
        self.write = write
        self.is_long = "separated" in self.c
        self.families = Families(self.x, merged=self.is_long)
        self.coordinates = [self.show(q.name) for q in self.x.q]
        self.lines: list[str] = []

    def document(self) -> list[str]:
        """Write all sections of the derivation, and return their lines."""
        c = self.c
        rows = [*zip(c["constraints"], self.x.multipliers, strict=True)]
        self._energies()
        if self.is_long:
            self._in_words()
            self._at_times([row for row in rows if not always(row[0])])
        else:
            self._in_full()
            for k, multiplier in rows:
                self._constraint(k, multiplier)
        self._solution()
        if c["conserved"]:
            self._title(self.signs["conserved"])
        for item in c["conserved"]:
            self._conserved(item)
        if c["gauss"] is not None:
            self._gauss()
        return self.lines

    def sign(self, key: str, *names: str) -> str:
        """Return the notation `signs[key]`, with names inserted."""
        return self.signs[key].format(*names)

    def show(self, q: str, order: int = 0) -> str:
        """Return the typeset name of the coordinate q, or of a derivative of it."""
        return self.names.show(PrintedName(q, order))

    def _phrase(self, key: str) -> str:
        return self.signs[f"{key} held" if self.c["constraints"] else key]

    # Sections

    def _energies(self) -> None:
        c, signs, head = self.c, self.signs, self.signs["L"]
        self._title("Energies")
        rows: list[Row] = []
        if c["kinetic"] is not None and c["potential"] is not None:
            rows += [(signs["T"], c["kinetic"]), (signs["V"], c["potential"])]
            head = f"{head} = {signs['T']} {signs['minus']} {signs['V']}"
        if not (rows and self.is_long):
            rows.append((head, c["lagrangian"]))
        if c["dissipation"] is not None:
            rows.append((signs["F"], c["dissipation"]))
        self._rows([(label, self.families.sums(e)) for label, e, *_ in rows])
        kept = [(self.x.names[s], e) for s, e in self.x.definitions.items()]
        if words := self._of_families([x for x in kept if not x[0].order]):
            self._where(words)

    def _of_families(
        self, rows: Sequence[tuple[PrintedName, Any]], tail: str = ""
    ) -> list[Row]:
        """Return rows (label, expression, text after it), one for a whole family.

        rows : pairs of a name and its expression.
        tail : the text after each row.
        """
        return [
            (self.names.show(row.name), *row.parts, tail + self._tail(row))
            for row in self.families.rows((name, (e,)) for name, e in rows)
        ]

    def _range(self, row: FamilyRow) -> str:
        """Return the members in a row, such as `i = 2..7`; "" for a single row."""
        numbers = row.members
        if not numbers:
            return ""
        shown = ", ".join(map(str, numbers))
        if numbers[-1] - numbers[0] == len(numbers) - 1 > 1:
            shown = self.sign("range", str(numbers[0]), str(numbers[-1]))
        return f"{self.families.letter} = {shown}"

    def _tail(self, row: FamilyRow) -> str:
        """Return the members in a row as a text after its formula, or ""."""
        members = self._range(row)
        return self.sign("members", members) if members else ""

    def _named(self, row: FamilyRow) -> str:
        """Return the name of a row and its members, for use within a sentence."""
        shown, members = self.names.show(row.name), self._range(row)
        return self._inline(f"{shown}, {members}" if members else shown)

    def _in_full(self) -> None:
        """Write the equations term by term, and in matrices."""
        c = self.c
        if c["forces"] or c["dissipation"] is not None:
            self._forces()
        self._equations([(line, self._terms(line)) for line in c["equations"]])
        self._rates_and_events()
        self._matrix_form()

    def _in_words(self) -> None:
        """Write the equations in the definitions of the file, see `separation`."""
        c, x = self.c, self.x
        if c["forces"]:
            self._forces()
        kinds = {"momenta": "momentum", "forces": "force", "reactions": "reaction"}
        for key, kind in kinds.items():
            if rows := c["separated"][key].items():
                self._title(key.capitalize())
                pairs = ("w", kind), ("u", kind), ("v", kind), ("u", "force")
                letters = (self.names.show(PrintedName(u, 0, of)) for u, of in pairs)
                self._add_line(self.sign(key, *letters))
                named = [(x.names[symbol(name)], e) for name, e in rows]
                self._rows(self._of_families(named))
        if equalities := [k for k in c["constraints"] if always(k)]:
            self._title("Constraints")
            rows = [(PrintedName(k["name"]), k["function"]) for k in equalities]
            self._rows(self._of_families(rows, " = 0"))
        self._title("Equations of motion")
        lines = [
            (PrintedName(line["coordinate"]), (line["left"], line["right"]))
            for line in c["equations"]
        ]
        for row in self.families.rows(lines):
            self._add_line(f"for {self._named(row)}:")
            self._balance((row.parts[0], row.parts[1]))
        self._rates_and_events()

    def _rates_and_events(self) -> None:
        if states := self.c.get("states"):
            self._title("First-order states")
            self._rows([(self.show(s, 1), rate) for s, rate in states.items()])
        events = self.c.get("events", {})
        if events:
            self._title("Events")
        for name, event in events.items():
            at, every = event["at"], event["every"] or 0.0
            when = f"at {self._plain(at)}" if at else f"every {every:g}"
            once = "once, " * event["once"]
            self._add_line(f"{self._plain(name)} acts {once}{when}")
            self._rows([(self.show(mode), e) for mode, e in event["set"].items()])
            if given := event.get("impulse"):
                self._add_line("with the impulses, along each name")
                self._rows([(self.show(on), e) for on, e in given.items()])

    def _forces(self) -> None:
        self._title("Generalized forces by virtual work")
        given = [
            (PrintedName(force["on"]), (force["force"], force["direction"]))
            for force in self.c["forces"]
        ]
        for row in self.families.rows(given):
            force, direction = row.parts
            written = self._inline(self.write(force))
            self._add_line(f"force on {self._named(row)}: {written}")
            if not direction.is_Symbol:
                on = self.names.show(row.name)
                self._rows([(on, direction, self._tail(row))])
        if not self.is_long:
            values = [k["Q"] for k in self.c["equations"]]
            self._labelled("Q", self.coordinates, values)

    def _terms(self, line: Part) -> list[Row]:
        q, v = (self.show(line["coordinate"], k) for k in (0, 1))
        labels = {"Q": self.sign("Q", q)}
        for letter in "TVL":
            of = self.signs[letter]
            labels[f"d{letter}_dq"] = self.sign("slope", of, q)
            labels[f"ddt_d{letter}_dqdot"] = self.sign("rate", of, v)
        return [(labels[k], e) for k, e in line.items() if k in labels]

    def _matrix_form(self) -> None:
        c, names = self.c, self.coordinates
        self._title(self._phrase("matrix form"))
        self._add_line(self._phrase("motion"))
        self._matrix("M", c["M"], names, names)
        self._labelled("f", names, c["f"])
        if constraints := c["constraints"]:
            labels = [self._label(k["name"]) for k in constraints]
            self._matrix("A", [k["A"] for k in constraints], labels, names)
            self._labelled("b", labels, [k["b"] for k in constraints])

    def _labelled(
        self, key: str, names: Sequence[str], values: Sequence[Any] | None
    ) -> None:
        """Write the entries of a vector, one per line, each with a label.

        key : key of the label in `signs`.
        names : name inserted into each label.
        values : the entries, as expressions; None for a vector that is not written.
        """
        rows = zip(names, values or (), strict=False)
        self._rows([(self.sign(key, name), e) for name, e in rows])

    def _matrix(
        self,
        letter: str,
        rows: Sequence[Sequence[Any]],
        labels: Sequence[str],
        names: Sequence[str],
    ) -> None:
        """Write a matrix as a square if it fits, else one entry per line.

        letter : the letter of the matrix.
        rows : its entries.
        labels, names : names of rows and columns; one object if the matrix is
            symmetric.
        """
        written = [[self.write(e) for e in row] for row in rows]
        columns = zip(*written, strict=True)
        widths = [max(map(self.width, column)) for column in columns]
        if sum(widths) + self.between * len(widths) <= self.room:
            self._square(letter, written)
            return
        symmetric = labels is names
        self._rows([
            (self.sign("entry", letter, labels[i], names[j]), e)
            for i, row in enumerate(rows)
            for j, e in enumerate(row)
            if e != 0 and (j >= i or not symmetric)
        ])  # fmt: skip
        also = self.signs["symmetric"] * symmetric
        bold = self._inline(self.sign("matrix", letter))
        self._add_line(f"other entries of {bold} are zero{also}")

    def _solution(self) -> None:
        solved = self.c["accelerations"]
        if solved is None:
            return
        self._title("Accelerations")
        steps = solved["steps"]
        if self.is_long:  # the entries of M and f
            steps = self.c["definitions"] | steps
        shown = {s.name for s in self.x.definitions}
        rows = [(self.show(name), e) for name, e in steps.items() if name not in shown]
        second = (self.show(q.name, 2) for q in self.x.q)
        rows += zip(second, solved["q_ddot"], strict=True)
        multipliers = map(self.write, self.x.multipliers)
        self._rows([*rows, *zip(multipliers, solved["lambda"], strict=False)])

    def _gauss(self) -> None:
        principle, names = self.c["gauss"], self.coordinates
        self._title("Gauss's principle")
        self._add_line(self._phrase("principle"))
        free = [
            self.names.show(PrintedName(q.name, 0, "unconstrained")) for q in self.x.q
        ]
        rows = [(self.signs["G"], principle["G"])]
        self._rows([*rows, *zip(free, principle["a"] or (), strict=False)])
        equalities = [
            self._label(k["name"]) for k in self.c["constraints"] if always(k)
        ]
        if not self.c["constraints"]:
            return
        self._add_line(self.signs["gain"])
        rows = [
            (self.sign("K", q, label), e)
            for q, row in zip(names, principle["K"] or (), strict=False)
            for label, e in zip(equalities, row, strict=True)
        ]
        forces = zip(names, principle["Qc"] or (), strict=False)
        self._rows([*rows, *((self.sign("Qc", q), e) for q, e in forces)])

    def _at_times(self, entries: Sequence[tuple[Part, Any]]) -> None:
        """Write the constraints that hold at times; constraints of a family as one.

        entries : entries of the document with their multipliers.
        """
        groups: dict[Any, list[tuple[Part, Any]]] = {}
        for k, multiplier in entries:
            stated = {
                key: e for key, e in k.items() if isinstance(e, str | float | None)
            }
            stated |= {"name": "", "slips": len(k["slip"]), "pair": "pair" in k}
            groups.setdefault(tuple(stated.items()), []).append((k, multiplier))
        for group in groups.values():
            first, _ = group[0]
            keys = [key for key, e in first.items() if isinstance(e, sp.Basic)]
            keys = [key for key in keys if key not in ("b", "acceleration")]
            rows = [
                (PrintedName(k["name"]), (s, *(k[key] for key in keys), *k["slip"]))
                for k, s in group
            ]
            for row in self.families.rows(rows):
                multiplier, *values = row.parts
                k = first | dict(zip(keys, values, strict=False))
                k |= {"name": indexed(row.name.base), "slip": values[len(keys) :]}
                self._constraint(k, multiplier, self._range(row))

    def _constraint(self, k: Part, multiplier: Any, members: str = "") -> None:
        self._title(f"Constraint {k['name']} ({k['kind']})")
        if members:
            self._add_line(f"for {self._inline(members)}")
        relation = self.signs["at least" if k["kind"] == "one-sided" else "="]
        moving = on_velocities(k)
        values = [k["function"], *([] if moving else [k["rate"]])]
        values += [] if self.is_long else [k["acceleration"]]
        labels = self._derivatives(k)
        (gap, first), *rest = zip(labels, values, strict=False)
        self._rows([(gap, first, f" {relation} 0"), *rest])
        given = []
        for key in () if moving else ("restitution", "friction", "static_friction"):
            value = k[key]
            if value is not None:
                plain = isinstance(value, float)
                shown = f"{value:g}" if plain else self.write(value)
                given.append(f"{key.partition('_')[0]}: {self._inline(shown)}")
        if k["slip"] and not moving:
            slips = (self._inline(self.write(e)) for e in k["slip"])
            given.append(f"slip: {', '.join(slips)}")
        self._given(given)
        called = gap, gap if moving else labels[1]
        stated = conditions(k, self.write, multiplier, called, self.statements)
        for about, text in stated.items():
            self._statement(about, text)

    def _conserved(self, item: Part) -> None:
        show = self._inline
        names = ", ".join(show(self.show(q)) for q in item["of"])
        q = self.show(item["of"][0]) if item["of"] else ""
        total, L = f"{self.signs['T']} + {self.signs['V']}", self.signs["L"]
        still = f"{show(L)} does not depend on {show('t')}"
        if self.c["forces"] or self.c["dissipation"] is not None:
            still += ", and no force does work"
        function = f"energy function {show(self.sign('function', L))}"
        if self.c["kinetic"] is not None:
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
        }[item["kind"]]
        if item["definition"]:
            why += f"; the file calls it {self._plain(item['definition'])}"
        left = total if item["kind"] == "energy" else self.sign(item["kind"], q)
        self._rows([(left, self.families.sums(item["expression"]))])
        self._add_line(f"  {why}")

    # Layout

    def _label(self, name: str) -> str:
        """Return the typeset name of a constraint."""
        return name

    def _inline(self, formula: str) -> str:
        """Return a formula for use within a sentence."""
        return formula

    _plain = _label
    statements: Mapping[str, str] = UNICODE
    width = staticmethod(_width)

    def _title(self, text: str) -> None:
        self.lines += ["", text, "-" * len(text)]

    def _add_line(self, text: str) -> None:
        self.lines += textwrap.wrap(text, WIDTH - 2, initial_indent="  ",
                                    subsequent_indent="  ")  # fmt: skip

    def _equals(self, left: str, right: Any, tail: str = "") -> None:
        """Write left = right, broken before a sign where it is too long.

        left : a text.
        right : an expression.
        tail : the text after the formula.
        """
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

    def _equations(self, lines: Sequence[tuple[Part, list[Row]]]) -> None:
        for line, terms in lines:
            self._title(f"Equation of {self.show(line['coordinate'])}")
            width = max(_width(label) for label, *_ in terms)
            for label, *value in terms:
                self._equals(label + " " * (width - _width(label)), *value)
            self.lines.append("")
            self._balance((line["left"], line["right"]))

    def _balance(self, *equations: tuple[Any, Any]) -> None:
        for left, right in equations:
            terms, tail = self.write.terms(left), self.write(right)
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

    def _derivatives(self, k: Part) -> list[str]:
        """Return labels of a constraint: of its function, its rate, its second rate.

        k : the entry of the constraint in the document.
        """
        one_sided = k["kind"] == "one-sided"
        if on_velocities(k):
            return ["rate" if one_sided else "", "d/dt of it"]
        letter = "gap" if one_sided else "g"
        return [letter, f"d{letter}/dt", self.signs["twice"]]

    def _given(self, given: Sequence[str]) -> None:
        for text in given:
            self._add_line(text)

    def _statement(self, about: str, text: str) -> None:
        self._add_line(f"{about}: {text}")


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
    "angular momentum": "angular momentum", "range": "{}..{}", "members": ", {}",
    "momenta": "{0} = ∂L/∂w + Σ {2} ∂v/∂w, over all v that are written with w",
    "forces": "{0}, the force along w",
    "reactions": "{1} = d/dt ∂L/∂u' − ∂L/∂u − {3} + Σ {2} ∂v/∂u, over all v that are "
    "written with u: the force that holds u to its definition",
}  # fmt: skip


def as_text(content: Content, *, ascii_only: bool = False) -> str:
    """Return a derivation as plain text."""
    x = content.translation
    model, notes = x.equations.model, content.document["notes"]
    plain = x.own_names
    names: Any = ModelNames(plain) if ascii_only else UnicodeNames(plain)
    write = ModelPrinter(x, names) if ascii_only else TextPrinter(x, names)
    signs = in_ascii(_SIGNS) if ascii_only else dict(_SIGNS)
    shown = {names.show(PrintedName(n)) for n in plain}
    # Letters of mechanics that are names in the file are replaced by words.
    words = {"T": "kinetic", "V": "potential", "L": "lagrangian"}
    signs |= {k: word if k in shown else k for k, word in words.items()}
    head = f"{model.name}: {model.description}" if model.description else model.name
    lines = textwrap.wrap(" ".join(head.split()), WIDTH)
    page = Outline(content, write, signs)
    page.statements = ASCII if ascii_only else UNICODE
    lines += page.document()
    for note in notes:
        lines += ["", *textwrap.wrap(f"Note: {note}.", WIDTH)]
    # Composed letters where there are any: ü, not u and two dots.
    return unicodedata.normalize("NFC", "\n".join(lines)) + "\n"


# Break before a sign or a relation, otherwise between factors.
_SIGN = re.compile(r"(?<=\S) (?=[-+−=≥≤<>] )")
_SPACE = re.compile(r"(?<=\S) (?=\S)")


def _folded(line: str) -> list[str]:
    """Return a long line as several, broken within as few parentheses as possible."""
    lines: list[str] = []
    margin = len(line) - len(line.lstrip())
    start, indent = margin, margin
    while True:
        # The examined text is no longer than a line with its combining marks.
        head = " " * indent + line[start : start + 4 * WIDTH]
        fits = _cut(head)
        at = _break(head, fits, margin) if fits < len(head) else 0
        if not at:
            return [*lines, " " * indent + line[start:]]
        lines.append(head[:at])
        margin = min(margin + 4, 28) if len(lines) == 1 else margin
        start, indent = start + at + 1 - indent, margin


def _break(line: str, fits: int, margin: int) -> int:
    """Return the index at which to break a line; 0 if there is none.

    fits : the largest index.
    margin : number of spaces at the beginning of lines.
    """
    nested = ((c in "([") - (c in ")]") for c in line[: fits + 1])
    depths = list(itertools.accumulate(nested))
    for least in (WIDTH // 2, margin + 8):
        for sign in (_SIGN, _SPACE):
            places = [m.start() for m in sign.finditer(line)]
            fit = [x for x in places if least <= x <= fits]
            if fit:
                return min(fit, key=lambda x: (depths[x], -x))
    return 0


def _cut(line: str) -> int:
    """Return the number of characters of a line that fit into WIDTH columns."""
    columns = itertools.accumulate(not unicodedata.combining(c) for c in line)
    return sum(taken <= WIDTH for taken in columns)


# --- Families in formulas: terms of members in a common notation
#
# The rows `x.2 = x.1 + l*sin(q.2)` to `x.9 = x.8 + l*sin(q.9)` are written as one row,
# and so are the terms of a sum: formulas whose names differ only in the number of the
# member, counted from the row's own number, are equal with a letter in its place.

# The number of a member is the first in its name: `tip.3.x`, or `x3`.
_NUMBER = re.compile(r"(\.|(?<=[^\W\d]))([0-9]+)(?=\.|\Z)")
# Largest number of names or terms that differ in a number and yet are no family.
FEW = 2
# Expressions are compared in expanded form if this has no more terms than so many.
MOST_TERMS = 1_000


class FamilyRow(NamedTuple):
    """Row of one formula for several members of a family, or a single row.

    Attributes
    ----------
    name : PrintedName
    parts : tuple
        The expressions; name and expressions contain the index letter in place of the
        numbers of members.
    members : tuple of int
        The numbers of the members, increasing; () for a single row.
    """

    name: PrintedName
    parts: tuple[Any, ...]
    members: tuple[int, ...]


class Families:
    """Merges rows, and terms of sums, that differ only in the number of a member.

    Parameters
    ----------
    x
        The symbols of a model; symbols with an index letter are added to it.
    merged
        Whether families are merged; else each row and each term is separate.

    Attributes
    ----------
    letter, other : str
        Index letters: in rows, and in sums.
    """

    def __init__(self, x: Translation, *, merged: bool = True) -> None:
        self.x, self.merged = x, merged
        free = [c for c in LETTERS_OF_MEMBERS if c not in x.own_names]
        self.letter, self.other = (*free, *LETTERS_OF_MEMBERS)[:2]
        bases = {name.base for name in x.names.values()}
        self._stems = Counter(_NUMBER.sub("", base, count=1) for base in bases)

    def member_of(self, name: PrintedName) -> int | None:
        """Return the number of the member that a name denotes, or None."""
        found = _NUMBER.search(name.base)
        if found is None or not self.merged:
            return None
        count = self._stems[_NUMBER.sub("", name.base, count=1)]
        return int(found[2]) if found[1] or count > FEW else None

    def rows(
        self, rows: Iterable[tuple[PrintedName, Sequence[Any]]]
    ) -> list[FamilyRow]:
        """Return rows; rows of a family are merged at the place of its first member.

        rows : pairs of a name and its expressions.
        """
        found: dict[Any, list[tuple[int, Named, Named]]] = {}
        for place, (name, parts) in enumerate(rows):
            k = self.member_of(name)
            own = common = name, tuple(parts)
            key: Any = place
            if k is not None and not self._taken(parts):
                counted = (self._counted(e, k, self.letter) for e in parts)
                common = self._name(name, k, self.letter), tuple(counted)
                # Signs of sums within depend on the order of the names.
                whole = (
                    e if _terms(e) > MOST_TERMS else sp.expand(e) for e in common[1]
                )
                key = common[0], tuple(whole)
            found.setdefault(key, []).append((k or 0, own, common))
        result = []
        for members in found.values():
            _, own, common = members[0]
            numbers = tuple(sorted(k for k, *_ in members))
            name, alike = common if len(members) > 1 else own
            numbers = numbers if len(members) > 1 else ()
            result.append(FamilyRow(name, tuple(map(self.sums, alike)), numbers))
        return result

    def _taken(self, parts: Sequence[Any]) -> bool:
        """Whether the letter of rows is an index of a sum in some expressions."""
        i = symbol(self.letter)
        return any(i in x.variables for e in parts for x in e.atoms(sp.Sum))

    def _name(self, name: PrintedName, k: int, letter: str) -> PrintedName:
        """Return the name of a member with its number relative to k, with a letter.

        An example is `x.i+1` for `x.3` with k = 2.

        letter : the letter of the index, which denotes k.
        """

        def counted(number: re.Match[str]) -> str:
            off = int(number[2]) - k
            return f".{letter}{off:+d}" if off else f".{letter}"

        return replace(name, base=_NUMBER.sub(counted, name.base, count=1))

    def _counted(self, e: Any, k: int, letter: str) -> Any:
        """Return an expression whose members have numbers relative to k, with a letter.

        It is equal for all members of a family whose rows differ in the number only.

        letter : the letter of the index, which denotes k.
        """
        x, new = self.x, {}
        for s in e.free_symbols:
            name = x.names[s]
            if self.member_of(name) is not None:
                name = self._name(name, k, letter)
                parts = (name.kind, name.base, "'" * name.order)
                new[s] = x.add(symbol(" ".join(parts)), name, x.rank[s])
        for total in e.atoms(sp.Sum):
            new |= self._relative_ends(total, k, letter)
        return e.xreplace(new)

    def _relative_ends(self, total: Any, k: int, letter: str) -> dict[Any, Any]:
        """Return the limits of a sum that end before k, or begin after k, by a letter.

        The result maps limits to such with the letter of the index, which denotes k.
        """
        found = {}
        for limit in total.limits:
            index, first, last = limit
            i = symbol(letter)
            ends = i + 1 if first == k + 1 else first, i - 1 if last == k - 1 else last
            if ends != (first, last):
                self.x.add(i, PrintedName(letter), (1, -1))
                found[limit] = sp.Tuple(index, *ends)
        return found

    def sums(self, e: Any) -> Any:
        """Return an expression with the terms of a family as a sum over its members."""
        if e.is_Atom or not self.merged or isinstance(e, sp.Sum):
            return e
        args = tuple(map(self.sums, e.args))
        if not e.is_Add:
            return e if args == e.args else e.func(*args)
        terms: dict[Any, dict[int, Any]] = {}
        for term in args:
            numbers = (self.member_of(self.x.names[s]) for s in term.free_symbols)
            k = min((x for x in numbers if x is not None), default=None)
            key = term if k is None else self._counted(term, k, self.other)
            terms.setdefault(key, {})[k or 0] = term
        sums: dict[tuple[int, int], list[Any]] = {}
        alone: list[Any] = []
        for key, members in terms.items():
            first, last = min(members), max(members)
            if len(members) > FEW and last - first + 1 == len(members):
                sums.setdefault((first, last), []).append(key)
            else:
                alone += members.values()
        j = symbol(self.other)
        made = (sp.Sum(sp.Add(*of), (j, *ends)) for ends, of in sums.items())
        return sp.Add(*alone, *made)


def _terms(e: Any) -> int:
    """Return the number of terms of an expression if it were multiplied out.

    The count ends at MOST_TERMS + 1.
    """
    below = [_terms(a) for a in e.args]
    if e.is_Add:
        count = sum(below)
    elif e.is_Mul:
        count = math.prod(below)
    else:
        powers = e.is_Pow and e.exp.is_Integer and below[0] > 1
        times = min(abs(int(e.exp)), MOST_TERMS) if powers else 1
        count = max(below, default=1) ** times
    return int(min(count, MOST_TERMS + 1))
