"""Diagnosis of a text that is not the YAML its author meant, and its repair.

Expressions meet YAML's own signs: a colon, a comma or a sign that begins a value. The
diagnosis names the mistake; a repair sets the value aside, so that the rest of the
file can still be read and all its faults be reported at once.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from lagsim.errors import Problem
from lagsim.model.nodes import Broken, Node, Scalar, Source

_FORBIDDEN = re.compile(
    "[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
)
# Compiled where they are needed, which is where a file has a fault.
_ENTRY = (
    r"(?P<lead>\s*(?:-\s+)*)(?P<key>[^\s:#{}\[\],'\"|>@`%&*!?][^:{}\[\]]*?)\s*:\s+"
    r"(?P<value>\S.*)"
)
_ITEM = r"(?P<lead>\s*(?:-\s+)+)(?P<value>\S.*)"
_NO_SPACE = r"\s*(?:-\s+)*(?P<key>[^\s:#{}\[\],'\"]+):(?P<value>[^\s:]\S*)"
_EQUALS = r"\s*(?P<key>\w+)\s*=\s*(?P<value>[^:=]+)$"
_BEGINS = {
    "%": "`%` cannot begin a value in YAML",
    "@": "`@` cannot begin a value in YAML",
    "`": "a backquote cannot begin a value in YAML",
    "|": "`|` begins a block of text in YAML",
    ">": "`>` begins a block of text in YAML",
    "*": "`*` begins an alias in YAML",
    "&": "`&` begins an anchor in YAML",
    "!": "`!` begins a tag in YAML",
    "-": "`- ` begins an item of a list in YAML",
    "?": "`? ` begins a key in YAML",
    ",": "`,` cannot begin a value in YAML",
}


class Repair(NamedTuple):
    """The text without the faulty value, and line and column of what stands for it."""

    text: str
    spoilt: tuple[int, int]


class Diagnosis(NamedTuple):
    """A fault that stopped the YAML parser; `line` counts from 0."""

    problem: Problem
    line: int
    repair: Repair | None = None


def bad_character(source: Source) -> Problem | None:
    """Give the fault of the first character that YAML does not allow, if any."""
    match = _FORBIDDEN.search(source.text)
    if match is None:
        return None
    text = f"the character U+{ord(match.group()):04X} is not allowed in YAML"
    shown = Source(source.file, _FORBIDDEN.sub("\ufffd", source.text))
    return Problem("yaml-character", text, shown.place(match.start()))


def diagnose(
    source: Source,
    problem: str,
    at: tuple[int, int],
    context: str,
    context_at: tuple[int, int] | None,
) -> Diagnosis:
    """Say what a syntax error of the YAML parser means.

    Parameters
    ----------
    source
        The text.
    problem, context
        The parser's own words.
    at, context_at
        Where: line and column, counted from 0.
    """
    if context_at is not None:
        context_at = _inside(source, context_at)
    case = _Case(source, problem, _inside(source, at), context, context_at)
    for rule in (
        _tab, _missing_space, _no_colon, _open_quote, _open_bracket, _second_colon,
        _indentation, _beginning, _after_quote, _in_brackets,
    ):  # fmt: skip
        found = rule(case)
        if found is not None:
            return found
    return case.fault(f"this is not YAML: {problem}", case.at)


def _inside(source: Source, at: tuple[int, int]) -> tuple[int, int]:
    """Bring a place at the very end back to the last line that says something."""
    line, column = min(at[0], source.count - 1), at[1]
    while line > 0 and not source.line(line).strip():
        line -= 1
        column = len(source.line(line))
    return line, min(column, len(source.line(line)))


class _Case(NamedTuple):
    source: Source
    problem: str
    at: tuple[int, int]
    context: str
    context_at: tuple[int, int] | None

    @property
    def line(self) -> str:
        return self.source.line(self.at[0])

    @property
    def character(self) -> str:
        return self.line[self.at[1] : self.at[1] + 1]

    def entry(self) -> re.Match[str] | None:
        """Give the entry or item in whose value the parser stopped."""
        match = re.match(_ENTRY, self.line) or re.match(_ITEM, self.line)
        return match if match and self.at[1] >= match.start("value") else None

    def fault(
        self,
        text: str,
        at: tuple[int, int],
        hint: str = "",
        *,
        length: int = 1,
        code: str = "yaml-syntax",
        set_aside: bool = False,
    ) -> Diagnosis:
        place = self.source.place(self.source.starts[at[0]] + at[1], length)
        repair = self._set_aside() if set_aside else None
        return Diagnosis(Problem(code, text, place, hint), at[0], repair)

    def _set_aside(self) -> Repair | None:
        entry = self.entry()
        if entry is None:
            return None
        lines = [self.source.line(i) for i in range(self.source.count)]
        first, column = self.at[0], entry.start("value")
        dropped = [lines[first][column:]]
        lines[first] = lines[first][:column] + "_"
        indent = len(entry["lead"])
        for i in range(first + 1, len(lines)):
            inside = len(lines[i]) - len(lines[i].lstrip()) > indent
            if lines[i].strip() and not inside:
                break
            dropped.append(lines[i])
            lines[i] = ""
        left = "\n".join(dropped)
        if left.count("{") != left.count("}") or left.count("[") != left.count("]"):
            return None
        return Repair("\n".join(lines), (first, column))


def _tab(case: _Case) -> Diagnosis | None:
    blank = case.line[: len(case.line) - len(case.line.lstrip())]
    if "\t" not in blank and case.character != "\t":
        return None
    column = blank.index("\t") if "\t" in blank else case.at[1]
    return case.fault("a tab is used where YAML expects spaces", (case.at[0], column),
                      "indent with spaces", code="yaml-tab")  # fmt: skip


def _first_key(case: _Case) -> bool:
    """Tell whether the parser stopped at the first colon of its line."""
    return ":" not in case.line[: case.at[1]] and case.character == ":"


def _line_before(case: _Case) -> int:
    line = case.at[0] - 1
    while line > 0 and not case.source.line(line).strip():
        line -= 1
    return line


def _missing_space(case: _Case) -> Diagnosis | None:
    number = case.at[0]
    if "simple key" in case.context and case.context_at:
        number = case.context_at[0]
    elif "mapping values" in case.problem and _first_key(case) and number > 0:
        number = _line_before(case)
    else:
        return None
    line = case.source.line(number)
    match = re.match(_NO_SPACE, line) or re.match(_EQUALS, line)
    if match is None:
        return None
    key, value = match["key"], match["value"].rstrip()
    found = line[match.start("key") : match.start("value") + len(value)]
    fault = case.fault(
        f"a space is missing after the colon in `{found}`" if "=" not in found else
        f"a colon is missing in `{found}`",
        (number, match.start("key")), f"write `{key}: {value}`", length=len(found),
        code="missing-space",
    )  # fmt: skip
    lines = [case.source.line(i) for i in range(case.source.count)]
    column = match.end("key") + 2
    lines[number] = line[: match.end("key")] + ": _"
    return Diagnosis(fault.problem, number, Repair("\n".join(lines), (number, column)))


def _no_colon(case: _Case) -> Diagnosis | None:
    if "simple key" not in case.context or case.context_at is None:
        return None
    number, column = case.context_at
    found = case.source.line(number)[column:].strip()
    return case.fault(f"expected `key: value`, found `{found[:40]}`", case.context_at,
                      length=len(found))  # fmt: skip


def _open_quote(case: _Case) -> Diagnosis | None:
    if "quoted scalar" not in case.context or case.context_at is None:
        return None
    if "end of stream" in case.problem or "document" in case.problem:
        return case.fault("this quote is never closed", case.context_at)
    return case.fault("this is no escape of YAML's double quotes", case.at,
                      "use single quotes", set_aside=True)  # fmt: skip


def _open_bracket(case: _Case) -> Diagnosis | None:
    if "parsing a flow" not in case.context or case.context_at is None:
        return None
    number, column = case.context_at
    rest = case.source.line(number)[column:]
    if number == case.at[0] and rest.count("{") == rest.count("}") and (
        rest.count("[") == rest.count("]")
    ):  # fmt: skip
        return None
    bracket = rest[:1]
    if bracket not in ("{", "["):
        return None
    expected = "`,` or `}`" if bracket == "{" else "`,` or `]`"
    return case.fault(f"this `{bracket}` is not closed", case.context_at,
                      f"line {case.at[0] + 1} has something else where {expected} is "
                      "expected")  # fmt: skip


def _second_colon(case: _Case) -> Diagnosis | None:
    if case.character != ":" or case.entry() is None:
        return None
    return case.fault(
        "a second `:` in one entry", case.at,
        "give each entry its own line or comma; a text with a colon must be quoted",
        set_aside=True,
    )  # fmt: skip


def _indentation(case: _Case) -> Diagnosis | None:
    indent = len(case.line) - len(case.line.lstrip())
    if "mapping values" in case.problem and _first_key(case) and case.at[0] > 0:
        above = case.source.line(_line_before(case)).strip()
        if ":" not in above:
            number = _line_before(case)
            column = case.source.line(number).index(above)
            return case.fault(f"a colon is missing after `{above[:40]}`",
                              (number, column), f"write `{above[:40]}:`",
                              length=len(above))  # fmt: skip
        return case.fault(
            f"this line is indented as if it belonged to `{above[:40]}`, "
            "which has a value already", (case.at[0], indent),
            "the keys of one section begin in the same column",
        )  # fmt: skip
    if case.at[1] <= indent and ("expected key" in case.problem or
                                 "block end" in case.problem or
                                 "document start" in case.problem):  # fmt: skip
        return case.fault(
            "this line fits no section above it", (case.at[0], indent),
            "the keys of one section begin in the same column",
        )  # fmt: skip
    return None


def _beginning(case: _Case) -> Diagnosis | None:
    """Name a sign that YAML takes for its own where a value begins."""
    entry = case.entry()
    at = case.at[1]
    if entry is not None and entry["value"][0] in "|>*&!":
        at = entry.start("value")
    text = _BEGINS.get(case.line[at : at + 1])
    if text is None:
        return None
    hint = "quote the value"
    if entry is not None and "{" not in entry["value"] and "#" not in entry["value"]:
        quoted = entry["value"].strip().replace('"', "'")
        hint += f': "{quoted}"'
        if quoted[:1] == "|" and quoted.count("|") % 2 == 0:
            hint = "write " + re.sub(r"\|+([^|]+)\|+", r"abs(\1)", quoted)
        elif not _is_expression(quoted):
            hint += f" if it is a text; an expression begins without `{case.line[at]}`"
    return case.fault(text, (case.at[0], at), hint, set_aside=True)


def _is_expression(text: str) -> bool:
    """Tell whether a text is one, once it is quoted."""
    from lagsim.language.parser import ExpressionError, parse, parse_relation

    for parser in (parse, parse_relation):
        try:
            parser(text)
        except ExpressionError:
            continue
        return True
    return False


def _after_quote(case: _Case) -> Diagnosis | None:
    entry = case.entry()
    if entry is None or entry["value"][0] not in "'\"":
        return None
    return case.fault("something follows the closing quote", case.at,
                      "quote the whole value", set_aside=True)  # fmt: skip


def _in_brackets(case: _Case) -> Diagnosis | None:
    if case.character and case.character in "}]":
        return case.fault(f"`{case.character}` closes nothing", case.at, set_aside=True)
    if "parsing a flow" not in case.context:
        return None
    closer = "]" if "sequence" in case.context else "}"
    hint = "an expression in braces is best quoted"
    return case.fault(f"expected `,` or `{closer}`", case.at, hint, set_aside=True)


def unspaced(key: Node, value: Node) -> tuple[Node, Node, Problem | None]:
    """Take a key such as `theta:1` apart, where YAML needs a space after the colon."""
    if not isinstance(key, Scalar) or key.quoted:
        return key, value, None
    if ":" not in key.text or not (isinstance(value, Scalar) and value.empty):
        return key, value, None
    match = re.match(_NO_SPACE, key.text)
    if match is None:
        return key, value, None
    name, rest = match["key"], key.text[match.start("value") :]
    problem = Problem(
        "missing-space",
        f"a space is missing after the colon in `{key.text}`",
        key.place,
        f"write `{name}: {rest}`",
    )
    place = key.place_of(0, len(name))
    return Scalar(name, False, place, key.span), Broken(key.place), problem
