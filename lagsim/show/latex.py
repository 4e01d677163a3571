"""A derivation as a LaTeX document, or as Markdown with formulas for notebooks.

The document compiles as it is, and its blocks go into a paper.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from lagsim.show.content import LATEX, conditions
from lagsim.show.names import LatexNames, Name, plain_latex, upright_latex
from lagsim.show.printers import FormulaPrinter
from lagsim.show.text import Outline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.show.content import Condition, Conserved, Content, Force, Line
    from lagsim.show.text import Entry, Row, Rows

    Typeset = tuple[str, list[tuple[str, str]]]  # a row, its terms with their signs


# A line of display mathematics, in letters as they come out.
LONGEST_LINE = 75
_PREAMBLE = r"""\documentclass{article}
\usepackage[T1]{fontenc}
\usepackage{textcomp}
\usepackage{amsmath}
\usepackage[margin=2.5cm]{geometry}
\allowdisplaybreaks
\setcounter{MaxMatrixCols}{30}
\begin{document}
"""
_APART = r"(\ddot{\mathbf{q}} - \mathbf{a})"
_LEAST = (
    rf"accelerations make $LETTER = \frac{{1}}{{2}} {_APART}^{{\mathsf{{T}}}} "
    rf"\mathbf{{M}} {_APART}$ least, with $\mathbf{{M}} \mathbf{{a}} = \mathbf{{f}}$."
)
_SIGNS = {
    "minus": "-",
    "slope": r"\frac{{\partial {}}}{{\partial {}}}",
    "rate": r"\frac{{d}}{{dt}} \frac{{\partial {}}}{{\partial {}}}",
    "Q": "Q_{{{}}}", "f": "f_{{{}}}", "b": "b_{{{}}}", "K": "K_{{{},{}}}",
    "Qc": "Q_{{c,{}}}", "L": r"\mathcal{L}", "conserved": "Conserved quantities",
    "matrix form": "Matrix form", "matrix form held": "Matrix form",
    "motion": r"\[ \mathbf{M} \ddot{\mathbf{q}} = \mathbf{f} \]",
    "motion held": r"\[ \mathbf{M} \ddot{\mathbf{q}} = \mathbf{f} + "
    r"\mathbf{A}^{\mathsf{T}} \boldsymbol{\lambda}, \qquad "
    r"\mathbf{A} \ddot{\mathbf{q}} = \mathbf{b} \]",
    "symmetric": r", and $\mathbf{M}$ is symmetric",
    "principle": f"The {_LEAST}",
    "principle held":
    rf"Subject to $\mathbf{{A}} \ddot{{\mathbf{{q}}}} = \mathbf{{b}}$, the {_LEAST}",
    "gain": r"The constraint forces are $\mathbf{Q}_{c} = \mathbf{K} (\mathbf{A} "
    r"\mathbf{a} - \mathbf{b})$ with the gain $\mathbf{K} = "
    r"-\mathbf{A}^{\mathsf{T}} (\mathbf{A} \mathbf{M}^{-1} "
    r"\mathbf{A}^{\mathsf{T}})^{-1}$.",
}  # fmt: skip


def as_latex(content: Content) -> str:
    """Give a derivation as a LaTeX document."""
    plain = content.translation.own_names
    names = LatexNames(plain)
    shown = {names.show(Name(n)) for n in plain}
    # The letters of mechanics give way to the file's names.
    letters = {k: rf"\mathcal{{{k}}}" if k in shown else k for k in "TVFGh"}
    signs = {k: text.replace("LETTER", letters["G"]) for k, text in _SIGNS.items()}
    model = content.translation.equations.model
    lines = [_PREAMBLE, rf"\section*{{{plain_latex(model.name)}}}"]
    if model.description:
        lines.append(plain_latex(" ".join(model.description.split())))
    lines += _Latex(
        content, FormulaPrinter(content.translation, names), signs | letters
    ).told()
    lines += [_note(note) for note in content.notes]
    return "\n".join([*lines, r"\end{document}"]) + "\n"


def _note(note: str) -> str:
    """Give a note; options in it are not dashes and quotes."""
    text = plain_latex(note).replace("--", "-{}-")
    return "Note: " + re.sub("`(.*?)`", r"\\texttt{\1}", text) + ".\n"


_COMMAND = re.compile(
    r"\\(?:frac|left|right|mathrm|mathit|text|operatorname|dot|ddot|,)"
)
_STACK = re.compile(r"\\begin\{gathered\}(.*?)\\end\{gathered\}")
_LETTER = re.compile(r"\\[A-Za-z]+")


def _width(text: str) -> int:
    """Estimate how many letters mathematics takes."""
    text = _STACK.sub(lambda m: max(m[1].split(r"\\"), key=_width), text)
    text = _LETTER.sub("x", _COMMAND.sub("", text))
    return sum(c not in "{}_^ " for c in text)


class _Latex(Outline):
    room, between = LONGEST_LINE, 2

    def _label(self, name: str) -> str:
        return upright_latex(name)

    def _width(self, text: str) -> int:
        return _width(text)

    def _say(self, text: str) -> None:
        self.lines.append(text)

    def _title(self, text: str) -> None:
        self.lines.append(f"\n\\subsection*{{{plain_latex(text)}}}")

    def _rows(self, rows: Sequence[Row]) -> None:
        self.align([self.equals(*row) for row in rows])

    def _where(self, rows: Sequence[Row]) -> None:
        self.lines.append("where")
        self._rows(rows)

    def equals(self, left: str, right: Any) -> Typeset:
        return left, self.write.terms(right)

    def align(self, rows: Sequence[Typeset]) -> None:
        """Write rows left &= right; long ones are broken before a sign."""
        lines = [line for row in rows for line in _lines(*row)]
        if lines:
            body = " \\\\\n  ".join(lines)
            self.lines.append(f"\\begin{{align*}}\n  {body}\n\\end{{align*}}")

    # Sections

    def _force(self, force: Force) -> None:
        text = f"The force ${self.write(force.force)}$ works on ${self.show(force.on)}"
        if not force.direction.is_Symbol:
            text += f" = {self.write(force.direction)}"
        self.lines.append(text + "$.\n")

    def _equations(self, lines: Sequence[tuple[Line, list[Row]]]) -> None:
        self._title("Lagrange's equations")
        for line, terms in lines:
            self.lines.append(f"For ${self.show(line.coordinate)}$:")
            self._rows(terms)
        self.lines.append("The equations of motion are")
        self.align(self._motion())

    def _motion(self) -> list[Typeset]:
        """Give the equations, one = under the other where there is room."""
        rows = [self.equals(self.write(line.left), line.right) for line in self.c.lines]
        widths = [(_width(left), _width_of(right)) for left, right in rows]
        if sum(map(max, zip(*widths, strict=True))) <= LONGEST_LINE:
            return rows
        return [
            ("", [*self.write.terms(line.left), *_related("=", right)])
            for line, (_, right) in zip(self.c.lines, rows, strict=True)
        ]

    def _square(self, letter: str, rows: Rows) -> None:
        inside = " \\\\\n  ".join(" & ".join(row) for row in rows)
        self.lines.append(
            f"\\[ \\mathbf{{{letter}}} = \\begin{{bmatrix}}\n  {inside}\n"
            "\\end{bmatrix} \\]"
        )

    def _entries(self, letter: str, rows: Sequence[Entry], also: str) -> None:
        bold = rf"\mathbf{{{letter}}}"
        self.align([(f"{bold}_{{{row},{q}}}", [("+", e)]) for row, q, e in rows])
        self.lines.append(f"Other entries of ${bold}$ are zero{also}.\n")

    def _constraint(self, k: Condition) -> None:
        self.align(self._derivatives(k))

    def _law(self, k: Condition, multiplier: Any) -> None:
        if k.kind == "one-sided" and not k.moving:
            parts = [f"restitution ${k.law['restitution']:g}$"]
            if "friction" in k.law:
                slips = ", ".join(f"${self.write(s)}$" for s in k.law["slip"])
                parts.append(f"friction ${self.write(k.law['friction'])}$")
                if "static" in k.law:
                    parts.append(f"static friction ${self.write(k.law['static'])}$")
                parts.append(f"sliding velocity {slips}")
            self.lines.append("With " + ", ".join(parts) + ".\n")
        name = upright_latex(k.name)
        rate = rf"\varphi_{{{name}}}" if k.moving else rf"\dot{{g}}_{{{name}}}"
        called = (rate if k.moving else f"g_{{{name}}}", rate)
        told = conditions(k, self.write, multiplier, called, LATEX)
        self.lines += [rf"\[ {text} \]" for text in told.values()]

    def _derivatives(self, k: Condition) -> list[Typeset]:
        name = upright_latex(k.name)
        relation = r"\ge" if k.kind == "one-sided" else "="
        if k.moving:
            phi = rf"\varphi_{{{name}}}"
            return [
                (phi, [*self.write.terms(k.function), (relation, "0")]),
                self.equals(rf"\dot{{\varphi}}_{{{name}}}", k.acceleration),
            ]
        g = rf"g_{{{name}}}"
        return [
            (g, [*self.write.terms(k.function), (relation, "0")]),
            self.equals(rf"\dot{{g}}_{{{name}}}", k.rate),
            self.equals(rf"\ddot{{g}}_{{{name}}}", k.acceleration),
        ]

    def _conserved(self, item: Conserved) -> None:
        left, why = self._named(item)
        if item.definition:
            why += f"; the file calls it \\texttt{{{plain_latex(item.definition)}}}"
        self.lines.append(f"{why}:")
        self._rows([(left, item.value)])

    def _named(self, item: Conserved) -> tuple[str, str]:
        T, V, L, h = (self.signs[k] for k in "TVLh")
        names = ", ".join(f"${self.show(q)}$" for q in item.of)
        below = self.show(item.of[0]) if item.of else ""
        rate = rf"\partial {L} / \partial {below}"
        function = rf"\sum \dot{{q}} \, \partial {L} / \partial \dot{{q}} - {L}"
        still = rf"${L}$ does not depend on $t$"
        if self.c.has_forces:
            still += ", and no force does work"
        return {
            "energy": (f"{T} + {V}", f"Energy ({still})"),
            "energy function": (h, f"Energy function ${function}$ ({still})"),
            "momentum": (f"p_{{{below}}}", f"Momentum of the ignorable {names}"),
            "shifted momentum": (
                rf"\mathrm{{const}}_{{{below}}}",
                rf"Momentum of {names} less a function of the rate ${rate}$",
            ),
            "total momentum": (r"\mathrm{const}", f"Total momentum of {names}"),
            "angular momentum": (r"\mathrm{const}", f"Angular momentum of {names}"),
        }[item.kind]


def _lines(left: str, terms: list[tuple[str, str]]) -> list[str]:
    """Give the lines of one row: left &= terms."""
    # Where an equation is all to the right of the mark, its = is among the terms.
    line = f"{left} &= " if left else "& "
    room = LONGEST_LINE - _width(left)
    parts = [part for term in terms for part in _parts(*term, room)]
    return _filled(line, parts, room, r"&\quad ")


def _filled(
    line: str, parts: list[tuple[str, str]], room: int, begin: str
) -> list[str]:
    """Give lines with room for so much, filled with parts; `begin` starts the next."""
    lines, used = [], 0
    for k, (sign, text) in enumerate(parts):
        shown = "" if not sign or (k == 0 and sign == "+") else f"{sign} "
        if k and used + _width(text) > room:
            lines.append(line.rstrip())
            line, used = begin, 0
            shown = "{} " + shown  # a sign between two terms, not before one
        line += shown + text + " "
        used += _width(text) + 3
    return [*lines, line.rstrip()]


_NESTED = re.compile(r"\\left|\\right|\\begin|\\end|[{}]| (?=[-+] )")
_FRACTION = r"\frac{"


def _places(text: str) -> list[int]:
    """Give where signs stand that are within no group."""
    found, level = [], 0
    for match in _NESTED.finditer(text):
        if match[0] in (r"\right", r"\end", "}"):
            level -= 1
        if level == 0 and match[0] == " ":
            found.append(match.start())
        if match[0] in (r"\left", r"\begin", "{"):
            level += 1
    return found


def _signed(text: str) -> list[tuple[str, str]]:
    """Give the terms of a sum with their signs; none where it is no sum."""
    places = _places(text)
    first, *others = (text[a:b] for a, b in pairwise([0, *places, len(text)]))
    return [("+", first), *((x[1], x[3:]) for x in others)] if places else []


def _parts(sign: str, text: str, room: int) -> list[tuple[str, str]]:
    """Break a term that is longer than a line, before signs within parentheses."""
    if _width(text) <= room:
        return [(sign, text)]
    before, within, after = "", text, ""
    over = _closed(text, len(_FRACTION) - 1) if text.startswith(_FRACTION) else 0
    if over and _closed(text, over) == len(text):
        text, stacked = _stacked(text, over, room - 4)  # of its sign, too
        if stacked and _width(text[len(_FRACTION) : over - 1]) <= room:
            return [(sign, text)]
        before = rf"\frac{{1}}{text[over:]} \, "
        within = text[len(_FRACTION) : over - 1]
    if not (before and _places(within)):
        groups = [g for g in _groups(within) if _places(within[g[0] : g[1]])]
        if not groups:
            return [(sign, text)]
        first, last = max(groups, key=lambda g: _width(within[g[0] : g[1]]))
        before += within[: first - len(r"\left(")]
        after = within[last + len(r"\right)") :]
        within = within[first:last]
    (_, first_text), *others = _signed(within)
    found = [(sign, rf"{before}\bigl({first_text}")]
    if _width(before) > room // 2:  # a long denominator has a line of its own
        found = [(sign, before), ("", rf"\bigl({first_text}")]
    found += others
    found[-1] = found[-1][0], rf"{found[-1][1]}\bigr){after}"
    return found


def _stacked(text: str, over: int, room: int) -> tuple[str, bool]:
    """Give a fraction with a denominator longer than a line in several, and whether."""
    under = text[over + 1 : -1]
    if _width(under) <= room:
        return text, False
    lines = _filled("", _signed(under) or _parts("+", under, room), room, "")
    stack = r" \\ ".join(lines)
    return rf"{text[:over]}{{\begin{{gathered}} {stack} \end{{gathered}}}}", True


def _closed(text: str, start: int) -> int:
    """Give where a group ends that begins with a brace; 0 where none begins."""
    if text[start : start + 1] != "{":
        return 0
    level = 0
    for k in range(start, len(text)):
        level += (text[k] == "{") - (text[k] == "}")
        if not level:
            return k + 1
    return 0


def _groups(text: str) -> list[tuple[int, int]]:
    """Give the insides of the parentheses that stand in no others."""
    found, level, start = [], 0, 0
    for match in _NESTED.finditer(text):
        if match[0] in (r"\right", r"\end", "}"):
            level -= 1
            if not level and match[0] == r"\right" and text[start - 1] == "(":
                found.append((start, match.start()))
        elif match[0] != " ":
            if not level and match[0] == r"\left":
                start = match.end() + 1
            level += 1
    return found


def _related(relation: str, terms: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Give the terms that follow on a relation."""
    (sign, text), *rest = terms
    return [(relation, text if sign == "+" else f"{sign} {text}"), *rest]


def _width_of(terms: list[tuple[str, str]]) -> int:
    return sum(_width(text) + 3 for _, text in terms)


# What text, outside of formulas, has in LaTeX that Markdown writes otherwise: of the
# rest of LaTeX's escapes the backslash is Markdown's own.
_TEXT = (
    (re.compile(r"^\\section\*\{(.*)\}$", re.MULTILINE), r"### \1"),
    (re.compile(r"^\\subsection\*\{(.*)\}$", re.MULTILINE), r"#### \1"),
    (re.compile(r"\\texttt\{(.*?)\}"), r"`\1`"),
    (re.compile(r"\\textasciicircum\{\}"), "^"),
    (re.compile(r"\\textasciitilde\{\}"), "~"),
    (re.compile(r"\\textbackslash\{\}"), r"\\\\"),
    (re.compile(r"-\{\}-"), "--"),
    (re.compile(r"\*"), r"\*"),
)
_FORMULA = re.compile(r"(\\\[.*?\\\]|\\begin\{align\*\}.*?\\end\{align\*\})", re.DOTALL)


def as_markdown(content: Content) -> str:
    """Give what `as_latex` gives, without its document."""
    body = as_latex(content).partition("\\begin{document}\n")[2]
    body = body.partition("\\end{document}")[0]
    pieces = []
    for k, piece in enumerate(_FORMULA.split(body)):
        if k % 2:
            inside = piece.removeprefix("\\[").removesuffix("\\]").strip()
            if not inside.startswith("\\begin{align*}"):
                inside = f"$$\n{inside}\n$$"
            pieces.append(inside)
            continue
        text = piece.strip()
        for pattern, instead in _TEXT:
            text = pattern.sub(instead, text)
        pieces += [text] if text else []
    return "\n\n".join(pieces) + "\n"
