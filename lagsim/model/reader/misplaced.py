"""Sections in sections, keys of sections beside them: lines indented too much or not.

What stands in a wrong place is told once, and read as if it stood in the right one, so
that nothing of it is reported as missing or unknown, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lagsim.model.nodes import Mapping, Node, Scalar

if TYPE_CHECKING:
    from collections.abc import Iterator
    from collections.abc import Mapping as MappingType

    from lagsim.model.reader.faults import Faults
    from lagsim.model.reader.fields import Entry

Forms = dict[str, dict[str, Any]]


def in_place(root: Node, forms: Forms, faults: Faults) -> Node:
    """Give the file with what is misplaced where it belongs, each reported.

    Parameters
    ----------
    forms
        The sections: what may stand in each.
    """
    if not isinstance(root, Mapping):
        return root
    entries = [*root.entries]
    entries += _taken_out(entries, forms, faults)
    _put_below(entries, forms, faults)
    _indented(entries, forms, faults)
    return root._replace(entries=tuple(entries))


def _is_open(node: Node) -> bool:
    """Tell whether keys can be put below a section's key."""
    return isinstance(node, Mapping) or (isinstance(node, Scalar) and node.empty)


def _joined(node: Node, more: list[Entry]) -> Node:
    if isinstance(node, Mapping):
        return node._replace(entries=(*node.entries, *more))
    return Mapping(tuple(more), more[0][0].place)


def _taken_out(entries: list[Entry], forms: Forms, faults: Faults) -> list[Entry]:
    """Take sections out of sections; give them."""
    found: list[Entry] = []
    present = {key.text for key, _ in entries}
    for k, (section, value) in enumerate(entries):
        form = forms.get(section.text)
        if form is None or not isinstance(value, Mapping):
            continue
        kept = []
        for key, inside in value.entries:
            name = key.text
            nested = _is_section(name, inside, forms) and not _has(form, name)
            if not nested or name in present:
                kept.append((key, inside))
                continue
            text = f"the section `{name}` is inside `{section.text}`"
            faults.add("misplaced-key", text, key.place, faults.belongs(name))
            present.add(name)
            found.append((key, inside))
        entries[k] = section, value._replace(entries=tuple(kept))
    return found


def _is_section(name: str, node: Node, forms: Forms) -> bool:
    """Tell whether what stands at `name` is what a section holds.

    A parameter may be called as a section is: it has keys of a parameter then.
    """
    if name not in forms or not isinstance(node, Mapping):
        return False
    own = {"value", "unit", "description", "guess", "relation"}
    return not any(key.text in own for key, _ in node.entries)


def _has(form: MappingType[str, Any], key: str) -> bool:
    return key in form.get("properties", ())


def _put_below(entries: list[Entry], forms: Forms, faults: Faults) -> None:
    """Put keys of one section, found beside the sections, below it."""
    for entry in _strangers(entries, forms):
        key = entry[0]
        for section, form in forms.items():
            if _has(form, key.text) and not isinstance(entry[1], Mapping):
                text = f"unknown key `{key.text}` in the file"
                if _add(entries, section, [entry], key):
                    faults.add("unknown-key", text, key.place, faults.belongs(key.text))
                break


def _strangers(entries: list[Entry], forms: Forms) -> Iterator[Entry]:
    for entry in [*entries]:
        name = entry[0].text
        if name not in forms and not name.startswith("x-"):
            yield entry


def _add(entries: list[Entry], section: str, more: list[Entry], at: Scalar) -> bool:
    """Move entries below a section, which may not be there; tell whether they fit."""
    for k, (key, value) in enumerate(entries):
        if key.text == section:
            taken = value.entries if isinstance(value, Mapping) else ()
            names = {name.text for name, _ in taken}
            if not _is_open(value) or any(e[0].text in names for e in more):
                return False
            entries[k] = key, _joined(value, more)
            break
    else:
        head = Scalar(section, False, at.place, at.span)
        entries.append((head, _joined(head, more)))
    for entry in more:
        entries.remove(entry)
    return True


def _indented(entries: list[Entry], forms: Forms, faults: Faults) -> None:
    """Put lines that follow an empty section, and are none, below it."""
    section: Scalar | None = None
    runs: dict[str, list[Entry]] = {}
    for key, value in entries:
        if key.text in forms:
            empty = isinstance(value, Scalar) and value.empty
            section = key if empty and forms[key.text].get("type") != "string" else None
        elif section is not None and not key.text.startswith("x-"):
            if faults.guess(key.text, forms):
                section = None
            else:
                runs.setdefault(section.text, []).append((key, value))
    for name, run in runs.items():
        first = run[0][0]
        more = f", and {len(run) - 1} more," if len(run) > 1 else ""
        text = f"`{first.text}`{more} below `{name}:` must be indented"
        hint = f"two blanks before each line that belongs to `{name}`"
        if _add(entries, name, run, first):
            faults.add("misplaced-key", text, first.place, hint)
