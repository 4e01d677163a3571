"""A derivation as plain text: Unicode with dots, or ASCII in the model language."""

from __future__ import annotations

import textwrap
import unicodedata
from typing import TYPE_CHECKING, Any

from lagsim.derivation.names import ModelNames, Name, UnicodeNames
from lagsim.derivation.styles import UnicodeStyle
from lagsim.derivation.writer import Style, Writer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.derivation.content import Condition, Conserved, Content, Line

WIDTH = 100
DIGITS = 6


def as_text(content: Content, *, ascii_only: bool = False) -> str:
    """Give a derivation as plain text."""
    return _Text(content, ascii_only=ascii_only).whole()


class _Words:
    """Signs that Unicode has and ASCII has not."""

    def __init__(self, *, ascii_only: bool) -> None:
        self.minus, self.partial, self.sum = "−", "∂", "Σ"
        self.transposed, self.inverse, self.multiplier = "ᵀ", "⁻¹", "λ"
        self.q_dot, self.a = "q̇", "q̈"
        if ascii_only:
            self.minus, self.partial, self.sum = "-", "d", "sum"
            self.transposed, self.inverse, self.multiplier = "^T", "^-1", "lambda"
            self.q_dot, self.a = "q'", "q''"


class _Text:
    def __init__(self, content: Content, *, ascii_only: bool) -> None:
        x = content.translation
        self.c, self.ascii_only = content, ascii_only
        self.words = _Words(ascii_only=ascii_only)
        plain = x.own_names
        names: Any = ModelNames(plain) if ascii_only else UnicodeNames(plain)
        style = Style(names, DIGITS) if ascii_only else UnicodeStyle(names, DIGITS)
        self.write = Writer(style, x.names, x.rank, decimals=x.substitute)
        self.names = names
        shown = {names.show(Name(n)) for n in plain}
        # The letters of mechanics give way to the file's names.
        self.T = "kinetic" if "T" in shown else "T"
        self.V = "potential" if "V" in shown else "V"
        self.L = "lagrangian" if "L" in shown else "L"
        self.lines: list[str] = []

    def whole(self) -> str:
        model = self.c.translation.equations.model
        head = f"{model.name}: {model.description}" if model.description else model.name
        self.lines += [*textwrap.wrap(" ".join(head.split()), WIDTH)]
        self._energies()
        self._forces()
        for line in self.c.lines:
            self._coordinate(line)
        self._matrix_form()
        for condition in self.c.constraints:
            self._constraint(condition)
        self._solution()
        self._conserved()
        self._gauss()
        for note in self.c.notes:
            self.lines += ["", *textwrap.wrap(f"Note: {note}.", WIDTH)]
        # What cannot be told apart from composed letters is one: ü, not u and two dots.
        return unicodedata.normalize("NFC", "\n".join(self.lines)) + "\n"

    # Pieces

    def title(self, text: str) -> None:
        self.lines += ["", text, "-" * len(text)]

    def say(self, text: str) -> None:
        self.lines += textwrap.wrap(text, WIDTH - 2, initial_indent="  ",
                                    subsequent_indent="  ")  # fmt: skip

    def equals(self, left: str, right: Any, tail: str = "") -> None:
        """Write left = right, broken before a sign where it is too long."""
        self.broken(f"  {left} = ", self.write.terms(right), tail)

    def broken(
        self, head: str, terms: Sequence[tuple[str, str]], tail: str = ""
    ) -> None:
        style = self.write.style
        line = head
        for k, (sign, text) in enumerate(terms):
            first = style.negative if sign == "-" else ""
            part = (style.minus if sign == "-" else style.plus) if k else first
            if k and _width(line) + _width(part + text) > WIDTH:
                self.lines.append(line)
                line = " " * min(max(_width(head) - 2, 4), 24) + part + text
            else:
                line += part + text
        self.lines.append(line + tail)

    def shown(self, q: str, order: int = 0) -> str:
        return str(self.names.show(Name(q, order)))

    def slope(self, of: str, by: str) -> str:
        d = self.words.partial
        return f"{d}{of}/{d}{by}"

    # Sections

    def _energies(self) -> None:
        c = self.c
        self.title("Energies")
        if c.kinetic is not None:
            self.equals(self.T, c.kinetic)
        if c.potential is not None:
            self.equals(self.V, c.potential)
        between = f" {self.words.minus} "
        head = self.L if c.potential is None else (
            f"{self.L} = {self.T}{between}{self.V}"
        )  # fmt: skip
        self.equals(head, c.lagrangian)
        if c.dissipation is not None:
            self.equals("dissipation F", c.dissipation)
        kept = c.translation.kept
        for k, definition in enumerate(kept):
            name = self.write(definition.symbol)
            self.equals(("where " if k == 0 else "      ") + name, definition.value)

    def _forces(self) -> None:
        c = self.c
        if not c.has_forces:
            return
        self.title("Generalized forces by virtual work")
        for force in c.forces:
            on = self.shown(force.on)
            self.say(f"force on {on}: {self.write(force.force)}")
            if not force.direction.is_Symbol:
                self.equals(f"  {on}", force.direction)
        for line in c.lines:
            self.equals(f"Q_{self.shown(line.coordinate)}", line.terms["Q"])

    def _coordinate(self, line: Line) -> None:
        q, v = (self.shown(line.coordinate, k) for k in (0, 1))
        self.title(f"Equation of {q}")
        labels = {
            "ddt_dT_dqdot": f"d/dt {self.slope(self.T, v)}",
            "dT_dq": self.slope(self.T, q),
            "ddt_dV_dqdot": f"d/dt {self.slope(self.V, v)}",
            "dV_dq": self.slope(self.V, q),
            "ddt_dL_dqdot": f"d/dt {self.slope(self.L, v)}",
            "dL_dq": self.slope(self.L, q),
            "Q": f"Q_{q}",
        }
        width = max(_width(labels[k]) for k in line.terms)
        for key, value in line.terms.items():
            label = labels[key]
            self.equals(label + " " * (width - _width(label)), value)
        self.lines.append("")
        self._equation(line.left, line.right)

    def _equation(self, left: Any, right: Any) -> None:
        terms = self.write.terms(left)
        tail = self.write(right)
        if sum(_width(text) + 3 for _, text in terms) + _width(tail) > WIDTH:
            self.broken("  ", terms)
            self.broken("      = ", self.write.terms(right))
        else:
            self.broken("  ", terms, f" = {tail}")

    def _matrix_form(self) -> None:
        c, words = self.c, self.words
        held = f" + A{words.transposed} {words.multiplier}" if c.constraints else ""
        also = f",  A {words.a} = b" if c.constraints else ""
        self.title(f"Matrix form: M {words.a} = f{held}{also}")
        names = [self.shown(line.coordinate) for line in c.lines]
        rows = [[self.write(e) for e in row] for row in c.M]
        self._matrix("M", rows, names, names, symmetric=True)
        for name, e in zip(names, c.f, strict=True):
            self.equals(f"f[{name}]", e)
        if c.constraints:
            rows = [[self.write(e) for e in k.A] for k in c.constraints]
            labels = [k.name for k in c.constraints]
            self._matrix("A", rows, labels, names)
            for k in c.constraints:
                self.equals(f"b[{k.name}]", k.b)

    def _matrix(
        self,
        letter: str,
        rows: list[list[str]],
        labels: Sequence[str],
        names: Sequence[str],
        *,
        symmetric: bool = False,
    ) -> None:
        """Write a matrix as a square where it fits, else entry by entry."""
        widths = [max(map(_width, column)) for column in zip(*rows, strict=True)]
        if sum(widths) + 3 * len(widths) + 8 <= WIDTH:
            for k, row in enumerate(rows):
                cells = "   ".join(
                    e + " " * (w - _width(e)) for e, w in zip(row, widths, strict=True)
                )
                head = f"{letter} = " if k == 0 else " " * (len(letter) + 3)
                self.lines.append(f"  {head}[ {cells} ]")
            return
        for i, row in enumerate(rows):
            for j, e in enumerate(row):
                if e != "0" and (j >= i or not symmetric):
                    self.say(f"{letter}[{labels[i]}, {names[j]}] = {e}")
        also = ", and M is symmetric" if symmetric else ""
        self.say(f"other entries of {letter} are zero{also}")

    def _constraint(self, k: Condition) -> None:
        self.title(f"Constraint {k.name} ({k.kind})")
        if k.kind == "nonholonomic":
            self._equation(k.function, 0 * k.b)
        else:
            letter, sign = "g", "="
            if k.kind == "one-sided":
                letter, sign = "gap", self.write.style.comparisons[">="]
            self.equals(letter, k.function, f" {sign} 0")
            self.equals(f"d{letter}/dt", k.rate)
        once = "d/dt of it" if k.kind == "nonholonomic" else "d^2/dt^2"
        once = once if self.ascii_only else once.replace("^2", "²")
        self.equals(once, k.acceleration)
        for word, value in k.law.items():
            parts = value if isinstance(value, tuple) else (value,)
            text = ", ".join(
                f"{p:g}" if isinstance(p, float) else self.write(p) for p in parts
            )
            self.say(f"{word}: {text}")

    def _solution(self) -> None:
        solved = self.c.solution
        if solved is None:
            return
        self.title("Accelerations")
        for symbol, value in solved.steps:
            self.equals(self.write(symbol), value)
        for line, e in zip(self.c.lines, solved.accelerations, strict=True):
            self.equals(self.shown(line.coordinate, 2), e)
        x = self.c.translation
        for s, e in zip(x.multipliers, solved.multipliers, strict=False):
            self.equals(self.write(s), e)

    def _conserved(self) -> None:
        if not self.c.conserved:
            return
        self.title("Conserved")
        for item in self.c.conserved:
            self.equals(self._named(item), item.value)
            self.say(f"  {self._why(item)}")

    def _named(self, item: Conserved) -> str:
        if item.kind == "energy":
            return f"{self.T} + {self.V}"
        if item.kind == "energy function":
            return "h"
        if item.kind == "momentum":
            return f"p_{self.shown(item.of[0])}"
        return item.kind

    def _why(self, item: Conserved) -> str:
        names = ", ".join(self.shown(q) for q in item.of)
        d, q_dot = self.words.partial, self.words.q_dot
        function = f"{self.words.sum} {q_dot} {d}{self.L}/{d}{q_dot}"
        other = (
            f", which is not {self.T} + {self.V}" if self.c.kinetic is not None else ""
        )
        still = f"{self.L} does not depend on t"
        if self.c.has_forces:
            still += ", and no force does work"
        why = {
            "energy": f"energy: {still}",
            "energy function": (
                f"energy function {function} {self.words.minus} {self.L}{other}: "
                f"{still}"
            ),
            "momentum": f"momentum of {names}: {names} is ignorable, it is not in "
            f"{self.L}",
            "shifted momentum": f"momentum of {names} less a function whose rate is "
            f"{self.slope(self.L, names)}",
            "total momentum": f"a shift of {names} does not change {self.L}",
            "angular momentum": f"a turn of {names} does not change {self.L}",
        }[item.kind]
        return why + (
            f"; the file calls it {item.definition}" if item.definition else ""
        )

    def _gauss(self) -> None:
        principle, words = self.c.gauss, self.words
        if principle is None:
            return
        self.title("Gauss's principle")
        apart = f"({words.a} {words.minus} a)"
        held = f", subject to A {words.a} = b" if self.c.constraints else ""
        self.say(
            f"{words.a} makes G = {apart}{words.transposed} M {apart}/2 least{held}; "
            f"a = M{words.inverse} f is the acceleration without constraints"
        )
        self.equals("G", principle.G)
        x = self.c.translation
        for q, a in zip(x.q, principle.a or (), strict=False):
            self.equals(self.names.show(Name(q.name, 0, "unconstrained")), a)
        if self.c.constraints:
            self.say(
                f"Qc = K (A a {words.minus} b), K = {words.minus}A{words.transposed} "
                f"(A M{words.inverse} A{words.transposed}){words.inverse}"
            )
        names = [self.shown(q.name) for q in x.q]
        labels = [k.name for k in self.c.constraints if k.kind != "one-sided"]
        for name, row in zip(names, principle.K or (), strict=False):
            for label, e in zip(labels, row, strict=True):
                self.equals(f"K[{name}, {label}]", e)
        for name, e in zip(names, principle.Qc or (), strict=False):
            self.equals(f"Qc_{name}", e)


def _width(text: str) -> int:
    """Give how many columns a text takes; dots above take none."""
    return sum(not unicodedata.combining(c) for c in text)
