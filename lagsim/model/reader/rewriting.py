"""Text of a model file with other numbers, and its comments kept."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any, TypeAlias

from lagsim.language.names import in_file
from lagsim.model.model import NumberPlaces
from lagsim.model.nodes import Mapping, Scalar, entries_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from collections.abc import Mapping as MappingType

    from lagsim.model.nodes import Node

# The sections with numbers, and the keys under which an entry may have its number.
SECTIONS = ("parameters", "initial")
KEYS = ("value", "guess", "steady")
# Begin and end of a scalar in the text.
Span: TypeAlias = "tuple[int, int]"


def rewritten(root: Node, values: MappingType[str, float]) -> Iterator[str]:
    """Generate texts of a file in which the named numbers have other values.

    A number that several members of a family share becomes a list of their values. The
    list may have to contain the values of further members, which have entries of their
    own at one or both ends of the range. Each of these cases is a text of its own, and
    one of the texts is a valid file.

    Parameters
    ----------
    root : Node
        The file, with families written out by members.
    values : mapping of str to float
        Parameters and start values, by names with dots for members.
    """
    text, spans, _ = places(root)
    shared: dict[Span, list[str]] = {}
    for name, span in spans.items():
        shared.setdefault(span, []).append(name)
    changed = {span: names for span, names in shared.items() if values.keys() & names}
    more = {name: x for name, x in values.items() if name not in spans}
    added = dict(_added(root, more)) if more else {}
    for before, after in itertools.product((0, 1), repeat=2):
        edits, found = dict(added), text
        for span, own in changed.items():
            names = _extended(own, list(spans), before, after)
            edits[span] = _written(names, values, text[slice(*span)])
        for span in sorted(edits, reverse=True):
            found = found[: span[0]] + edits[span] + found[span[1] :]
        yield found


def places(root: Node) -> NumberPlaces:
    """Return the places of the numbers of names in the text of a file.

    Parameters
    ----------
    root : Node
        The file, with families written out by members.
    """
    spans: dict[str, Span] = {}
    text, added = "", None
    for section, below in entries_of(root):
        for key, value in entries_of(below) if section.text in SECTIONS else ():
            scalar = _number(value)
            if scalar is not None and scalar.style != "=":
                spans[key.text] = scalar.start, scalar.end
                text = scalar.source.text
        for key, _ in entries_of(below)[:1] if section.text == "initial" else ():
            line = key.source.text[: key.start].rpartition("\n")[2]
            added = key.start, ", " if line.strip() else f"\n{line}"
    return NumberPlaces(text, spans, added)


def _added(root: Node, values: MappingType[str, float]) -> Iterator[tuple[Span, str]]:
    """Yield the change that inserts new start values before the first one, if any.

    It is a pair: the place as (begin, end), and the text.

    root : the file.
    values : the start values.
    """
    place = places(root).added
    if place is not None:
        at, between = place
        more = (f"{in_file(name)}: {_shown(x)}" for name, x in values.items())
        yield (at, at), "".join(f"{one}{between}" for one in more)


def _number(node: Node) -> Scalar | None:
    """Return the scalar of an entry: its value, or that at one of `KEYS`; else None."""
    if isinstance(node, Mapping):
        below = {key.text: value for key, value in node.entries}
        node = next((below[key] for key in KEYS if key in below), node)
    return node if isinstance(node, Scalar) else None


def _extended(names: list[str], every: list[str], before: int, after: int) -> list[str]:
    """Return the members of a family from the first to the last of `names`, and more.

    names : names of members; a single name is returned alone.

    every : all members, in order.
    before, after : how many members are added before the first and after the last.
    """
    if len(names) == 1 and "." not in names[0]:
        return names
    head = names[0].partition(".")[0]
    family = [name for name in every if name.partition(".")[0] == head]
    family.sort(key=_order)
    if len(names) == 1:
        return names
    places = [family.index(name) for name in names]
    return family[max(0, min(places) - before) : max(places) + 1 + after]


def _order(name: str) -> list[tuple[int, int, str]]:
    """Return the key by which names of members are sorted: numbers before letters."""
    return [
        (0, int(x), "") if x.lstrip("-").isdigit() else (1, 0, x)
        for x in name.split(".")
    ]


def _written(names: list[str], values: MappingType[str, float], old: str) -> str:
    """Return the text of the numbers of some members: a number, or nested lists.

    names : the members.
    values : name -> new number.
    old : text of the number before.
    """
    if len(names) == 1:
        return _shown(values[names[0]]) if names[0] in values else old
    tree: dict[str, Any] = {}
    for name in names:
        *path, last = name.split(".")[1:]
        below = tree
        for part in path:
            below = below.setdefault(part, {})
        below[last] = _shown(values.get(name, 0.0))
    return _listed(tree)


def _listed(tree: Any) -> str:
    if isinstance(tree, str):
        return tree
    return f"[{', '.join(map(_listed, tree.values()))}]"


def _shown(value: float) -> str:
    return (
        f"{value:.0f}" if value == round(value) and abs(value) < 1e15 else repr(value)
    )
