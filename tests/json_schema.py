"""A validator for the part of JSON Schema (draft-07) that the model file's uses."""

from __future__ import annotations

import re
from typing import Any

TYPES = {
    "object": dict, "array": list, "string": str, "number": (int, float),
    "boolean": bool, "null": type(None),
}  # fmt: skip
# What says nothing about validity.
SILENT = {"$schema", "title", "description"}


def faults(data: Any, schema: Any, at: str = "") -> list[str]:
    """Give what is wrong with `data`, each with its place."""
    if isinstance(schema, bool):
        return [] if schema else [f"{at}: nothing may stand here"]
    assert schema.keys() <= SILENT.union(*RULES.values())
    return [
        f"{at}: {text}"
        for kind, rules in RULES.items()
        if isinstance(data, kind)
        for word in rules.keys() & schema.keys()
        for text in rules[word](data, schema[word], schema)
    ]


def _is(data, rule):
    """Tell whether data are of one of some types; a boolean is no number."""
    names = [rule] if isinstance(rule, str) else rule
    if isinstance(data, bool):
        return "boolean" in names
    return any(isinstance(data, TYPES[name]) for name in names)


def _matches(pattern, text):
    """Tell as JavaScript does, whose `$` matches before no last line break."""
    return re.search(pattern.replace("$", r"\Z"), text)


def _each(pairs):
    """Give the faults of some parts: (data, schema, place)."""
    return [text for part, schema, at in pairs for text in faults(part, schema, at)]


def _others(data, schema):
    """Give the names that neither `properties` nor `patternProperties` has."""
    patterns = schema.get("patternProperties", {})
    known = schema.get("properties", {})
    return [
        n for n in data if n not in known and not any(_matches(p, n) for p in patterns)
    ]


def _tried(data, rule, wanted, what):
    """Give nothing if as many of several schemas hold as are wanted."""
    tried = [faults(data, one) for one in rule]
    return [] if wanted(sum(not found for found in tried)) else [f"{what}: {tried}"]


# By the kind of data of which a word speaks: of data, its rule, the whole schema.
RULES: dict[type, dict[str, Any]] = {
    object: {
        "type": lambda d, r, _: [] if _is(d, r) else [f"{d!r} is none of {r}"],
        "enum": lambda d, r, _: [] if d in r else [f"{d!r} is none of {r}"],
        "anyOf": lambda d, r, _: _tried(d, r, lambda n: n > 0, "none of"),
        "oneOf": lambda d, r, _: _tried(d, r, lambda n: n == 1, "not exactly one of"),
        "not": lambda d, r, _: [] if faults(d, r) else [f"{d!r} must not be {r}"],
    },
    str: {"pattern": lambda d, r, _: [] if _matches(r, d) else [f"{d!r} is no {r}"]},
    list: {
        "items": lambda d, r, _: _each((x, r, str(k)) for k, x in enumerate(d)),
        "minItems": lambda d, r, _: [f"fewer than {r}"] if len(d) < r else [],
        "maxItems": lambda d, r, _: [f"more than {r}"] if len(d) > r else [],
    },
    dict: {
        "required": lambda d, r, _: [f"`{n}` is missing" for n in r if n not in d],
        "dependencies": lambda d, r, _: [
            f"`{n}` is missing" for k in r.keys() & d for n in r[k] if n not in d
        ],
        "properties": lambda d, r, _: _each((d[n], r[n], n) for n in r.keys() & d),
        "patternProperties": lambda d, r, _: _each(
            (d[n], r[p], n) for p in r for n in d if _matches(p, n)
        ),
        "additionalProperties": lambda d, r, s: _each(
            (d[n], r, n) for n in _others(d, s)
        ),
        "propertyNames": lambda d, r, _: _each((n, r, "a name") for n in d),
        "minProperties": lambda d, r, _: [f"fewer than {r}"] if len(d) < r else [],
    },
}  # fmt: skip
