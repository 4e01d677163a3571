"""A derivation as a LaTeX document: compiles as it is, its blocks go into a paper."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from lagsim.derivation.names import LatexNames, Name
from lagsim.derivation.styles import LatexStyle
from lagsim.derivation.writer import Writer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.derivation.content import Condition, Conserved, Content, Line

DIGITS = 6
# A line of display mathematics, in letters as they come out.
LONGEST_LINE = 75
_PREAMBLE = r"""\documentclass{article}
\usepackage[T1]{fontenc}
\usepackage{amsmath}
\usepackage[margin=2.5cm]{geometry}
\allowdisplaybreaks
\setcounter{MaxMatrixCols}{30}
\begin{document}
"""
_SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&",
    "#": r"\#", "%": r"\%", "_": r"\_", "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}", "<": r"\textless{}", ">": r"\textgreater{}",
}  # fmt: skip

Row = tuple[str, list[tuple[str, str]]]


def as_latex(content: Content) -> str:
    """Give a derivation as a LaTeX document."""
    return _Latex(content).whole()


class _Latex:
    def __init__(self, content: Content) -> None:
        x = content.translation
        self.c = content
        self.names = LatexNames(x.own_names)
        self.write = Writer(
            LatexStyle(self.names, DIGITS), x.names, x.rank, decimals=x.substitute
        )
        shown = {self.names.show(Name(n)) for n in x.own_names}
        # The letters of mechanics give way to the file's names.
        letters = {k: rf"\mathcal{{{k}}}" if k in shown else k for k in "TVFGh"}
        self.T, self.V, self.F, self.G, self.h = letters.values()
        self.L = r"\mathcal{L}"
        self.parts: list[str] = []

    def whole(self) -> str:
        model = self.c.translation.equations.model
        self.parts += [_PREAMBLE, rf"\section*{{{_plain(model.name)}}}"]
        if model.description:
            self.parts.append(_plain(" ".join(model.description.split())))
        self._energies()
        self._forces()
        self._equations()
        self._matrix_form()
        self._constraints()
        self._solution()
        self._conserved()
        self._gauss()
        self.parts += [_plain(f"Note: {note}.") + "\n" for note in self.c.notes]
        self.parts.append(r"\end{document}")
        return "\n".join(self.parts) + "\n"

    # Pieces

    def title(self, text: str) -> None:
        self.parts.append(f"\n\\subsection*{{{text}}}")

    def equals(self, left: str, right: Any) -> Row:
        return left, self.write.terms(right)

    def align(self, rows: Sequence[Row]) -> None:
        """Write rows left &= right; long ones are broken before a sign."""
        lines = [line for row in rows for line in _lines(*row)]
        if lines:
            body = " \\\\\n  ".join(lines)
            self.parts.append(f"\\begin{{align*}}\n  {body}\n\\end{{align*}}")

    def show(self, q: str, order: int = 0) -> str:
        return str(self.names.show(Name(q, order)))

    @staticmethod
    def slope(of: str, by: str) -> str:
        return rf"\frac{{\partial {of}}}{{\partial {by}}}"

    def rate_of_slope(self, of: str, by: str) -> str:
        return rf"\frac{{d}}{{dt}} {self.slope(of, by)}"

    # Sections

    def _energies(self) -> None:
        c = self.c
        self.title("Energies")
        rows = []
        if c.kinetic is not None and c.potential is not None:
            rows += [self.equals(self.T, c.kinetic), self.equals(self.V, c.potential)]
            rows.append(self.equals(f"{self.L} = {self.T} - {self.V}", c.lagrangian))
        else:
            rows.append(self.equals(self.L, c.lagrangian))
        if c.dissipation is not None:
            rows.append(self.equals(self.F, c.dissipation))
        self.align(rows)
        kept = c.translation.kept
        if kept:
            self.parts.append("where")
            self.align([self.equals(self.write(k.symbol), k.value) for k in kept])

    def _forces(self) -> None:
        c = self.c
        if not c.forces and c.dissipation is None:
            return
        self.title("Generalized forces by virtual work")
        coordinates = [line.coordinate for line in c.lines]
        for force in c.forces:
            text = (
                f"The force ${self.write(force.force)}$ works on ${self.show(force.on)}"
            )
            if force.on not in coordinates:
                text += f" = {self.write(force.direction)}"
            self.parts.append(text + "$.\n")
        self.align(
            [
                self.equals(f"Q_{{{self.show(line.coordinate)}}}", line.terms["Q"])
                for line in c.lines
            ]
        )

    def _equations(self) -> None:
        self.title("Lagrange's equations")
        for line in self.c.lines:
            self.parts.append(f"For ${self.show(line.coordinate)}$:")
            self.align(self._terms(line))
        self.parts.append("The equations of motion are")
        self.align([self._equation(line.left, line.right) for line in self.c.lines])

    def _terms(self, line: Line) -> list[Row]:
        q, v = (self.show(line.coordinate, k) for k in (0, 1))
        labels = {
            "ddt_dT_dqdot": self.rate_of_slope(self.T, v),
            "dT_dq": self.slope(self.T, q),
            "ddt_dV_dqdot": self.rate_of_slope(self.V, v),
            "dV_dq": self.slope(self.V, q),
            "ddt_dL_dqdot": self.rate_of_slope(self.L, v),
            "dL_dq": self.slope(self.L, q),
            "Q": f"Q_{{{q}}}",
        }
        return [self.equals(labels[k], e) for k, e in line.terms.items()]

    def _equation(self, left: Any, right: Any) -> Row:
        terms = self.write.terms(left)
        return "", [*terms, ("=", self.write(right))]

    def _matrix_form(self) -> None:
        c = self.c
        self.title("Matrix form")
        held = (
            r" + \mathbf{A}^{\mathsf{T}} \boldsymbol{\lambda}" if c.constraints else ""
        )
        also = r", \qquad \mathbf{A} \ddot{\mathbf{q}} = \mathbf{b}"
        also = also if c.constraints else ""
        self.parts.append(
            rf"\[ \mathbf{{M}} \ddot{{\mathbf{{q}}}} = \mathbf{{f}}{held}{also} \]"
        )
        rows = [[self.write(e) for e in row] for row in c.M]
        names = [self.show(line.coordinate) for line in c.lines]
        self._matrix(r"\mathbf{M}", rows, names, names)
        self.align(
            [self.equals(f"f_{{{q}}}", e) for q, e in zip(names, c.f, strict=True)]
        )
        if c.constraints:
            labels = [_roman(k.name) for k in c.constraints]
            rows = [[self.write(e) for e in k.A] for k in c.constraints]
            self._matrix(r"\mathbf{A}", rows, labels, names)
            self.align(
                [
                    self.equals(f"b_{{{label}}}", k.b)
                    for label, k in zip(labels, c.constraints, strict=True)
                ]
            )

    def _matrix(
        self,
        letter: str,
        rows: list[list[str]],
        labels: Sequence[str],
        names: Sequence[str],
    ) -> None:
        """Write a matrix as a square where it fits, else entry by entry."""
        widths = [max(map(_width, column)) for column in zip(*rows, strict=True)]
        if sum(widths) + 2 * len(widths) <= LONGEST_LINE:
            inside = " \\\\\n  ".join(" & ".join(row) for row in rows)
            self.parts.append(
                f"\\[ {letter} = \\begin{{bmatrix}}\n  {inside}\n\\end{{bmatrix}} \\]"
            )
            return
        entries: list[Row] = [
            (f"{letter}_{{{labels[i]},{names[j]}}}", [("+", e)])
            for i, row in enumerate(rows)
            for j, e in enumerate(row)
            if e != "0" and (j >= i or labels is not names)
        ]
        self.align(entries)
        also = r", and $\mathbf{M}$ is symmetric" if labels is names else ""
        self.parts.append(f"Other entries of ${letter}$ are zero{also}.\n")

    def _constraints(self) -> None:
        for k in self.c.constraints:
            self.title(f"Constraint {_plain(k.name)} ({k.kind})")
            self.align(self._constraint(k))
            if k.law:
                parts = [f"restitution ${k.law['restitution']:g}$"]
                if "friction" in k.law:
                    slips = ", ".join(f"${self.write(s)}$" for s in k.law["slip"])
                    parts.append(f"friction ${self.write(k.law['friction'])}$")
                    parts.append(f"sliding velocity {slips}")
                self.parts.append("With " + ", ".join(parts) + ".\n")

    def _constraint(self, k: Condition) -> list[Row]:
        name = _roman(k.name)
        if k.kind == "nonholonomic":
            phi = rf"\varphi_{{{name}}}"
            return [
                (phi, [*self.write.terms(k.function), ("=", "0")]),
                self.equals(rf"\dot{{\varphi}}_{{{name}}}", k.acceleration),
            ]
        g = rf"g_{{{name}}}"
        relation = r"\ge" if k.kind == "one-sided" else "="
        return [
            (g, [*self.write.terms(k.function), (relation, "0")]),
            self.equals(rf"\dot{{g}}_{{{name}}}", k.rate),
            self.equals(rf"\ddot{{g}}_{{{name}}}", k.acceleration),
        ]

    def _solution(self) -> None:
        solved = self.c.solution
        if solved is None:
            return
        self.title("Accelerations")
        rows = [self.equals(self.write(s), e) for s, e in solved.steps]
        rows += [
            self.equals(self.show(line.coordinate, 2), e)
            for line, e in zip(self.c.lines, solved.accelerations, strict=True)
        ]
        multipliers = self.c.translation.multipliers
        rows += [
            self.equals(self.write(s), e)
            for s, e in zip(multipliers, solved.multipliers, strict=False)
        ]
        self.align(rows)

    def _conserved(self) -> None:
        if not self.c.conserved:
            return
        self.title("Conserved quantities")
        for item in self.c.conserved:
            left, why = self._named(item)
            if item.definition:
                why += f"; the file calls it \\texttt{{{_plain(item.definition)}}}"
            self.parts.append(f"{why}:")
            self.align([self.equals(left, item.value)])

    def _named(self, item: Conserved) -> tuple[str, str]:
        names = ", ".join(f"${self.show(q)}$" for q in item.of)
        below = self.show(item.of[0]) if item.of else ""
        rate = rf"\partial {self.L} / \partial {below}"
        function = (
            rf"\sum \dot{{q}} \, \partial {self.L} / \partial \dot{{q}} - {self.L}"
        )
        return {
            "energy": (f"{self.T} + {self.V}", f"Energy ({_plain(item.why)})"),
            "energy function": (
                self.h,
                rf"Energy function ${function}$ ({_plain(item.why)})",
            ),
            "momentum": (f"p_{{{below}}}", f"Momentum of the ignorable {names}"),
            "shifted momentum": (
                rf"\mathrm{{const}}_{{{below}}}",
                rf"Momentum of {names} less a function of the rate ${rate}$",
            ),
            "total momentum": (r"\mathrm{const}", f"Total momentum of {names}"),
            "angular momentum": (r"\mathrm{const}", f"Angular momentum of {names}"),
        }[item.kind]

    def _gauss(self) -> None:
        principle = self.c.gauss
        if principle is None:
            return
        self.title("Gauss's principle")
        apart = r"(\ddot{\mathbf{q}} - \mathbf{a})"
        self.parts.append(
            rf"Subject to $\mathbf{{A}} \ddot{{\mathbf{{q}}}} = \mathbf{{b}}$, the "
            rf"accelerations make ${self.G} = \frac{{1}}{{2}} {apart}^{{\mathsf{{T}}}} "
            rf"\mathbf{{M}} {apart}$ least, with $\mathbf{{M}} \mathbf{{a}} = "
            r"\mathbf{f}$."
        )
        x = self.c.translation
        rows = [self.equals(self.G, principle.G)]
        rows += [
            self.equals(self.names.show(Name(q.name, 0, "unconstrained")), a)
            for q, a in zip(x.q, principle.a or (), strict=False)
        ]
        self.align(rows)
        if not self.c.constraints:
            return
        self.parts.append(
            r"The constraint forces are $\mathbf{Q}_{c} = \mathbf{K} (\mathbf{A} "
            r"\mathbf{a} - \mathbf{b})$ with the gain $\mathbf{K} = "
            r"-\mathbf{A}^{\mathsf{T}} (\mathbf{A} \mathbf{M}^{-1} "
            r"\mathbf{A}^{\mathsf{T}})^{-1}$."
        )
        names = [self.show(q.name) for q in x.q]
        labels = [_roman(k.name) for k in self.c.constraints if k.kind != "one-sided"]
        rows = [
            self.equals(rf"K_{{{q},{label}}}", e)
            for q, row in zip(names, principle.K or (), strict=False)
            for label, e in zip(labels, row, strict=True)
        ]
        rows += [
            self.equals(rf"Q_{{c,{q}}}", e)
            for q, e in zip(names, principle.Qc or (), strict=False)
        ]
        self.align(rows)


def _lines(left: str, terms: list[tuple[str, str]]) -> list[str]:
    """Give the lines of one row: left &= terms."""
    lines = []
    # An equation has all of it to the right of the mark, its = among the terms.
    line = f"{left} &= " if left else "& "
    room = LONGEST_LINE - _width(left)
    used = 0
    for k, (sign, text) in enumerate(terms):
        relation = sign not in "+-"
        shown = "" if k == 0 and sign == "+" else f"{sign} "
        if k and not relation and used + _width(text) > room:
            lines.append(line.rstrip())
            line, used = r"&\quad ", 0
            shown = "{} " + shown  # a sign between two terms, not before one
        line += shown + text + " "
        used += _width(text) + 3
    return [*lines, line.rstrip()]


_COMMAND = re.compile(
    r"\\(?:frac|left|right|mathrm|mathit|text|operatorname|dot|ddot|,)"
)
_LETTER = re.compile(r"\\[A-Za-z]+")


def _width(text: str) -> int:
    """Estimate how many letters mathematics takes."""
    text = _LETTER.sub("x", _COMMAND.sub("", text))
    return sum(c not in "{}_^ " for c in text)


def _plain(text: str) -> str:
    """Give text with what LaTeX would read as commands spelled out."""
    return "".join(_SPECIAL.get(c, c) for c in text)


def _roman(name: str) -> str:
    r"""Give the name of a constraint for subscripts."""
    return (
        rf"\mathrm{{{_plain(name)}}}" if name.isascii() else rf"\text{{{_plain(name)}}}"
    )
