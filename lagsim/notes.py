"""Choices, events and warnings of a run, as documents list these."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from lagsim.codes.known import WarningCode


class Choice(NamedTuple):
    """Choice made for a run, with the reason for it."""

    choice: str
    reason: str


class Event(NamedTuple):
    """Event of a run at its time, with the constraint concerned, if any.

    `kind` is the word for the event in documents, such as `impact` or `switch`.
    `conditioning` is the smallest singular value at a loss of rank; `switch` is the
    text of a switch of the state, approximately as in the file; `name` is the name of
    an event of the file. An impact has the rates of its gap before and after
    (`rate_before`, `rate_after`), and `energy`, the change of energy by all
    simultaneous impacts. An event of the file that gives an impulse has the energy of
    all impulses at its time.
    """

    time: float
    kind: str
    constraint: str | None = None
    conditioning: float | None = None
    switch: str | None = None
    rate_before: float | None = None
    rate_after: float | None = None
    energy: float | None = None
    name: str | None = None

    @property
    def jumps(self) -> bool:
        """Whether velocities jump: at an impact, a corner, or by an impulse."""
        kicks = self.kind == "event" and self.energy is not None
        return kicks or self.kind in ("impact", "corner")

    @property
    def record(self) -> dict[str, Any]:
        """Entry of the event in documents; an event without a name has no `name`."""
        return {k: v for k, v in self._asdict().items() if k != "name" or v is not None}

    def __repr__(self) -> str:
        given = ((k, v) for k, v in self._asdict().items() if v is not None)
        return f"Event({', '.join(f'{name}={value!r}' for name, value in given)})"


class Caution(NamedTuple):
    """Warning: a stable code, a text, and the place in the file or None."""

    code: WarningCode
    text: str
    place: Any = None

    @property
    def number(self) -> str:
        """Number of the warning's code, such as W104."""
        from lagsim.codes import cautions

        return cautions()[self.code].number

    @property
    def record(self) -> dict[str, Any]:
        """Entry of the warning in documents; a warning without place has no `place`."""
        found: dict[str, Any] = {
            "code": self.code, "number": self.number, "text": self.text
        }  # fmt: skip
        if self.place is None:
            return found
        _, line, column, length, source = self.place
        return {
            **found,
            "line": line,
            "column": column,
            "length": length,
            "source": source,
        }
