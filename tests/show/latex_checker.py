"""A small strict reader of the LaTeX that derivations are written in.

Knows the commands that plain LaTeX and amsmath have and that are used here; demands
balanced groups, environments, \\left and \\right, mathematics where mathematics is
allowed, scripts with a base and an argument, at most one `&` in a line of align*.
"""

from __future__ import annotations

import re
from collections import deque

_LETTERS = """
alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi rho pi sigma
tau upsilon phi chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi
Omega
varphi partial sum dots cdot le ge perp sin cos tan sinh cosh tanh exp min max ln arcsin
arccos arctan leq geq vee wedge neg quad qquad lfloor rfloor lceil rceil log
"""
_OVER = "dot ddot bar mathrm mathit mathbf mathcal mathsf boldsymbol operatorname sqrt"
# Command -> how many arguments in braces it takes.
MATH = dict.fromkeys(_LETTERS.split(), 0) | dict.fromkeys(_OVER.split(), 1)
MATH["frac"] = 2
TEXT = ("section", "subsection", "textasciicircum", "textbackslash", "textless",
        "textgreater", "textasciitilde", "texttt", "allowdisplaybreaks",
        "documentclass", "usepackage", "setcounter")  # fmt: skip
_ENVIRONMENTS = ("bmatrix", "cases", "gathered")
_DELIMITERS = (*"()|[].", r"\lfloor", r"\rfloor", r"\lceil", r"\rceil")
_FORMULA = re.compile(
    r"\\\[(.*?)\\\]|(?<!\\)\$(.*?)(?<!\\)\$|\\begin\{align\*\}(.*?)\\end\{align\*\}",
    re.DOTALL,
)


class LatexError(Exception):
    """Fault at which TeX would stop."""


def check(document: str) -> list[str]:
    """Read a document; return the aligned formulas in it."""
    displays = []

    def read(m: re.Match[str]) -> str:
        _Formula(m[1] or m[2] or m[3], "align*" if m[3] else "").whole()
        displays.extend([m[3]] if m[3] else [])
        return " "

    start, *pieces = _FORMULA.sub(read, document).split(r"\begin{document}")
    if not start.startswith(r"\documentclass") or len(pieces) != 1:
        raise LatexError("no document")
    text, *after = pieces[0].split(r"\end{document}")
    plain = re.sub(r"\\[{}$&#%_ ]", "", start + text)
    unknown = {*re.findall(r"\\([A-Za-z]*)", plain)} - {*TEXT}
    signs = re.findall(r"[$&_^]|[^\x00-\u017f]", plain)
    if unknown or signs or len(after) != 1 or plain.count("{") != plain.count("}"):
        raise LatexError(f"in text: {unknown} {signs}")
    return displays


class _Formula:
    def __init__(self, formula: str, environment: str) -> None:
        self.formula = formula
        self.tokens = deque(re.findall(r"\\[A-Za-z]+|\\.|\S", formula, re.DOTALL))
        self.environments = [environment]
        self.large = 0  # parentheses that stay open past the end of a line

    def whole(self) -> None:
        self.group(None)
        self.demand(self.large == 0, r"\bigl and \bigr do not match")

    def demand(self, holds: bool, why: str) -> None:
        if not holds:
            raise LatexError(f"{why}: {self.formula!r}")

    def take(self, *wanted: str) -> str:
        self.demand(bool(self.tokens), "ends too early")
        token = self.tokens.popleft()
        self.demand(not wanted or token in wanted, f"{token} instead of {wanted}")
        return token

    def letters(self, opens: str, closes: str) -> str:
        self.take(opens)
        found = ""
        while (token := self.take()) != closes:
            found += token
        return found

    def group(self, end: str | None) -> None:
        base, columns = False, 0
        while self.tokens or end:
            token, inside = self.take(), self.environments[-1]
            if token == end:
                return
            if token in ("_", "^"):
                self.demand(base, "a script without a base")
                self.take("{")
                self.group("}")
                double = bool(self.tokens) and self.tokens[0] == token
                self.demand(not double, "a double script")
            elif token in ("&", r"\\"):
                columns = columns + 1 if token == "&" else 0
                few = inside != "align*" or (columns < 2 and end is None)
                self.demand(bool(inside) and few, f"{token} in a formula")
            else:
                self.operand(token)
                base = True

    def operand(self, token: str) -> None:
        if token == "{":
            self.group("}")
        elif token == r"\left":
            self.take(*_DELIMITERS)
            self.group(r"\right")
            self.take(*_DELIMITERS)
        elif token in (r"\bigl", r"\bigr"):
            self.large += 1 if token == r"\bigl" else -1
            self.take(*_DELIMITERS)
        elif token == r"\begin":
            name = self.letters("{", "}")
            self.demand(name in _ENVIRONMENTS, f"{name} in mathematics")
            self.environments.append(name)
            self.group(r"\end")
            self.demand(self.letters("{", "}") == self.environments.pop(), "not closed")
        elif token == r"\text":
            self.letters("{", "}")  # of any script
        elif token[0] == "\\" and token[1].isalpha():
            self.demand(token[1:] in MATH, f"unknown command {token}")
            if token == r"\sqrt" and self.tokens[0] == "[":
                self.letters("[", "]")
            for _ in range(MATH[token[1:]]):
                self.take("{")
                self.group("}")
        else:
            plain = token in (r"\,", r"\:", r"\_", r"\|") or token[0] not in "\\}$"
            self.demand(plain and token.isascii(), f"{token} in mathematics")
