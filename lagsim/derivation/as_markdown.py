"""A derivation as Markdown with formulas, which notebooks typeset."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from lagsim.derivation.as_latex import as_latex

if TYPE_CHECKING:
    from lagsim.derivation.content import Content

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
