"""Collecting the faults of a file, and guessing what was meant."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from lagsim.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from lagsim.errors import Place
    from lagsim.language.tokens import ExpressionError
    from lagsim.model.nodes import Scalar

# Comparing a name with all others is slow where both are many; past these bounds a
# file is no longer one that a person mistyped.
MAX_GUESSES = 200
MAX_CANDIDATES = 2000
MAX_GUESSED_LENGTH = 80

# Nobody reads more, and each carries its source line.
MAX_FAULTS = 1000


def _argument(text: str) -> str:
    """Give what stands in the parentheses that a text begins with."""
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if letter == ")" and depth <= 0:
            return text[:k].strip().removeprefix("(").strip()
    return text.strip().removeprefix("(").strip()


class Faults:
    """The faults found so far; `sections` tells which keys stand where."""

    def __init__(
        self,
        file: str,
        found: Iterable[Problem] = (),
        sections: Mapping[str, dict[str, Any]] | None = None,
    ) -> None:
        self._file = file
        self._sections = sections or {}
        self._problems = list(found)
        self._guesses = 0

    def add(self, code: str, text: str, place: Place | None, hint: str = "") -> None:
        """Add a fault."""
        self._problems.append(Problem(code, text, place, hint))

    def add_expression(
        self,
        fault: ExpressionError,
        scalar: Scalar,
        known: Collection[str],
        *,
        beside: bool = False,
        relation: bool = False,
    ) -> None:
        """Add a fault of the expression in `scalar`.

        Parameters
        ----------
        fault
            The fault.
        scalar
            The text.
        known
            The variables of the file.
        beside
            A unit may stand beside this expression.
        relation
            It is a relation.
        """
        from lagsim.model.reader import intent

        place = scalar.place_of(fault.offset, fault.length)
        text, end = scalar.text, fault.offset + fault.length
        token = text[fault.offset : end]
        hint = ""
        if relation:
            hint = intent.IN_RELATIONS.get(token, "")
            if text.rstrip().endswith("="):
                hint = f"write {text.strip()} 0"
        hint = hint or self.meant(scalar, fault.offset, known, beside=beside)
        if not hint and fault.code == "unknown-function":
            argument = _argument(text[end:])
            hint = intent.of_function(token, argument, known)
            hint = hint or fault.hint or "a function of your own is a definition"
        if not hint and "a comparison is" in fault.text:
            hint = intent.of_comparison(text, fault.offset)
        hint = hint or intent.without_guesses(fault.hint, token, known)
        self.add(f"expression-{fault.code}", fault.text, place, hint)

    def meant(
        self,
        scalar: Scalar,
        offset: int,
        known: Collection[str],
        *,
        beside: bool = False,
    ) -> str:
        """Give a hint from what stands around a fault; `known` are the variables."""
        from lagsim.model.reader import intent

        self._guesses += 1
        if self._guesses > MAX_GUESSES:
            return ""
        return intent.of_text(scalar.text, offset, known, beside=beside)

    def belongs(self, key: str, *, otherwise: bool = False) -> str:
        """Give a hint where in the file a key stands, if it does elsewhere.

        `otherwise`: or one that it is a name for elsewhere.
        """
        if otherwise:
            from lagsim.model.reader.spellings import KEYS

            found = (self.belongs(other) for other in KEYS.get(key.casefold(), ()))
            return next(filter(None, found), "")
        if key in self._sections:
            return f"`{key}` belongs at the top of the file, without indentation"
        for name, form in self._sections.items():
            if key in form.get("properties", ()):
                return f"`{key}` belongs below `{name}:`, indented"
        return ""

    def guess(self, word: str, candidates: Iterable[str]) -> str:
        """Give the candidate most like `word`, or an empty text."""
        candidates = list(candidates)
        self._guesses += 1
        if (
            self._guesses > MAX_GUESSES
            or len(candidates) > MAX_CANDIDATES
            or len(word) > MAX_GUESSED_LENGTH
        ):
            return ""
        from lagsim.model.reader import intent

        plain = intent.spelt_out(word)
        for candidate in candidates:
            if intent.spelt_out(candidate) == plain:
                return candidate
        return (get_close_matches(word, candidates, 1) or [""])[0]

    def called(self, key: str, known: Collection[str]) -> str:
        """Give the key that is called otherwise elsewhere, or is most like this one."""
        from lagsim.model.reader.spellings import COUNTS, KEYS, SPANS

        if key.casefold() in (*COUNTS, *SPANS):
            return ""
        for other in KEYS.get(key.casefold().replace(" ", "_"), ()):
            if other in known:
                return other
        return self.guess(key, known)

    def did_you_mean(self, word: str, candidates: Iterable[str]) -> str:
        """Give a hint that names the candidate most like `word`, or no hint."""
        near = self.guess(word, candidates)
        return f"did you mean `{near}`?" if near else ""

    def raise_if_any(self) -> None:
        """Raise them all, in the order of the file; those of the command line first.

        Raises
        ------
        InputError
            If any fault was added.
        """
        if not self._problems:
            return
        problems = sorted(self._problems, key=self._order)
        more = len(problems) - MAX_FAULTS
        if more > 0:
            last = Problem("more-faults", f"{more} more faults are not shown")
            problems = [*problems[:MAX_FAULTS], last]
        raise InputError(problems)

    def _order(self, problem: Problem) -> tuple[bool, int, int]:
        place = problem.place
        if place is None:
            return False, 0, 0
        return place.file == self._file, place.line, place.column
