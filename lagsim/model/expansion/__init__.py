"""Expansion of families, vectors, frames and bodies of a file into single members.

`Expansion` stands between the YAML nodes and the reader. It returns nodes with one
entry for each member and component, under names with dots (`q.3`, `G.3.x`), whose
scalars have a `MemberReading` for their member. The reader then handles scalars only.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeGuard

from lagsim import limits
from lagsim.codes.known import (
    BAD_NAME,
    DUPLICATE_MEMBER,
    EXPRESSION_COMPONENT,
    EXPRESSION_MEMBER,
    EXPRESSION_RANGE,
    EXPRESSION_SIZE,
    EXPRESSION_SUBSCRIPT,
    EXPRESSION_TOO_MANY,
    NAME_CLASH,
    RESERVED_NAME,
    WRONG_COUNT,
)
from lagsim.language.names import HIDDEN, in_file
from lagsim.language.parser import SILENT, ExpressionError, parse, parse_relation
from lagsim.model.expansion import trees
from lagsim.model.expansion.gathering import DEFINED
from lagsim.model.expansion.grammar import CALLED, Key, parsed_key
from lagsim.model.expansion.scene import SceneExpansion
from lagsim.model.expansion.scope import (
    Family,
    FamilyEntry,
    HiddenReading,
    MemberReading,
    Scope,
    UnresolvedError,
    dotted,
)
from lagsim.model.nodes import (
    Broken,
    Entry,
    Mapping,
    Node,
    Scalar,
    Sequence,
    entries_of,
    items_of,
    value_of,
    with_value,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from collections.abc import Mapping as MappingType

    from lagsim.codes.known import ErrorCode
    from lagsim.errors import Place
    from lagsim.language.graph import Graph
    from lagsim.language.parser import ExpressionCode, Parsed, ParsedRelation
    from lagsim.model.expansion.bodies import Drawn
    from lagsim.model.expansion.frames import FrameReader, TurnedFrame
    from lagsim.model.expansion.scope import Indices, Members

# Keys of the value in an entry of each section.
_VALUES = {
    "parameters": ("value",), "definitions": ("value",), "constraints": ("relation",),
    "initial": ("guess", "steady"), "states": ("rate",), "modes": ("value",),
}  # fmt: skip
# Sections that declare names, beside `parameters`.
_DECLARING = ("modes", "coordinates", "states", "constraints", "definitions")
# Sections whose names have the size of their value.
_SIZED = ("definitions", "parameters")
_SIZES = (2, 3)
# Number of independent entries of a symmetric matrix, which a parameter may have.
_MATRIX = 6
_COMPONENTS = ("xy", "xyz")
_NAME = re.compile(r"[^\W\d_]\w*")
_COLUMN = re.compile(r"\w+(\.-?\d+)+(\.\w)?")


# Function that expands a node, or such functions by key (`*`: each key).
Rules: TypeAlias = "Callable[[Node, MemberReading], Node] | dict[str, Any] | None"
_ONE: Members = [({}, ())]


class Report(Protocol):
    """Function that records a fault: code, text, place and hint."""

    def __call__(
        self, code: ErrorCode, text: str, at: Place | Node | None, hint: str = "", /
    ) -> None:
        """Record a fault."""


class Expansion:
    """Model file with families, vectors, frames and bodies expanded into members.

    Parameters
    ----------
    gathers
        Whether long sums may become elements, see `language.elements`.
    root
        Root node of the file.
    instead
        Expressions that replace those of parameters in the file, by names with dots.
    report
        Function that records a fault: code, text, place and hint.
    is_unit
        Predicate: whether a text is a unit.
    graph
        Graph on which the expressions will be built.
    built_in
        Names that need no declaration.

    Attributes
    ----------
    node : Node
        Root node of the expanded file.
    scope : Scope
        Names of the file.
    broken : set of str
        Names whose declaration has a fault.
    complete : bool
        Whether every name that the file declares could be read.
    """

    def __init__(
        self,
        root: Node,
        instead: MappingType[str, str],
        report: Report,
        is_unit: Callable[[str], bool],
        graph: Graph,
        built_in: Collection[str],
        *,
        gathers: bool = False,
    ) -> None:
        self._top = {key.text: node for key, node in entries_of(root)}
        self.scope = Scope(graph, built_in)
        self.scope.may_gather = gathers
        self.scope.tables = frozenset(key.text for key, _ in self._entries("tables"))
        self.report, self._is_unit, self._instead = report, is_unit, instead
        self.gimbals: list[tuple[str, Parsed, tuple[Parsed, ...]]] = []
        self.turned: list[TurnedFrame] = []
        self.units: list[Entry] = []
        self.frames: FrameReader | None = None
        # Hidden definitions of positions, by the expressions that they name.
        self.moving: dict[str, Scalar] = {}
        self.drawn: list[Drawn] = []
        self.points: dict[str, Family] = {}
        self.unused_keys: list[str] = []
        self.broken: set[str] = set()
        self.complete = True
        self.plain = MemberReading(self.scope, {})
        self.hidden: list[Entry] = []
        self._count = 0
        self.silent: list[Scalar] = []
        self.node = root
        if isinstance(root, Mapping):
            new = self._sections()
            entries = [(k, new.get(k.text) or self.bound(v)) for k, v in root.entries]
            entries += [
                (n.entries[0][0]._replace(text=k, reading=None), n)
                for k, n in new.items()
                if k not in self._top and isinstance(n, Mapping)
            ]
            self.node = root._replace(entries=tuple(entries))

    def add_hidden(self, name: str, value: trees.Value, at: Scalar) -> trees.Value:
        """Add a hidden definition, and return a reference to its value.

        name : the name of the definition.
        value : its tree, or a tuple of trees for a vector, see `trees`.
        at : the scalar to whose text the offsets of names in the value refer.
        """
        single = isinstance(value, trees.Tree)
        parts = (value,) if isinstance(value, trees.Tree) else value
        letters = ("",) if single else trees.components(len(parts))
        names = [dotted(f"{HIDDEN}{name}", (), letter) for letter in letters]
        for full, part in zip(names, parts, strict=True):
            self.hidden.append(self.entry(full, trees.parsed(part, at.text), at))
        found = tuple(trees.name(full) for full in names)
        return found[0] if single else found

    def entry(
        self, name: str, parsed: Parsed | ParsedRelation, at: Scalar, text: str = ""
    ) -> Entry:
        """Return an entry for the reader that the file does not contain.

        name, parsed : key and value of the entry.
        at : the scalar of the file that messages point to.
        text : the source text of the value; `at.text` if empty.
        """
        reading = HiddenReading(self.scope, parsed)
        value = at._replace(text=text or at.text, reading=reading)
        return value._replace(text=name), value

    def _sections(self) -> dict[str, Node]:
        """Return the YAML nodes of the sections that were expanded, by section."""
        given: dict[str, list[FamilyEntry]] = {}
        new: dict[str, list[Entry]] = {}
        new["parameters"] = list(self._parameters())
        for section in _DECLARING:
            declared = (self._declared(*e, section) for e in self._entries(section))
            given[section] = [one for one in declared if one]
        self._make_frames()
        self._resolve(given["definitions"])
        if self.frames:
            self.frames.make_all()
        for section in _DECLARING:
            new[section] = [e for one in given[section] for e in self._written(one)]
        new["constraints"] += self.units
        new["energy"] = self._energy()
        for section in ("forces", "initial"):
            new[section] = self._referring(section, self._entries(section))
        events: dict[str, Family] = {}
        new["events"] = [
            (key, self.bound(node, reading, {"set": self._sets, "impulse": self._sets}))
            for entry in self._entries("events")
            for key, reading, node in self.named(*entry, events)
        ]
        new["definitions"] += self.hidden
        found: dict[str, Node] = {}
        for section, entries in new.items():
            node = self._top.get(section)
            if isinstance(node, Mapping):
                found[section] = node._replace(entries=tuple(entries))
            elif entries:  # the file does not contain the section
                found[section] = Mapping(tuple(entries), entries[0][0].place)
        shown = SceneExpansion(self)
        if "output" in self._top:
            rules = {
                "columns": self._names,
                "reactions": self._names,
                "sensitivities": self._names,
                "plots": {"y": shown.axis, "y2": shown.axis},
                "sections": {"*": {"plot": self._names}},
            }
            found["output"] = self.bound(self._top["output"], None, rules)
        scene = self._top.get("scene")
        if scene or self.drawn:
            found["scene"] = shown.scene(scene)
        return found

    def _make_frames(self) -> None:
        """Prepare the frames of the file, if any; each is built on its first use."""
        if "frames" in self._top:
            from lagsim.model.expansion.frames import FrameReader

            self.frames = FrameReader(self, self._top["frames"])
            self.scope.frame = self.frames.named_by

    def _energy(self) -> list[Entry]:
        """Return the entries of `energy`, with `bodies` replaced by their energies."""
        node = self._top.get("energy")
        found = [(key, self.bound(value)) for key, value in entries_of(node)]
        given = [self._top.get(key) for key in ("bodies", "gravity")]
        if given == [None, None]:
            return found
        from lagsim.model.expansion.bodies import Bodies

        bodies = Bodies(self, *given)
        self.drawn = bodies.drawn
        for k, (key, value) in enumerate(entries_of(node)):
            if isinstance(value, Scalar) and (tree := bodies.word(key.text, value)):
                reading = MemberReading(self.scope, {"bodies": tree})
                found[k] = key, self.bound(value, reading)
        self.unused_keys = bodies.unused_keys()
        return found

    def members(self, key: Scalar, label: str) -> tuple[Key, Members] | None:
        """Return the parsed name and the members of a key in `frames` or `bodies`.

        None where a fault was reported.

        label : `a frame` or `a body`, for messages.
        """
        try:
            parsed = parsed_key(key.text)
            if parsed and not parsed.letter and _NAME.fullmatch(parsed.name):
                named = parsed.subscripts or label == "a frame"
                if named and parsed.name in CALLED:
                    text = f"`{parsed.name}` is a function and cannot be {label}"
                    self.report(RESERVED_NAME, text, key)
                    return None
                return parsed, self._members(parsed, {})
            self.complete = False
            text = f"`{key.text}` cannot be the name of {label}"
            self.report(BAD_NAME, text, key, "such as arm or link(i = 1..n)")
        except ExpressionError as fault:
            self.fault(fault, key)
        return None

    def _entries(self, section: str) -> tuple[Entry, ...]:
        """Return the entries of a section of the file."""
        return entries_of(self._top.get(section))

    def bound(
        self, node: Node, reading: MemberReading | None = None, rules: Rules = None
    ) -> Node:
        """Return a copy of a YAML node whose scalars are evaluated for one member.

        node : the node of the file.
        reading : the member; None outside of families.
        rules : a function (node, reading) -> node that expands `node`; or a mapping of
            such rules by key, for the values of a mapping, or of the items of a list.
        """
        reading = reading or self.plain
        if callable(rules):
            return rules(node, reading)
        if isinstance(node, Scalar):
            return node._replace(reading=reading)
        if isinstance(node, Sequence):
            items = tuple(self.bound(n, reading, rules) for n in node.items)
            return node._replace(items=items)
        if isinstance(node, Mapping):
            rules = rules or {"slip": self.spread}
            every = rules.get("*")
            entries = (
                (k, self.bound(v, reading, rules.get(k.text, every)))
                for k, v in node.entries
            )
            return node._replace(entries=tuple(entries))
        return node

    # Keys, and their members

    def fault(self, fault: ExpressionError, scalar: Scalar) -> None:
        """Report a fault of an expression, at its place in a scalar."""
        if fault.code != SILENT:
            place = scalar.place_of(fault.offset, fault.length)
            self.report(fault.code, fault.text, place, fault.hint)

    def _key(
        self,
        key: Scalar,
        outer: Indices | None = None,
        space: dict[str, Family] | None = None,
    ) -> tuple[Key, Members] | None:
        """Parse a key of the file; return it with the members that it denotes.

        None if the key is faulty, or no name.

        outer : values of the indices of an enclosing range.
        space : the families among which the name is looked up; by default those of
            variables.
        """
        try:
            parsed = parsed_key(key.text) or self._column(key, space)
            return parsed and (parsed, self._members(parsed, outer or {}))
        except ExpressionError as fault:
            self.fault(fault, key)
            self.broken.add(key.text.partition("(")[0])
            self.silent += [key] if fault.code == SILENT else []
        return None

    def _column(self, key: Scalar, space: dict[str, Family] | None) -> Key | None:
        """Report a key of the form `q.3`, a column; return the key `q(3)` in its place.

        None for other keys.

        space : the families among which the name is looked up.
        """
        name = key.text.partition(".")[0]
        family = (self.scope.reference if space is None else space.get)(name)
        if not (family and family.indexed and _COLUMN.fullmatch(key.text)):
            return None
        text = f"`{key.text}` is the name of a column"
        hint = f"in a file the member is `{in_file(key.text)}`"
        self.report(EXPRESSION_MEMBER, text, key, hint)
        return parsed_key(in_file(key.text))

    def _members(self, key: Key, outer: Indices) -> Members:
        """Return the members that a key denotes: pairs of index values and subscripts.

        `q(i = 1..2)` has ({i: 1}, (1,)) and ({i: 2}, (2,)).

        outer : values of the indices of an enclosing range.
        """
        found: Members = [(outer, ())]
        for subscript in key.subscripts:
            token, index = subscript.token, subscript.runs
            ranges = []
            for indices, member in found:
                if index in indices:
                    text = f"the index `{index}` is given twice"
                    hint = "each range has an index of its own"
                    raise token.fault(text, hint, EXPRESSION_RANGE)
                ends = [
                    self.scope.whole(self.scope.value(end, indices), token)
                    for end in (subscript.first, subscript.last)
                    if end is not None
                ]
                ranges.append((indices, member, range(ends[0], ends[-1] + 1)))
            count = self._count + sum(len(numbers) for *_, numbers in ranges)
            if count > limits.MEMBERS:
                text = f"the families of this file have {count:,} members, "
                text += f"more than {limits.MEMBERS:,}"
                full = self.scope.full
                code: ExpressionCode = SILENT if full else EXPRESSION_TOO_MANY
                self.scope.full = True
                raise token.fault(text, limits.without(""), code)
            found = [
                ({**indices, index: trees.number(k)} if index else indices,
                 (*member, k))
                for indices, member, numbers in ranges
                for k in numbers
            ]  # fmt: skip
        return found

    def _declared(self, key: Scalar, node: Node, section: str) -> FamilyEntry | None:
        """Declare the family that an entry of `section` names; return the entry.

        None after a fault.

        key, node : the entry's key and value.
        """
        found, name = self._key(key), key.text.partition("(")[0]
        broken = False
        if found is None or found[0].letter:
            broken, self.complete = name in self.broken, False
            found = Key(name if broken else key.text), _ONE  # the reader refuses it
        parsed, members = found
        name, indexed = parsed.name, broken or bool(parsed.subscripts)
        constrains = section == "constraints"
        space = self.scope.constraints if constrains else self.scope.variables
        family = space.setdefault(name, Family(name, section, key.place, indexed))
        if broken:
            family.broken = True
            return None
        if section == "coordinates" and not self._has_components(family, node):
            family.broken = True
            self.broken.add(name)
        if indexed and not self._may_be(name, family, section, key):
            return None
        return self._join(FamilyEntry(key, node, family, parsed, members))

    def _may_be(self, name: str, family: Family, section: str, key: Scalar) -> bool:
        """Whether a name is free for a family of a section; else a fault is reported.

        family : the family of that name as declared before.
        section, key : the section, and the key that declares the name there.
        """
        if name in CALLED and section != "constraints":
            text = f"`{name}` is a function and cannot be the name of a family"
            self.report(RESERVED_NAME, text, key)
        elif (family.section, family.indexed) != (section, True):
            text = f"`{name}` is given already in `{family.section}` and cannot be a "
            hint = f"the first is in line {family.place.line}"
            if family.indexed and section == "definitions":
                hint += (
                    "; a definition of another name can contain both: `x(0): ...` and "
                )
                hint += f"`x(i = 1..n): {name}(i)`"
            self.report(NAME_CLASH, f"{text}family too", key, hint)
        else:
            return True
        family.broken = True
        self.broken.add(name)
        return False

    def _join(self, one: FamilyEntry) -> FamilyEntry | None:
        """Add the members that an entry declares to its family; return the entry.

        None after a fault, as where the family already has a member.
        """
        family, members = one.family, one.members
        if not one.parsed.subscripts:
            family.members.add(())
            return one
        counts = {len(m) for m in family.members} | {len(m) for _, m in members}
        if len(counts) > 1:
            text = f"members of `{family.name}` have {min(counts)} or {max(counts)} "
            self.report(WRONG_COUNT, f"{text}subscripts", one.key)
            return None
        again = next((m for _, m in members if m in family.members), None)
        if again is not None:
            name = dotted(family.name, again)
            text = f"the member `{name}` of `{family.name}` is given twice"
            self.report(DUPLICATE_MEMBER, text, one.key)
            return None
        family.members.update(m for _, m in members)
        self._count += len(members)
        return one

    # Values

    def _parameters(self) -> Iterator[Entry]:
        """Yield the entries of parameters and modes, one for each member and component.

        The values of parameters are stored first, for use in ranges and subscripts.
        """
        for key, node in self._entries("parameters"):
            one = self._declared(key, node, "parameters")
            if one is None:
                continue
            for name, value in self._written(one):
                yield name, value
                self._evaluate(name.text, value)

    def _evaluate(self, name: str, node: Node) -> None:
        given = value_of(node, _VALUES["parameters"])
        if name in self._instead:
            text, reading = self._instead[name], None
        elif isinstance(given, Scalar):
            text, reading = given.text, given.reading
        else:
            return
        try:
            parsed = (reading or self.plain).parsed(text, parse)
            self.scope.uses[name] = {used.text for used in parsed.names}
            self.scope.numbers[name] = self.scope.number(parsed)
        except UnresolvedError:
            return  # the reader reports it
        except ExpressionError as fault:  # it reports others
            self.scope.of_tables |= {name} if fault.code == EXPRESSION_RANGE else set()

    def _resolve(self, given: list[FamilyEntry]) -> None:
        """Determine the number of components of each definition.

        A definition is evaluated after the definitions that it contains.

        given : the entries of definitions.
        """
        waiting, before = [one for one in given if one.members], -1
        while len(waiting) != before:
            before, tried, waiting = len(waiting), waiting, []
            for one in tried:
                try:
                    letters = self._letters(one)
                except UnresolvedError:
                    waiting.append(one)
                    continue
                if not one.family.resolved:
                    one.family.letters, one.family.resolved = letters, True
        for one in given:
            one.family.resolved = True

    def _letters(self, one: FamilyEntry) -> tuple[str, ...]:
        """Return the names of an entry's components, `('x', 'y')`; () for a number.

        The names follow from the value of the entry's first member.
        """
        section, node = one.family.section, one.node
        if section == "coordinates":
            return one.family.letters
        shared = section == "constraints" and isinstance(node, Mapping) and any(
            key.text == "limit" for key, _ in node.entries
        )  # fmt: skip
        node = value_of(node, _VALUES[section])
        if one.parsed.ranged and isinstance(node, Sequence) and node.items:
            node = node.items[0]
        if isinstance(node, Sequence) and shared:
            return ()  # two relations that share a limit stay a list
        if isinstance(node, Sequence):
            sizes = (*_SIZES, _MATRIX) if section == "parameters" else _SIZES
            fits = len(node.items) in sizes and not self._with_unit(node)
            one.family.broken |= section == "definitions" and not fits
            return trees.components(len(node.items)) if fits else ()
        if not isinstance(node, Scalar) or not one.members:
            # An entry without a value has no size with which others could disagree.
            one.family.broken |= isinstance(node, Mapping) and section in _SIZED
            return ()
        parser: Callable[[str], Any] = parse
        if section == "constraints":
            parser = parse_relation
        text, first = (node.text, parser), one.members[0][0]
        with self.scope.gathering(DEFINED if section == "definitions" else None):
            size = self.scope.size(*text, first)
        if size < 1 and section in _SIZED:
            fault, one.family.broken = self.scope.failed, True
            if fault and self.complete and self.scope.size(*text, first) < size:
                self.fault(
                    fault, node
                )  # of an entry that refers to itself, and is skipped
        return trees.components(size) if size > 1 else ()

    def _has_components(self, family: Family, node: Node) -> bool:
        """Store the names of a coordinate's components; return whether they are valid.

        family : the coordinate.
        node : its entry's value, with the key `components` if it is a vector.
        """
        below = {key.text: value for key, value in entries_of(node)}
        family.letters = ()
        if named := below.get("components"):
            text = named.text if isinstance(named, Scalar) else ""
            family.letters = tuple(text) if text in _COMPONENTS else ()
            if not family.letters and not isinstance(named, Broken):
                about = "`components` must be `xy` or `xyz`"
                about += f", found `{text}`" if text else ""
                self.report(EXPRESSION_COMPONENT, about, named)
            return bool(family.letters)
        known = all(k in ("unit", "description") or k.startswith("x-") for k in below)
        empty = isinstance(node, Scalar) and node.empty
        return empty or (known and isinstance(node, Mapping))

    def _with_unit(self, node: Sequence) -> bool:
        """Whether a list is a number followed by a unit, which is a fault in a file."""
        last = node.items[-1]
        return (
            len(node.items) == len(("number", "unit"))
            and isinstance(last, Scalar)
            and self._is_unit(last.text)
            and last.text not in self.scope.variables
        )

    def _written(self, one: FamilyEntry) -> Iterator[Entry]:
        """Yield the entries to which an entry of the file expands.

        There is one for each member of its family and each component.
        """
        family, section = one.family, one.family.section
        letters = family.letters
        if section != "definitions":
            letters = self._letters(one)
            if one.members and not family.letters:
                family.letters = letters
        return self._by_members(one, section, letters)

    def _by_members(
        self, one: FamilyEntry, section: str, letters: tuple[str, ...]
    ) -> Iterator[Entry]:
        key, node, parsed = one.key, one.node, one.parsed
        keys = _VALUES.get(section, ())
        if one.family.section == "coordinates" and isinstance(node, Mapping):
            kept = (e for e in node.entries if e[0].text != "components")
            node = node._replace(entries=tuple(kept))
        self._count += max(0, len(letters) - 1) * len(one.members)
        inner, values = value_of(node, keys), [node] * len(one.members)
        if parsed.ranged and isinstance(inner, Sequence):
            values = [with_value(node, keys, item) for item in inner.items]
        if self._is_one_vector(inner, letters, one):
            text = f"`{key.text}` has {len(one.members)} members, each a vector of "
            text += (
                f"{len(letters)}; a list beside a range has one value for each member"
            )
            parts = ", ".join(x.text for x in inner.items if isinstance(x, Scalar))
            hint = f"write vec({parts}) for the same vector at each member"
            self.report(WRONG_COUNT, text, inner, hint)
            values = [Broken(inner.place)] * len(one.members)
        elif len(values) != len(one.members):
            text = f"`{key.text}` has {len(one.members)} members, and the list "
            hint = "a list beside a range has one value for each member"
            self.report(WRONG_COUNT, f"{text}{len(values)} values", inner, hint)
            values = [Broken(inner.place)] * len(one.members)
        if not (letters or parsed.subscripts):
            yield key, self.bound(node, MemberReading(self.scope, one.members[0][0]))
            return
        for (indices, member), value in zip(one.members, values, strict=True):
            for c, letter in enumerate(letters or ("",)):
                if parsed.letter not in ("", letter):
                    continue
                component = c if letters and not parsed.letter else None
                reading = MemberReading(
                    self.scope, indices, component, len(letters) or 1
                )
                full = key._replace(
                    text=dotted(parsed.name, member, letter), reading=reading
                )
                yield full, self._placed(value, keys, reading, key)

    def _is_one_vector(
        self, inner: Node, letters: tuple[str, ...], one: FamilyEntry
    ) -> TypeGuard[Sequence]:
        """Whether the list given for a range of members is one vector for all members.

        Otherwise it has a value for each member.

        inner : the list.
        letters : names of the components.
        one : the entry.
        """
        if not (letters and one.parsed.ranged and isinstance(inner, Sequence)):
            return False
        if one.parsed.letter or not one.members or len(inner.items) != len(letters):
            return False
        for item in inner.items:
            if not isinstance(item, Scalar):
                return False
            try:
                reading = MemberReading(self.scope, one.members[0][0], 0, len(letters))
                reading.parsed(item.text, parse)
            except ExpressionError as fault:
                if fault.code == EXPRESSION_SIZE:
                    return True
        return False

    def _placed(
        self, node: Node, keys: tuple[str, ...], reading: MemberReading, key: Scalar
    ) -> Node:
        """Return the value of an entry, a YAML node, for one component of a member.

        node : the value in the file: an expression, or a list with a value for each
            component.
        keys : keys of a mapping at which the value may stand.
        reading : the member and its component.
        key : the entry's key, for messages.
        """
        inner, outer = value_of(node, keys), reading
        if reading.component is None:
            new = self.bound(inner, reading)
        else:
            outer = MemberReading(self.scope, reading.indices)
            if not isinstance(inner, Sequence):
                new = self.bound(inner, reading)
            elif len(inner.items) == reading.size:
                new = self.bound(inner.items[reading.component], outer)
            else:
                text = f"`{key.text}` is a vector of {reading.size}, found a list of "
                self.report(WRONG_COUNT, f"{text}{len(inner.items)}", inner)
                return Broken(inner.place)
        return new if inner is node else with_value(self.bound(node, outer), keys, new)

    # Sections that refer to names

    def _referring(
        self, section: str, given: Iterable[Entry], outer: Indices | None = None
    ) -> list[Entry]:
        """Expand entries of a section whose keys refer to families, such as `initial`.

        The result has one entry for each member and component. An entry for a single
        member takes precedence over an entry for a range.

        section, given : the name of the section, and its entries.
        outer : values of the indices of an enclosing range.
        """
        found: dict[str, tuple[Entry, bool]] = {}
        for key, node in given:
            one = self._referred(key, node, outer)
            if not isinstance(one, FamilyEntry):
                found |= {key.text: (one, False)} if one else {}
                continue
            ranged, again = one.parsed.ranged, ""
            for entry in self._by_members(one, section, one.family.letters):
                name = entry[0].text
                _, other = found.get(name, (entry, not ranged))
                if other == ranged or section != "initial":
                    again = again or name * (name in found)
                if not ranged or name not in found:
                    # Takes the position of the entry with precedence.
                    found.pop(name, None)
                    found[name] = entry, ranged
            if again and not _COLUMN.fullmatch(key.text):
                self.report(DUPLICATE_MEMBER, f"`{again}` is given twice", key)
        return [entry for entry, _ in found.values()]

    def _referred(
        self, key: Scalar, node: Node, outer: Indices | None
    ) -> FamilyEntry | Entry | None:
        """Return the entry whose key refers to a name, such as a force on `q(i)`.

        For a family the result is a `FamilyEntry` with the members that the key
        selects, for any other name the unchanged entry. None after a fault.
        """
        found = self._key(key, outer)
        if found is None and key.text.partition("(")[0] in self.broken:
            return None
        family = self.scope.reference(found[0].name) if found else None
        if found is None or family is None:
            # a component of a vector that is not given
            several = isinstance(node, Sequence)
            known = Broken(node.place) if several else node
            return key, self.bound(known, MemberReading(self.scope, outer or {}))
        parsed, members = found
        if family.broken:
            return None
        code: ErrorCode | None = None
        text = f"`{parsed.name}` is no family"
        if family.indexed != bool(parsed.subscripts):
            code = EXPRESSION_SUBSCRIPT
            if family.indexed:
                text = f"`{parsed.name}` is a family: a subscript is missing"
        elif missing := family.missing(parsed.name, members):
            code, text = EXPRESSION_MEMBER, missing
        elif parsed.letter and parsed.letter not in family.letters:
            code = EXPRESSION_COMPONENT
            text = f"`{parsed.name}` has no component `.{parsed.letter}`"
        if code:
            self.report(code, text, key)
            return None
        return FamilyEntry(key, node, family, parsed, members)

    def spread(self, node: Node, reading: MemberReading) -> Node:
        """Return a vector-valued expression as a YAML list with an item per component.

        Any other YAML node is returned with its scalars evaluated for the member of
        `reading`, see `bound`.

        node : the expression.
        """
        if not isinstance(node, Scalar):
            return self.bound(node, reading)
        size = self.scope.size(node.text, parse, reading.indices)
        if size < 0:
            return Broken(node.place)
        if size < min(_SIZES):
            return self.bound(node, reading)
        readings = (
            MemberReading(self.scope, reading.indices, c, size) for c in range(size)
        )
        return Sequence(tuple(node._replace(reading=r) for r in readings), node.place)

    def named(
        self, key: Scalar, node: Node, space: dict[str, Family]
    ) -> Iterator[tuple[Scalar, MemberReading, Node]]:
        """Yield key, reading and value of each member of an entry that declares a name.

        The names are those of points, shapes and events, which are no variables.

        key, node : the entry.
        space : the families of these names, to which the entry is added.
        """
        found = self._key(key)
        if found is None and key.text.partition("(")[0] in self.broken:
            return
        if found is None or not found[0].subscripts:
            yield key, self.plain, node
            return
        parsed, members = found
        family = Family(parsed.name, "", key.place, True)
        family = space.setdefault(parsed.name, family)
        if self._join(FamilyEntry(key, node, family, parsed, members)) is None:
            return
        items = items_of(node)
        several = parsed.ranged and any(isinstance(n, Sequence) for n in items)
        if several and len(items) != len(members):
            text = f"`{key.text}` has {len(members)} members, and the list {len(items)}"
            self.report(WRONG_COUNT, text, node)
            return
        for k, (indices, member) in enumerate(members):
            reading = MemberReading(self.scope, indices)
            full = key._replace(text=dotted(parsed.name, member), reading=reading)
            yield full, reading, items[k] if several else node

    def _sets(self, node: Node, reading: MemberReading) -> Node:
        """Return an event's assignments or impulses, one per member and component.

        node : the mapping of the file.
        reading : the member of the event.
        """
        if not isinstance(node, Mapping):
            return self.bound(node, reading)
        found = tuple(self._referring("", node.entries, reading.indices))
        names = {key.text.partition("(")[0] for key, _ in node.entries}
        broken = not found and not names.isdisjoint(self.broken)
        return Broken(node.place) if broken else node._replace(entries=found)

    def denoted(
        self,
        node: Node,
        space: dict[str, Family] | None = None,
        outer: Indices | None = None,
    ) -> list[Node]:
        """Return the members and components that an item of a list denotes, as scalars.

        `q` denotes all members of the family q. Items that denote no family are
        returned unchanged.

        space, outer : see `_key`.
        """
        if not isinstance(node, Scalar):
            return [node]
        found = self._key(node, outer, space)
        if found is None:
            broken = node.text.partition("(")[0] in self.broken
            return [Broken(node.place) if broken else node]
        parsed, members = found
        find = self.scope.reference if space is None else space.get
        family = find(parsed.name)
        if parsed.name in self.broken or (family and family.broken):
            return [Broken(node.place)]
        if family is None:
            return [node]
        if not parsed.subscripts:
            members = [({}, m) for m in sorted(family.members)]
        if missing := family.missing(parsed.name, members):
            self.report(EXPRESSION_MEMBER, missing, node)
            return [Broken(node.place)]
        letters = (parsed.letter,) if parsed.letter else family.letters or ("",)
        return [
            node._replace(text=dotted(parsed.name, m, c), reading=self.plain)
            for _, m in members
            for c in letters
        ]

    def _names(self, node: Node, reading: MemberReading) -> Node:
        if not isinstance(node, Sequence):
            return self.bound(node, reading)
        items = (n for item in node.items for n in self.denoted(item))
        return node._replace(items=tuple(items))
