"""A derivation as plain text: Unicode with dots, or ASCII in the model language."""

from __future__ import annotations

import re
import textwrap
import unicodedata
from typing import TYPE_CHECKING, Any

from lagsim.derivation.conditions import ASCII, UNICODE, conditions
from lagsim.derivation.names import ModelNames, Name, UnicodeNames
from lagsim.derivation.outline import DIGITS, Outline
from lagsim.derivation.styles import UnicodeStyle
from lagsim.derivation.writer import Style

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.derivation.content import Condition, Conserved, Content, Force, Line
    from lagsim.derivation.outline import Entry, Row, Rows

WIDTH = 100
_SIGNS = {
    "minus": "−", "d": "∂", "slope": "∂{}/∂{}", "rate": "d/dt ∂{}/∂{}",
    "sum": "Σ q̇", "q_dot": "q̇", "twice": "d²/dt²",
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
}  # fmt: skip
_ASCII = {
    "−": "-", "∂": "d", "Σ": "sum", "q̇": "q'", "q̈": "q''", "⁻¹": "^-1", "ᵀ": "^T",
    "²": "^2", "λ": "lambda",
}  # fmt: skip


def as_text(content: Content, *, ascii_only: bool = False) -> str:
    """Give a derivation as plain text."""
    plain = content.translation.own_names
    names: Any = ModelNames(plain) if ascii_only else UnicodeNames(plain)
    style = Style(names, DIGITS) if ascii_only else UnicodeStyle(names, DIGITS)
    signs = dict(_SIGNS)
    for sign, letters in _ASCII.items() if ascii_only else ():
        signs = {k: text.replace(sign, letters) for k, text in signs.items()}
    shown = {names.show(Name(n)) for n in plain}
    # The letters of mechanics give way to the file's names.
    words = {"T": "kinetic", "V": "potential", "L": "lagrangian"}
    signs |= {k: word if k in shown else k for k, word in words.items()}
    model = content.translation.equations.model
    head = f"{model.name}: {model.description}" if model.description else model.name
    lines = textwrap.wrap(" ".join(head.split()), WIDTH)
    lines += _Text(content, style, signs).told()
    for note in content.notes:
        lines += ["", *textwrap.wrap(f"Note: {note}.", WIDTH)]
    # What cannot be told apart from composed letters is one: ü, not u and two dots.
    return unicodedata.normalize("NFC", "\n".join(lines)) + "\n"


def _width(text: str) -> int:
    """Give how many columns a text takes; dots above take none."""
    return sum(not unicodedata.combining(c) for c in text)


# Before a sign or a relation, else between factors.
_SIGN = re.compile(r"(?<=\S) (?=[-+−=≥≤<>] )")
_SPACE = re.compile(r"(?<=\S) (?=\S)")


def _folded(line: str) -> list[str]:
    """Break a line that is too long, within as few parentheses as can be."""
    lines = []
    margin = len(line) - len(line.lstrip())
    while _width(line) > WIDTH:
        at = _break(line, margin)
        if not at:
            break
        lines.append(line[:at])
        margin = min(margin + 4, 28) if len(lines) == 1 else margin
        line = " " * margin + line[at + 1 :]
    return [*lines, line]


def _break(line: str, margin: int) -> int:
    """Give where a line is broken; 0 where it cannot be."""
    depth, depths = 0, []
    for c in line:
        depth += (c in "([") - (c in ")]")
        depths.append(depth)
    for least in (WIDTH // 2, margin + 8):
        for sign in (_SIGN, _SPACE):
            places = [m.start() for m in sign.finditer(line)]
            fit = [x for x in places if x >= least and _width(line[:x]) <= WIDTH]
            if fit:
                return min(fit, key=lambda x: (depths[x], -x))
    return 0


def _called(k: Condition) -> tuple[str, str]:
    return ("rate", "rate") if k.moving else ("gap", "dgap/dt")


class _Text(Outline):
    room, between = WIDTH - 8, 3

    def _width(self, text: str) -> int:
        return _width(text)

    def _title(self, text: str) -> None:
        self.lines += ["", text, "-" * len(text)]

    def _say(self, text: str) -> None:
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
                self.lines += _folded(line)
                line = " " * min(max(_width(head) - 2, 4), 24) + part + text
            else:
                line += part + text
        self.lines += _folded(line + tail)

    def _rows(self, rows: Sequence[Row]) -> None:
        for left, right in rows:
            self.equals(left, right)

    def _where(self, rows: Sequence[Row]) -> None:
        for k, (name, value) in enumerate(rows):
            self.equals(("where " if k == 0 else "      ") + name, value)

    # Sections

    def _force(self, force: Force) -> None:
        on = self.show(force.on)
        self._say(f"force on {on}: {self.write(force.force)}")
        if not force.direction.is_Symbol:
            self.equals(f"  {on}", force.direction)

    def _equations(self, lines: Sequence[tuple[Line, list[Row]]]) -> None:
        for line, terms in lines:
            self._title(f"Equation of {self.show(line.coordinate)}")
            width = max(_width(label) for label, _ in terms)
            for label, value in terms:
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

    def _square(self, letter: str, rows: Rows) -> None:
        widths = [max(map(_width, column)) for column in zip(*rows, strict=True)]
        for k, row in enumerate(rows):
            cells = "   ".join(
                e + " " * (w - _width(e)) for e, w in zip(row, widths, strict=True)
            )
            head = f"{letter} = " if k == 0 else " " * (len(letter) + 3)
            self.lines.append(f"  {head}[ {cells} ]")

    def _entries(self, letter: str, rows: Sequence[Entry], also: str) -> None:
        for row, column, e in rows:
            self._say(f"{letter}[{row}, {column}] = {e}")
        self._say(f"other entries of {letter} are zero{also}")

    def _constraint(self, k: Condition) -> None:
        if k.kind == "nonholonomic":
            self._equation(k.function, 0 * k.b)
        else:
            letter, sign = "g", "="
            if k.kind == "one-sided":
                letter, sign = _called(k)[0], self.write.style.comparisons[">="]
            self.equals(letter, k.function, f" {sign} 0")
            if not k.moving:
                self.equals(f"d{letter}/dt", k.rate)
        self.equals("d/dt of it" if k.moving else self.signs["twice"], k.acceleration)

    def _law(self, k: Condition, multiplier: Any) -> None:
        for word in () if k.moving else ("restitution", "friction", "static", "slip"):
            value = k.law.get(word, ())
            parts = value if isinstance(value, tuple) else (value,)
            text = ", ".join(
                f"{p:g}" if isinstance(p, float) else self.write(p) for p in parts
            )
            if text:
                self._say(f"{word}: {text}")
        signs = ASCII if self.signs["minus"] == "-" else UNICODE
        told = conditions(k, self.write, multiplier, _called(k), signs)
        for about, text in told.items():
            self._say(f"{about}: {text}")

    def _conserved(self, item: Conserved) -> None:
        left, why = self._named(item)
        if item.definition:
            why += f"; the file calls it {item.definition}"
        self.equals(left, item.value)
        self._say(f"  {why}")

    def _named(self, item: Conserved) -> tuple[str, str]:
        s = self.signs
        names = ", ".join(self.show(q) for q in item.of)
        T, V, L, d, q_dot = (s[k] for k in ("T", "V", "L", "d", "q_dot"))
        function = f"{s['sum']} {d}{L}/{d}{q_dot} {s['minus']} {L}"
        other = f", which is not {T} + {V}" if self.c.kinetic is not None else ""
        still = f"{L} does not depend on t"
        if self.c.has_forces:
            still += ", and no force does work"
        rate = self.sign("slope", L, names)
        return {
            "energy": (f"{T} + {V}", f"energy: {still}"),
            "energy function": ("h", f"energy function {function}{other}: {still}"),
            "momentum": (
                f"p_{names}",
                f"momentum of {names}: {names} is ignorable, it is not in {L}",
            ),
            "shifted momentum": (
                item.kind,
                f"momentum of {names} less a function whose rate is {rate}",
            ),
            "total momentum": (item.kind, f"a shift of {names} does not change {L}"),
            "angular momentum": (item.kind, f"a turn of {names} does not change {L}"),
        }[item.kind]
