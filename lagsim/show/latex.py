"""A derivation as a LaTeX document, or as Markdown with formulas for notebooks.

The document compiles as it is, and its equations can be copied into a paper.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import sympy as sp

from lagsim.show import LATEX, on_velocities
from lagsim.show.names import LatexNames, PrintedName, plain_latex, upright_latex
from lagsim.show.printers import FormulaPrinter, signed
from lagsim.show.text import Outline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.show import Content
    from lagsim.show.text import Part, Row, Rows

    Pieces = list[tuple[str, str]]  # the texts between two places to break, with signs
    # the left side of a row, its terms, and the text after it
    Typeset = tuple[str, Pieces, str]


# A line of display mathematics, in letters as typeset.
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
    "minus": "-", "=": "=", "at least": r"\ge", "matrix": r"\mathbf{{{}}}",
    "entry": r"\mathbf{{{}}}_{{{},{}}}",
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
    "function": r"\sum \dot{{q}} \, \partial {0} / \partial \dot{{q}} - {0}",
    "range": r"{}, \dots, {}", "members": r", \quad {}",
    "momenta": r"${0} = \partial L / \partial w + \sum_{{v}} {2} \, \partial v / "
    r"\partial w$, over all $v$ that are written with $w$",
    "forces": "${0}$ is the force along $w$",
    "reactions": r"${1} = d/dt \, \partial L / \partial \dot{{u}} - \partial L / "
    r"\partial u - {3} + \sum_{{v}} {2} \, \partial v / \partial u$, over all $v$ that "
    "are written with $u$, is the force that holds $u$ to its definition",
    "momentum": "p_{{{}}}", "shifted momentum": r"\mathrm{{const}}_{{{}}}",
    "total momentum": r"\mathrm{{const}}", "angular momentum": r"\mathrm{{const}}",
}  # fmt: skip


def as_latex(content: Content) -> str:
    """Return a derivation as a LaTeX document."""
    x, found = content
    plain = x.own_names
    names = LatexNames(plain)
    shown = {names.show(PrintedName(n)) for n in plain}
    # Letters of mechanics that are names in the file are set in another font.
    letters = {k: rf"\mathcal{{{k}}}" if k in shown else k for k in "TVFGh"}
    signs = {k: text.replace("LETTER", letters["G"]) for k, text in _SIGNS.items()}
    signs["energy function"] = letters["h"]
    model = x.equations.model
    lines = [_PREAMBLE, rf"\section*{{{plain_latex(model.name)}}}"]
    if model.description:
        lines.append(plain_latex(" ".join(model.description.split())))
    lines += _Latex(content, FormulaPrinter(x, names), signs | letters).document()
    for note in found["notes"]:  # options in the text contain dashes and quotes
        text = plain_latex(note).replace("--", "-{}-")
        lines.append("Note: " + re.sub("`(.*?)`", r"\\texttt{\1}", text) + ".\n")
    return "\n".join([*lines, r"\end{document}"]) + "\n"


_COMMAND = re.compile(
    r"\\(?:frac|left|right|mathrm|mathit|text|operatorname|dot|ddot|,)"
)
_STACK = re.compile(r"\\begin\{gathered\}(.*?)\\end\{gathered\}")
_LETTER = re.compile(r"\\[A-Za-z]+")


def _width(text: str) -> int:
    """Estimate the width of a LaTeX formula in letters."""
    text = _STACK.sub(lambda m: max(m[1].split(r"\\"), key=_width), text)
    text = _LETTER.sub("x", _COMMAND.sub("", text))
    return sum(c not in "{}_^ " for c in text)


class _Latex(Outline):
    write: FormulaPrinter
    room, between = LONGEST_LINE, 2
    statements = LATEX
    width = staticmethod(_width)

    def _label(self, name: str) -> str:
        return upright_latex(name)

    def _inline(self, formula: str) -> str:
        return f"${formula}$"

    def _plain(self, name: str) -> str:
        return rf"\texttt{{{plain_latex(name)}}}"

    def _add_line(self, text: str) -> None:
        text = text.strip()
        if not text.startswith("\\["):
            end = "" if text.endswith((".", ":")) else "."
            text = f"{text[0].upper()}{text[1:]}{end}\n"
        self.lines.append(text)

    def _title(self, text: str) -> None:
        self.lines.append(f"\n\\subsection*{{{plain_latex(text)}}}")

    def _rows(self, rows: Sequence[Row]) -> None:
        self.align([self._typeset(*row) for row in rows])

    def _where(self, rows: Sequence[Row]) -> None:
        self.lines.append("where")
        self._rows(rows)

    def _typeset(self, left: str, right: Any, tail: str = "") -> Typeset:
        return left, self.pieces(right, LONGEST_LINE - _width(left)), tail

    def align(self, rows: Sequence[Typeset]) -> None:
        """Write equations, aligned at their signs; long ones are broken before a sign.

        rows : the left side, the terms (sign, text) of the right side, and the text at
            the end.
        """
        lines = []
        for left, terms, tail in rows:
            # If an equation is entirely to the right of the alignment mark, its = is
            # among the terms.
            head = f"{left} &= " if left else "& "
            lines += _filled(head, terms, LONGEST_LINE - _width(left), r"&\quad ")
            lines[-1] += tail
        if lines:
            body = " \\\\\n  ".join(lines)
            self.lines.append(f"\\begin{{align*}}\n  {body}\n\\end{{align*}}")

    # Terms that are longer than a line

    def pieces(self, e: Any, room: int) -> Pieces:
        """Return a sum as (sign, text) by term, broken for lines of `room` letters.

        A term that is longer than a line is divided within its longest factor.
        """
        found: Pieces = []
        for minus, term in map(signed, self.write.ordered(e)):
            sign, text = "-" if minus else "+", self.write.factor(term)
            short = _width(text) <= room
            found += [(sign, text)] if short else self._broken(sign, term, room)
        return found

    def _broken(self, sign: str, term: Any, room: int) -> Pieces:
        write = self.write
        over, under = write.fraction(term)
        below = write.product(under)
        if under and _width(below) > room:
            # the sign of the denominator
            parts = self.pieces(sp.Mul(*under, evaluate=False), room - 4)
            stack = r" \\ ".join(_filled("", parts, room - 4, ""))
            below = rf"\begin{{gathered}} {stack} \end{{gathered}}"
            above = write.product(over)
            if _width(above) <= room:
                return [(sign, rf"\frac{{{above}}}{{{below}}}")]
        sums = [x for x in over if x.as_base_exp()[0].is_Add or isinstance(x, sp.Sum)]
        if not sums:
            return [(sign, write.factor(term))]
        long = max(sums, key=lambda x: _width(write.factor(x)))
        before = write.product([x for x in over if x not in sums])
        if under:
            before = rf"\frac{{{before or '1'}}}{{{below}}}"
        (base, exponent), before_it = long.as_base_exp(), ""
        if isinstance(long, sp.Sum):
            base, before_it = long.function, write.sum_over(long)
        (minus, text), *rest = self.pieces(base, room)
        start = rf"{before_it}\bigl({'- ' if minus == '-' else ''}{text}"
        found = [(sign, rf"{before} \, {start}" if before else start), *rest]
        if _width(before) > room // 2:  # a long denominator has a line of its own
            found = [(sign, before), ("", start), *rest]
        power = "" if exponent == 1 else f"^{{{write(exponent)}}}"
        after = "".join(rf" \, {write.factor(x)}" for x in sums if x is not long)
        found[-1] = found[-1][0], rf"{found[-1][1]}\bigr){power}{after}"
        return found

    # Sections

    def _equations(self, lines: Sequence[tuple[Part, list[Row]]]) -> None:
        self._title("Lagrange's equations")
        for line, terms in lines:
            self.lines.append(f"For ${self.show(line['coordinate'])}$:")
            self._rows(terms)
        self.lines.append("The equations of motion are")
        self._balance(*((line["left"], line["right"]) for line, _ in lines))

    def _balance(self, *equations: tuple[Any, Any]) -> None:
        """Write equations (left, right), aligned one below the other if they fit."""
        found = []
        for left, whole in equations:
            right = self.pieces(whole, LONGEST_LINE)
            found.append((self.write(left), left, right))
        widths = [
            (_width(left), sum(_width(text) + 3 for _, text in right))
            for left, _, right in found
        ]
        if sum(map(max, zip(*widths, strict=True))) <= LONGEST_LINE:
            self.align([(left, right, "") for left, _, right in found])
            return
        rows: list[Typeset] = []
        for _, left, [(sign, text), *rest] in found:
            first = "=", text if sign == "+" else f"{sign} {text}"
            rows.append(("", [*self.pieces(left, LONGEST_LINE), first, *rest], ""))
        self.align(rows)

    def _square(self, letter: str, rows: Rows) -> None:
        inside = " \\\\\n  ".join(" & ".join(row) for row in rows)
        self.lines.append(
            f"\\[ \\mathbf{{{letter}}} = \\begin{{bmatrix}}\n  {inside}\n"
            "\\end{bmatrix} \\]"
        )

    def _derivatives(self, k: Part) -> list[str]:
        letter, last = (r"\varphi", 2) if on_velocities(k) else ("g", 3)
        over = (letter, rf"\dot{{{letter}}}", rf"\ddot{{{letter}}}")[:last]
        return [f"{x}_{{{upright_latex(k['name'])}}}" for x in over]

    def _given(self, given: Sequence[str]) -> None:
        if given:
            self._add_line(", ".join(given))

    def _statement(self, _: str, text: str) -> None:
        self._add_line(rf"\[ {text} \]")


def _filled(line: str, parts: Pieces, room: int, begin: str) -> list[str]:
    """Return the lines of a formula, of at most `room` letters each.

    line : the beginning of the first line.
    parts : (sign, text) of each term.
    begin : the beginning of further lines.
    """
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


# Characters of text, outside of formulas, that need another notation in LaTeX than in
# Markdown; of LaTeX's other escapes the backslash is Markdown's own.
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
    """Return a derivation as Markdown with formulas of LaTeX."""
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
