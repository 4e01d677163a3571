"""What a run has to say: what it chose, what happened on the way, what to beware of."""

from __future__ import annotations

from typing import Any, NamedTuple


class Choice(NamedTuple):
    """One thing chosen, and why."""

    choice: str
    reason: str


class Event(NamedTuple):
    """Something that happened at a time, to a constraint or to the run.

    `conditioning` goes with a loss of rank: the smallest singular value then; `switch`
    is the switch in the state, roughly as it was written. With an impact go the rates
    of its gap before and after, and `energy`, what all that strikes then changes of the
    energy.
    """

    time: float
    kind: str
    constraint: str | None = None
    conditioning: float | None = None
    switch: str | None = None
    rate_before: float | None = None
    rate_after: float | None = None
    energy: float | None = None

    def __repr__(self) -> str:
        said = ((k, v) for k, v in self._asdict().items() if v is not None)
        return f"Event({', '.join(f'{name}={value!r}' for name, value in said)})"


class Caution(NamedTuple):
    """Something the user should know; `code` is stable."""

    code: str
    text: str

    @property
    def number(self) -> str:
        """The number that goes with the code, such as W104."""
        from lagsim.codes import cautions

        return cautions()[self.code].number

    @property
    def record(self) -> dict[str, Any]:
        """What documents say of it."""
        return {"code": self.code, "number": self.number, "text": self.text}
