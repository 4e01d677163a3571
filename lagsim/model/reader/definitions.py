"""Definitions: in any order, without cycles, each with what it depends on."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.model.model import Definition, Level
from lagsim.model.reader.expressions import (
    OUTPUT,
    STATE,
    Resolved,
    highest,
    level_of_kind,
)
from lagsim.model.reader.names import Kind
from lagsim.model.reader.parameters import value_entry

if TYPE_CHECKING:
    from lagsim.language.parser import Parsed
    from lagsim.model.nodes import Scalar
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.fields import Entry

_OF_DEFINITIONS = (Kind.DEFINITION, Kind.RATE, Kind.SECOND_RATE)


class _Entry(NamedTuple):
    scalar: Scalar | None
    parsed: Parsed | None
    unit: str
    description: str


class Definitions:
    """Reads the definitions; those for output wait until the energies are built."""

    def __init__(self, given: list[Entry], x: Expressions) -> None:
        self.x = x
        self._entries: dict[str, _Entry] = {}
        for key, node in given:
            what = f"the definition `{key.text}`"
            expression, unit, about = value_entry(key, node, what, x)
            beside = expression is node
            scalar = x.scalar(expression, what, beside=beside)
            parsed = x.parse(scalar, beside=beside) if scalar else None
            self._entries[key.text] = _Entry(scalar, parsed, unit, about)
        self._uses = {name: self._used(entry) for name, entry in self._entries.items()}
        self._order = self._in_order()
        self._find_levels()

    def _used(self, entry: _Entry) -> list[str]:
        """Give the definitions that an expression names, once each."""
        found: dict[str, None] = {}
        for used in entry.parsed.names if entry.parsed else ():
            meaning = self.x.names.meaning(used.text)
            if (
                meaning
                and meaning.kind in _OF_DEFINITIONS
                and meaning.base in self._entries
            ):
                found[meaning.base] = None
        return list(found)

    def _in_order(self) -> list[str]:
        """Give the definitions, each after those it uses; cycles are left out."""
        missing = {name: len(uses) for name, uses in self._uses.items()}
        users: dict[str, list[str]] = {name: [] for name in self._uses}
        for name, uses in self._uses.items():
            for used in uses:
                users[used].append(name)
        order = [name for name, count in missing.items() if count == 0]
        for name in order:  # grows as it goes
            for user in users[name]:
                missing[user] -= 1
                if missing[user] == 0:
                    order.append(user)
        self._report_cycles({name for name, count in missing.items() if count})
        return order

    def _report_cycles(self, left: set[str]) -> None:
        seen: set[str] = set()
        for start in self._entries:
            path: list[str] = []
            name = start
            while name in left and name not in seen:
                seen.add(name)
                path.append(name)
                name = next(used for used in self._uses[name] if used in left)
            if name in path:
                self._report_cycle(path[path.index(name) :])

    def _report_cycle(self, cycle: list[str]) -> None:
        place = {name: i for i, name in enumerate(self._entries)}
        first = cycle.index(min(cycle, key=place.__getitem__))
        cycle = cycle[first:] + cycle[:first]
        entry = self._entries[cycle[0]]
        assert entry.scalar is not None
        assert entry.parsed is not None
        follower = cycle[1] if len(cycle) > 1 else cycle[0]
        at = next(
            n
            for n in entry.parsed.names
            if (meaning := self.x.names.meaning(n.text)) and meaning.base == follower
        )
        shown = cycle if len(cycle) <= 12 else [*cycle[:10], "...", cycle[-1]]
        self.x.faults.add(
            "cycle",
            f"the definition `{cycle[0]}` depends on itself: "
            + " -> ".join([*shown, cycle[0]]),
            entry.scalar.place_of(at.offset, len(at.text)),
        )

    def _find_levels(self) -> None:
        """Enter what each definition depends on, by the names in it."""
        known = self.x.definitions
        for name in self._order:
            levels = []
            parsed = self._entries[name].parsed
            for used in parsed.names if parsed else ():
                meaning = self.x.names.meaning(used.text)
                if meaning is None:
                    continue
                levels.append(level_of_kind(meaning.kind))
                if meaning.base in known and meaning.kind in _OF_DEFINITIONS:
                    levels.append(known[meaning.base].level)
            known[name] = Resolved(None, highest(levels))

    def build(self, *levels: Level) -> None:
        """Build the definitions of some levels, those of positions first."""
        known = self.x.definitions
        for level in levels:
            for name in self._order:
                if known[name].level is level:
                    known[name] = Resolved(self._node(name, level), level)

    def _node(self, name: str, level: Level) -> int | None:
        entry = self._entries[name]
        if entry.scalar is None or entry.parsed is None:
            return None
        allowed = OUTPUT if level is Level.OUTPUT else STATE
        what = f"the definition `{name}`"
        if self.x.check(entry.parsed.names, entry.scalar, what, allowed) is None:
            return None
        return self.x.build(entry.parsed)

    def read(self) -> tuple[Definition, ...]:
        """Give the definitions in the order of the file, those that are sound."""
        found = []
        for name, entry in self._entries.items():
            known = self.x.definitions.get(name)
            if known is not None and known.node is not None:
                found.append(
                    Definition(
                        name, known.node, known.level, entry.unit, entry.description
                    )
                )
        return tuple(found)
