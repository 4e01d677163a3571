"""A small strict reader of the LaTeX that derivations are written in.

Knows the commands that plain LaTeX and amsmath have and that are used here; demands
balanced groups, environments, \\left and \\right, mathematics where mathematics is
allowed, scripts with a base and an argument, at most one `&` in a line of align*.
"""

from __future__ import annotations

import re

_LETTERS = """
alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi rho pi sigma
tau upsilon phi chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi
Omega
varphi partial sum cdot le ge perp sin cos tan sinh cosh tanh exp min max ln arcsin
arccos arctan leq geq vee wedge neg quad qquad lfloor rfloor lceil rceil log
"""
_OVER = (
    "dot ddot bar mathrm mathit mathbf mathcal mathsf boldsymbol operatorname text sqrt"
)
# Command -> how many arguments in braces it takes.
MATH = dict.fromkeys(_LETTERS.split(), 0) | dict.fromkeys(_OVER.split(), 1)
MATH["frac"] = 2
TEXT = ("section", "subsection", "textasciicircum", "textbackslash", "textless",
        "textgreater", "textasciitilde", "texttt", "allowdisplaybreaks",
        "documentclass", "usepackage", "setcounter")  # fmt: skip
_TOKEN = re.compile(r"\\([A-Za-z]+)\*?|\\(.)|([{}$&_^])|(\s+)|(.)", re.DOTALL)
_ENVIRONMENTS = {
    "align*": True,
    "bmatrix": None,
    "cases": None,
    "gathered": None,
    "document": False,
}


class LatexError(Exception):
    """What TeX would stop at."""


def check(document: str) -> list[str]:
    """Read a document; give the display formulas in it."""
    reader = _Reader(document)
    reader.whole()
    return reader.displays


class _Reader:
    def __init__(self, document: str) -> None:
        self.tokens = [m for m in _TOKEN.finditer(document) if not m[4]]
        self.document = document
        self.at = 0
        self.stack: list[str] = []
        self.displays: list[str] = []
        self.large = 0  # parentheses that stay open past the end of a line

    def fail(self, why: str) -> LatexError:
        place = self.tokens[min(self.at, len(self.tokens) - 1)].start()
        return LatexError(f"{why}: {self.document[max(0, place - 40) : place + 40]!r}")

    def whole(self) -> None:
        if not self.document.startswith("\\documentclass"):
            raise self.fail("no document class")
        while self.at < len(self.tokens):
            self.text()
        if self.large:
            raise self.fail("\\bigl and \\bigr do not match")
        if self.stack:
            raise self.fail(f"not closed: {self.stack}")
        if self.document.count("\\begin{document}") != 1:
            raise self.fail("no document")

    def next(self):
        if self.at >= len(self.tokens):
            raise self.fail("ends too early")
        self.at += 1
        return self.tokens[self.at - 1]

    def peek(self) -> str:
        return self.tokens[self.at][0] if self.at < len(self.tokens) else ""

    def braces(self) -> str:
        """Pass over a group of plain letters; give it."""
        if self.next()[0] != "{":
            raise self.fail("an argument is missing")
        name = ""
        while (token := self.next()[0]) != "}":
            name += token
        return name

    def text(self) -> None:  # noqa: C901  one branch for each kind of sign
        token = self.next()
        command, escaped, special = token[1], token[2], token[3]
        if command == "begin":
            name = self.braces()
            self.stack.append(name)
            if _ENVIRONMENTS[name]:
                start = self.tokens[self.at].start()
                self.math(r"\end")
                self.displays.append(
                    self.document[start : self.tokens[self.at - 1].start()]
                )
                self.close()
        elif command == "end":
            self.close()
        elif command is not None:
            if command not in TEXT:
                raise self.fail(f"unknown command in text \\{command}")
            if self.peek() == "[":
                while self.next()[0] != "]":
                    pass
        elif escaped == "[":
            self.math(r"\]")
        elif escaped is not None and escaped not in "{}$&#%_ ":
            raise self.fail("unknown sign in text")
        elif special == "$":
            self.math("$")
        elif special is not None and special not in "{}":
            raise self.fail(f"`{special}` in text")
        elif token[5] is not None and not token[5].isascii() and token[5] > "ſ":
            raise self.fail("a sign that fonts do not have")

    def close(self) -> None:
        name = self.braces()
        if not self.stack or self.stack.pop() != name:
            raise self.fail(f"\\end{{{name}}} closes nothing")

    def math(self, end: str, *, depth: int = 0) -> None:  # noqa: C901
        """Read mathematics up to `end`."""
        columns, base = 0, False
        while True:
            token = self.next()
            text, command, special = token[0], token[1], token[3]
            if text == end or (command == "end" and end == r"\end"):
                return
            if command == "begin":
                name = self.braces()
                self.stack.append(name)
                if _ENVIRONMENTS[name] is not None:
                    raise self.fail(f"{name} in mathematics")
                self.math(r"\end", depth=depth + 1)
                self.close()
                base = True
            elif command == "left":
                self.delimiter()
                self.math(r"\right", depth=depth + 1)
                self.delimiter()
                base = True
            elif command is not None:
                self.command(command, depth)
                base = True
            elif text == "{":
                self.math("}", depth=depth + 1)
                base = True
            elif special in ("_", "^"):
                if not base:
                    raise self.fail("a script without a base")
                if self.next()[0] != "{":
                    raise self.fail("a script without braces")
                self.math("}", depth=depth + 1)
                if self.peek() == special:
                    raise self.fail("a double script")
            elif text == "&":
                columns += 1
                if self.stack[-1] == "align*" and (columns > 1 or depth):
                    raise self.fail("too many marks in a line of align*")
            elif text == r"\\":
                columns = 0
                if self.stack[-1] not in ("align*", "bmatrix", "cases", "gathered"):
                    raise self.fail("a new line in a formula")
            elif text in ("}", "$") or not text.isascii():
                raise self.fail(f"`{text}` in mathematics")
            elif token[2] is not None and text not in (r"\,", r"\:", r"\_", r"\|"):
                raise self.fail(f"unknown sign {text}")
            else:
                base = True

    def delimiter(self) -> None:
        token = self.next()
        if token[0] not in ("(", ")", "|", "[", "]", ".") and token[1] not in (
            "lfloor", "rfloor", "lceil", "rceil",
        ):  # fmt: skip
            raise self.fail("no delimiter")

    def command(self, name: str, depth: int) -> None:
        if name in ("bigl", "bigr"):
            self.large += 1 if name == "bigl" else -1
            self.delimiter()
            return
        if name == "right":
            raise self.fail("\\right without \\left")
        if name not in MATH:
            raise self.fail(f"unknown command \\{name}")
        if name == "sqrt" and self.peek() == "[":
            while self.next()[0] != "]":
                pass
        if name == "text":
            self.braces()  # letters of any script
            return
        for _ in range(MATH[name]):
            if self.next()[0] != "{":
                raise self.fail(f"\\{name} lacks an argument")
            self.math("}", depth=depth + 1)
