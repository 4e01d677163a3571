"""A validator for the part of JSON Schema (draft-07) that the model file's uses."""

from __future__ import annotations

import re
from typing import Any

TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "number": (int, float),
    "boolean": bool,
    "null": type(None),
}
# What says nothing about validity.
SILENT = {"$schema", "title", "description"}


def faults(data: Any, schema: Any, at: str = "") -> list[str]:
    """Give what is wrong with `data`, each with its place."""
    if isinstance(schema, bool):
        return [] if schema else [f"{at}: nothing may stand here"]
    found = []
    for word, rule in schema.items():
        if word not in SILENT:
            found += [f"{at}: {text}" for text in _RULES[word](data, rule, schema)]
    return found


def _type(data, rule, _schema):
    names = [rule] if isinstance(rule, str) else rule
    wrong = isinstance(data, bool) and "boolean" not in names
    if wrong or not isinstance(data, tuple(_flat(TYPES[n] for n in names))):
        yield f"{data!r} is none of {names}"


def _flat(types):
    for one in types:
        yield from one if isinstance(one, tuple) else (one,)


def _enum(data, rule, _schema):
    if data not in rule:
        yield f"{data!r} is none of {rule}"


def _matches(pattern, text):
    """Tell as JavaScript does, whose `$` matches before no last line break."""
    return re.search(pattern.replace("$", r"\Z"), text)


def _pattern(data, rule, _schema):
    if isinstance(data, str) and not _matches(rule, data):
        yield f"{data!r} does not match {rule}"


def _required(data, rule, _schema):
    if isinstance(data, dict):
        yield from (f"`{name}` is missing" for name in rule if name not in data)


def _dependencies(data, rule, _schema):
    for name, needed in rule.items():
        if isinstance(data, dict) and name in data:
            yield from _required(data, needed, None)


def _properties(data, rule, _schema):
    for name in rule.keys() & (data.keys() if isinstance(data, dict) else set()):
        yield from faults(data[name], rule[name], name)


def _pattern_properties(data, rule, _schema):
    for pattern, inner in rule.items():
        for name in data if isinstance(data, dict) else ():
            if _matches(pattern, name):
                yield from faults(data[name], inner, name)


def _additional(data, rule, schema):
    patterns = schema.get("patternProperties", {})
    for name in data if isinstance(data, dict) else ():
        known = name in schema.get("properties", {})
        if not known and not any(_matches(p, name) for p in patterns):
            yield from faults(data[name], rule, name)


def _property_names(data, rule, _schema):
    for name in data if isinstance(data, dict) else ():
        yield from faults(name, rule, "a name")


def _least_properties(data, rule, _schema):
    if isinstance(data, dict) and len(data) < rule:
        yield f"fewer than {rule}"


def _items(data, rule, _schema):
    for k, item in enumerate(data if isinstance(data, list) else ()):
        yield from faults(item, rule, str(k))


def _least(data, rule, _schema):
    if isinstance(data, list) and len(data) < rule:
        yield f"fewer than {rule}"


def _most(data, rule, _schema):
    if isinstance(data, list) and len(data) > rule:
        yield f"more than {rule}"


def _any_of(data, rule, _schema):
    tried = [faults(data, one) for one in rule]
    if all(tried):
        yield f"none of: {tried}"


def _one_of(data, rule, _schema):
    tried = [faults(data, one) for one in rule]
    if sum(not found for found in tried) != 1:
        yield f"not exactly one of: {tried}"


def _not(data, rule, _schema):
    if not faults(data, rule):
        yield f"{data!r} must not be {rule}"


_RULES = {
    "type": _type,
    "enum": _enum,
    "pattern": _pattern,
    "required": _required,
    "dependencies": _dependencies,
    "properties": _properties,
    "patternProperties": _pattern_properties,
    "additionalProperties": _additional,
    "propertyNames": _property_names,
    "minProperties": _least_properties,
    "items": _items,
    "minItems": _least,
    "maxItems": _most,
    "anyOf": _any_of,
    "oneOf": _one_of,
    "not": _not,
}
